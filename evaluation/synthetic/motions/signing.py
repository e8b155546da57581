"""The signing motion: the signs of the demo clip with one hand and then with the other, by a person who stands.

World: x to the person's left, y up, z forward, metres, seconds; the origin lies on the floor between the feet.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from evaluation.synthetic.acting.script import SIDES, ArmKey, Build, Hazard, Key, Script, mirrored
from evaluation.synthetic.motions.demo_script import SCRIPT

_FIRST, _LAST = 0.4, 3.62
"""Between these times of the demo's script are its signs; after them the person sits down."""
_AGAIN = 3.75
"""When the second round starts."""
_SECONDS = 8.0
"""Of both rounds."""


def signing(build: Build, seconds: float, rng: np.random.Generator) -> tuple[Script, list[Hazard]]:
    """A person's way of signing, and where detectors fail on it.

    Args:
        build: Of the person.
        seconds: Of the whole.
        rng: Source of chance.
    """
    pace = seconds / _SECONDS * (1 + 0.02 * rng.uniform(-1, 1, 2))
    clock = np.array([0.0, _AGAIN, _SECONDS]), np.array([0.0, _AGAIN * pace[0], _SECONDS * pace[1]])
    other = mirrored(SCRIPT)

    def twice(name: str) -> list[Key]:
        first, second = getattr(SCRIPT, name), getattr(other, name)
        return [(_at(clock, t), v) for t, v in [*_round(first, 0.0, 0.0), *_round(second, _FIRST, _AGAIN)]]

    face = {
        name: [(_at(clock, t), v) for t, v in [*_round(keys, 0.0, 0.0), *_round(keys, _FIRST, _AGAIN)]]
        for name, keys in SCRIPT.face.items()
    }
    script = Script(
        seconds=seconds,
        arms={side: _arm(SCRIPT.arms[side], other.arms[side], build, clock) for side in SIDES},
        hips_path=twice("hips_path"),
        hips_turn=twice("hips_turn"),
        spine_turn=twice("spine_turn"),
        head_turn=twice("head_turn"),
        jaw_degrees=twice("jaw_degrees"),
        face=face,
    )
    return script, [replace(h, start=_at(clock, h.start), stop=_at(clock, h.stop)) for h in _HAZARDS]


def _at(clock: tuple[np.ndarray, np.ndarray], time: float) -> float:
    return float(np.interp(time, *clock))


def _round(keys: Sequence[Key], first: float, shift: float) -> list[Key]:
    """The keys of the signs, from a time on, moved to later."""
    return [(time + shift, value) for time, value in keys if first <= time <= _LAST]


def _arm(
    first: Sequence[ArmKey], second: Sequence[ArmKey], build: Build, clock: tuple[np.ndarray, np.ndarray]
) -> list[ArmKey]:
    hanging = first[0]
    keys = [hanging, *(key for key in first[1:] if key.time <= _LAST)]
    keys += [replace(key, time=key.time + _AGAIN) for key in second if _FIRST <= key.time <= _LAST]
    keys += [replace(hanging, time=_SECONDS - 0.05)]
    return [
        replace(key, time=_at(clock, key.time), wrist=tuple((build.arm * np.array(key.wrist)).tolist())) for key in keys
    ]


_HAZARDS = (
    Hazard("dropped", 0.3, 0.9, ("right_hand",)),
    Hazard("dropped", 1.2, 2.0, ("right_hand",)),
    Hazard("swapped", 2.1, 2.8, ("arms",), likely=0.6),
    Hazard("dropped", 3.0, 3.6, ("left_hand",)),
    Hazard("dropped", 4.0, 4.8, ("left_hand",)),
    Hazard("dropped", 5.0, 5.8, ("left_hand", "left_wrist")),
    Hazard("swapped", 5.9, 6.6, ("arms",), likely=0.6),
    Hazard("dropped", 6.7, 7.4, ("right_hand",)),
)
