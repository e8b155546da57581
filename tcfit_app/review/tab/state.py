"""What one browser tab has set: its own frame, selection and looks."""

from dataclasses import dataclass, field, fields, replace
from typing import Literal

from fitting_core.config.schema import DEFAULT_PRESET, PRESETS, FitConfig
from fitting_core.keypoints import GROUPS
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.project.storage.run_record import Given
from tcfit_app.review.scene.layers import OPACITY
from tcfit_app.review.scene.side_view import Direction, Named
from tcfit_app.review.scene.windows import Arrangement

Mode = Literal["edit", "ab", "space"]
MODES: dict[Mode, str] = {"edit": "Edit", "ab": "A | B", "space": "3D"}
"""One poster; two posters; a room around the bodies."""
SIDES_SEEN: tuple[Named, ...] = ("left", "right", "top")
"""From where the side view can be seen with one key."""
SIDE_WIDTHS = (0.25, 2.0)
"""Least and greatest width of the side view's plate, in image heights."""
OPACITIES = (0.1, 1.0)
"""Least and greatest opacity of bodies."""
Part = Literal["right_hand", "left_hand", "face"]
CLOSE_UPS: dict[Part, str] = {"right_hand": "Right hand", "left_hand": "Left hand", "face": "Face"}
"""Groups of keypoints that the view can follow."""
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
    given: Given = field(default_factory=Given)
    """The start and the shape of a whole fit; the shape counts for a shape that is re-run as well."""
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
    arrangement: Arrangement | None = None
    """Of A and B in A | B; None: whichever makes them larger."""
    clipped: bool | None = None
    """Bodies end where the picture ends; None: in A | B they do."""
    blinked: bool = False
    """A is shown in B's place."""
    selection: tuple[int, ...] = ()
    """Keypoints, the one selected last at the end."""
    suggested: bool = False
    """The review queue has selected them, not the user: a drag moves the one under the pointer, and no others."""
    frames: range | None = None
    """The selected frames."""
    keyframes: bool = True
    """What is put somewhere in one frame is a keyframe: what lies between two of them follows both."""
    hand_along: bool = True
    """A wrist that is moved takes its hand along, and a hand's its body's."""
    side: bool = True
    """The side view stands beside the picture, where there is a fit."""
    side_from: Direction = "right"
    """Where its viewer stands. It is at the picture's right: so the camera is on the picture's side of it."""
    side_width: float | None = None
    """Of its plate, in image heights; None: as suits the pictures."""
    close_up: Part | None = None
    """What the view follows from frame to frame."""
    trail: bool = False
    """The paths of the selected keypoints around the frame are drawn."""
    playing: bool = False
    speed: float = 1.0
    loop: bool = True
    video: bool = True
    bodies: bool = True
    opacity: float = OPACITY
    wireframe: bool = False
    outline: bool = False
    """Bodies are drawn as lines."""
    others: bool = True
    """The other people of the clip are drawn as well, if there are some."""
    silhouette: bool = False
    """What the detector says that the person covers of the picture is drawn, where it is known."""
    difference: bool = False
    """Bodies are coloured by the distance between A and B."""
    groups: frozenset[str] = frozenset(GROUPS)
    """Groups of keypoints that are shown."""
    keypoints: bool = True
    bones: bool = True
    color_by: Literal["group", "confidence"] = "group"
    minimum: float = 0.0
    """Keypoints of less confidence are left out."""
    error_bars: bool = True
    """How far off joints may be is drawn in the side view and in 3D, where it is known."""
    detections: bool = True
    """Corrected keypoints have a trace to where they were detected."""
    plots: tuple[str, ...] = ("reprojection", "jitter")
    """The rows of the timeline, names of PLOTS."""
    apart: float = 0.0
    """Metres between A and B in 3D; 0 leaves both in place."""
    settings: FitSettings = field(default_factory=FitSettings)
    keys: bool = False
    """The window of all keys is open."""


_OF_A_PERSON = {"frame", "a", "b", "selection", "suggested", "frames", "settings", "playing", "keys"}
"""What is about one person's project; all else is how things are looked at."""


def seen_alike(state: TabState, other: TabState) -> TabState:
    """A state of one person that is looked at as another person's is."""
    looks = {one.name: getattr(other, one.name) for one in fields(TabState) if one.name not in _OF_A_PERSON}
    return replace(state, playing=False, keys=False, **looks)
