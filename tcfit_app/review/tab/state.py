"""The state of one browser tab: its frame, selection and display settings."""

from dataclasses import dataclass, field, fields, replace
from typing import Literal

from fitting_core.config.schema import DEFAULT_PRESET, PRESETS, FitConfig
from fitting_core.keypoints import GROUPS, INDEX
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.project.storage.run_record import Given
from tcfit_app.review.scene.layers import OPACITY
from tcfit_app.review.scene.side_view import Direction, Named
from tcfit_app.review.scene.windows import Arrangement

Mode = Literal["edit", "ab", "space"]
MODES: dict[Mode, str] = {"edit": "Edit", "ab": "A | B", "space": "3D"}
"""One poster; two posters; a room around the bodies."""
Beside = Literal["alone", "ghost", "apart"]
BESIDE: dict[Beside, str] = {"alone": "B alone", "ghost": "A as a ghost", "apart": "Side by side"}
"""Where A is in 3D: not drawn, faint in its place, or next to B."""
PANEL_TITLES = ("View", "Keypoints", "Review", "Fit", "Runs", "Compare", "Export")
"""The panels beside the picture, in their order."""
SIDES_SEEN: tuple[Named, ...] = ("left", "right", "top")
"""Directions of the side view that a key cycles through."""
SIDE_WIDTHS = (0.25, 2.0)
"""Minimum and maximum width of the side view's plate, in image heights."""
OPACITIES = (0.1, 1.0)
"""Minimum and maximum opacity of bodies."""
Part = Literal["right_hand", "left_hand", "face"]
CLOSE_UPS: dict[Part, str] = {"right_hand": "Right hand", "left_hand": "Left hand", "face": "Face"}
"""Keypoint groups that the view can follow."""
HELD_BY: dict[Part, int] = {
    "right_hand": INDEX["right_wrist"],
    "left_hand": INDEX["left_wrist"],
    "face": INDEX["nose"],
}
"""What it follows where the group was not detected: a keypoint of the body."""
SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)


@dataclass(frozen=True, kw_only=True)
class FitSettings:
    """The settings in the Fit panel."""

    config: FitConfig = field(default_factory=lambda: PRESETS[DEFAULT_PRESET])
    preset: str = DEFAULT_PRESET
    kind: str = "smplx"
    gender: str = "neutral"
    focal: float | None = None
    """Focal length along x for a whole fit, pixels; None: the clip's."""
    given: Given = field(default_factory=Given)
    """The start and the shape of a whole fit; the shape also applies to a re-run of the shape."""
    reach: int = 10
    """Frames before and after an edited or flagged one that are refitted with it."""
    problems: tuple[tuple[str, str], ...] = ()
    """Invalid inputs: the name of the setting, and why. No fit can be started until they are corrected."""


QueueOrder = Literal["suspicion", "uncertainty", "time"]


@dataclass(frozen=True, kw_only=True)
class QueueView:
    """The part of the review queue that a tab steps through."""

    kind: str = ""
    """Only entries of this kind; empty: of all."""
    limb: str = ""
    """Only entries about this limb, or the whole body; empty: about any."""
    order: QueueOrder = "suspicion"


@dataclass(frozen=True, kw_only=True)
class TabState:
    """Everything a browser can set about its view."""

    frame: int = 0
    mode: Mode = "edit"
    a: FitChoice = field(default_factory=lambda: FitChoice(phase=1))
    """Left in A | B; shown when blinking."""
    b: FitChoice = field(default_factory=FitChoice)
    """Right in A | B; the one that is edited."""
    arrangement: Arrangement | None = None
    """Arrangement of A and B in A | B; None: whichever makes them larger."""
    clipped: bool | None = None
    """Bodies are clipped to the picture; None: in A | B they are."""
    blinked: bool = False
    """A is shown in B's place."""
    selection: tuple[int, ...] = ()
    """Selected keypoints, the last selected at the end."""
    suggested: bool = False
    """The review queue selected them, not the user: a drag moves only the one under the pointer."""
    frames: range | None = None
    """The selected frames."""
    frames_suggested: bool = False
    """The review queue selected them: they are deselected when the tab leaves them."""
    keyframes: bool = True
    """Moves in one frame are keyframes: frames between two of them are interpolated."""
    hand_along: bool = True
    """A moved wrist takes its hand along, and a hand's wrist the body's."""
    side: bool = True
    """The side view is beside the picture, if there is a fit."""
    side_from: Direction = "right"
    """Where its viewer is. The plate is to the right of the picture, hence this default side."""
    side_width: float | None = None
    """Width of its plate, in image heights; None: chosen to suit the pictures."""
    close_up: Part | None = None
    """What the view follows from frame to frame; in Edit beside the video alone."""
    trail: bool = False
    """The paths of the selected keypoints around the frame are drawn."""
    playing: bool = False
    speed: float = 1.0
    loop: bool = True
    video: bool = True
    bodies: bool = True
    opacity: float = OPACITY
    outline: bool = False
    """Bodies are drawn as lines."""
    others: bool = True
    """The other people of the clip are drawn too, if any."""
    silhouette: bool = False
    """The person's silhouette is drawn, where known."""
    difference: bool = False
    """Bodies are coloured by the distance between A and B."""
    groups: frozenset[str] = frozenset(GROUPS)
    """Keypoint groups shown."""
    keypoints: bool = True
    bones: bool = True
    color_by: Literal["group", "confidence"] = "group"
    minimum: float = 0.0
    """Keypoints with less confidence are hidden."""
    error_bars: bool = True
    """Error bars of joints are drawn in the side view and in 3D, where known."""
    detections: bool = True
    """Corrected keypoints are linked to their detected positions."""
    plots: tuple[str, ...] = ("reprojection", "jitter")
    """The rows of the timeline, names of PLOTS."""
    queue: QueueView = field(default_factory=QueueView)
    """Which entries of the review queue are listed, and in which order."""
    beside: Beside = "alone"
    """Where A is in 3D."""
    settings: FitSettings = field(default_factory=FitSettings)
    keys: bool = False
    """The window of all keys is open."""


_OF_A_PERSON = {
    "frame",
    "a",
    "b",
    "selection",
    "suggested",
    "frames",
    "frames_suggested",
    "settings",
    "playing",
    "keys",
}
"""State that belongs to one person's project; the rest is how it is displayed."""


def seen_alike(state: TabState, other: TabState) -> TabState:
    """One person's state, displayed like another's."""
    looks = {one.name: getattr(other, one.name) for one in fields(TabState) if one.name not in _OF_A_PERSON}
    return replace(state, playing=False, keys=False, **looks)
