"""What one browser tab has set: its own frame, selection and looks."""

from dataclasses import dataclass, field
from typing import Literal

from fitting_core.config.schema import DEFAULT_PRESET, PRESETS, FitConfig
from fitting_core.keypoints import GROUPS
from tcfit_app.fitting.fits import FitChoice

Mode = Literal["edit", "ab", "space"]
MODES: dict[Mode, str] = {"edit": "Edit", "ab": "A | B", "space": "3D"}
"""One poster; two posters; a room around the bodies."""
SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)


@dataclass(frozen=True, kw_only=True)
class FitSettings:
    """What the fit panel is set to."""

    config: FitConfig = field(default_factory=lambda: PRESETS[DEFAULT_PRESET])
    preset: str = DEFAULT_PRESET
    kind: str = "smplx"
    gender: str = "neutral"
    focal: float | None = None
    """Focal length along x for a whole fit, in pixels; None: the clip's."""
    reach: int = 10
    """Frames before and after an edited or flagged one that are fitted again with it."""
    problems: tuple[tuple[str, str], ...] = ()
    """What was entered and cannot be used: the name of the setting, and why. Nothing is fitted until it is right."""


@dataclass(frozen=True, kw_only=True)
class TabState:
    """Everything that one browser can set about what it sees."""

    frame: int = 0
    mode: Mode = "edit"
    a: FitChoice = field(default_factory=lambda: FitChoice(phase=1))
    """Left of A | B; what blinking shows."""
    b: FitChoice = field(default_factory=FitChoice)
    """Right of A | B; what is edited."""
    blinked: bool = False
    """A is shown in B's place."""
    selection: tuple[int, ...] = ()
    """Keypoints, the one selected last at the end."""
    suggested: bool = False
    """The review queue has selected them, not the user: a drag moves the one under the pointer, and no others."""
    frames: range | None = None
    """The selected frames."""
    playing: bool = False
    speed: float = 1.0
    loop: bool = True
    video: bool = True
    bodies: bool = True
    opacity: float = 0.85
    wireframe: bool = False
    difference: bool = False
    """Bodies are coloured by the distance between A and B."""
    groups: frozenset[str] = frozenset(GROUPS)
    """Groups of keypoints that are shown."""
    keypoints: bool = True
    bones: bool = True
    color_by: Literal["group", "confidence"] = "group"
    minimum: float = 0.0
    """Keypoints of less confidence are left out."""
    detections: bool = True
    """Corrected keypoints have a trace to where they were detected."""
    curve: str = "reprojection"
    """What the timeline plots: one of CURVES, or BETWEEN."""
    apart: float = 0.0
    """Metres between A and B in 3D; 0 leaves both in place."""
    settings: FitSettings = field(default_factory=FitSettings)
    keys: bool = False
    """The window of all keys is open."""
