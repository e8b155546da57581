"""The state of one browser tab: its frame, selection and display settings."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal

from fitting_core.config.schema import DEFAULT_PRESET, PRESETS, FitConfig
from fitting_core.keypoints import GROUPS, INDEX
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.project.storage.run_record import Given
from tcfit_app.review.scene.layers import OPACITY
from tcfit_app.review.scene.side_view import Direction

Mode = Literal["edit", "ab", "space"]
MODES: dict[Mode, str] = {"edit": "Edit", "ab": "Compare", "space": "3D"}
"""One poster; two posters; a room around the bodies."""
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
Need = Literal["bodies", "beside", "picture", "silhouettes", "others", "two_fits", "writable", "keypoints"]
"""What must hold before a control can be used: a name in `NEEDS` of the gestures."""
Section = Literal["playing", "shown", "body", "compare", "keyframes", "camera"]
"""Where a switch is: in the bar, in one of its menus Body and Compare, or in a panel."""


@dataclass(frozen=True)
class Switch:
    """The row of a field that is on or off: a button, and one of ACTIONS with the field's name."""

    section: Section
    label: str
    """The button's."""
    title: str
    """In menus, tooltips and the command palette."""
    keys: str = ""
    """As in the rows of ACTIONS."""
    needs: tuple[Need, ...] = ()


def control(default: bool, row: Switch) -> Any:
    """A field of TabState that users switch."""
    return field(default=default, metadata={"control": row})


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
    problems: tuple[tuple[str, str], ...] = ()
    """Invalid inputs: the name of the setting, and why. No fit can be started until they are corrected."""


@dataclass(frozen=True, kw_only=True)
class TabState:
    """Everything a browser can set about its view."""

    frame: int = 0
    mode: Mode = "edit"
    a: FitChoice | None = None
    """What the fit on show is compared with, left in Compare; None: the fit before it."""
    b: FitChoice = field(default_factory=FitChoice)
    """The fit on show, right in Compare; the one that is edited."""
    wipe: bool = False
    """A and B share a window in Compare, with a divider; otherwise each has its own, as large as possible."""
    clipped: bool = control(
        True,
        Switch(
            "body", "Clip to picture", "Bodies clipped to the picture, or faded outside", needs=("bodies", "picture")
        ),
    )
    blinked: bool = control(False, Switch("compare", "Blink", "Blink: A in B's place", "b", needs=("two_fits",)))
    selection: tuple[int, ...] = ()
    """Selected keypoints, the last selected at the end."""
    suggested: bool = False
    """The review queue selected them, not the user: a drag moves only the one under the pointer."""
    in_view: bool = False
    """They were selected in another view's picture, to which corrections then apply."""
    frames: range | None = None
    """The selected frames."""
    frames_suggested: bool = False
    """The review queue selected them: they are deselected when the tab leaves them."""
    keyframes: bool = control(
        True, Switch("keyframes", "Keyframes", "Keyframes on or off", "a", needs=("writable", "keypoints"))
    )
    """Moves in one frame are keyframes: frames between two of them are interpolated."""
    hand_along: bool = control(
        True,
        Switch(
            "keyframes", "Hand follows its wrist", "Hand follows its wrist, on or off", needs=("writable", "keypoints")
        ),
    )
    """A moved wrist takes its hand along, and a hand's wrist the body's."""
    side: bool = control(True, Switch("shown", "Side view", "Side view on or off", "v", needs=("beside",)))
    """The side view is beside the picture, if there is a fit."""
    side_from: Direction | int = "right"
    """Where its viewer is: the plate is to the right of the picture, hence this default side; or the number of another
    view that takes its place."""
    close_up: Part | None = None
    """What the view follows from frame to frame; in Edit beside the video alone."""
    playing: bool = False
    speed: float = 1.0
    """One of SPEEDS."""
    loop: bool = control(True, Switch("playing", "Loop", "Loop on or off", "l"))
    keypoints: bool = control(True, Switch("shown", "Keypoints", "Keypoints on or off", "k"))
    silhouette: bool = control(
        False, Switch("body", "Silhouette", "Silhouette on or off", "Shift+u", needs=("silhouettes", "picture"))
    )
    straight_lines: bool = control(
        False, Switch("camera", "Straight lines", "Straight lines in the picture on or off", needs=("picture",))
    )
    """Those that the camera was estimated from are drawn over the picture."""
    bodies: bool = control(True, Switch("shown", "Bodies", "Bodies on or off", "m", needs=("bodies",)))
    outline: bool = control(False, Switch("body", "Outline", "Outline on or off", "u", needs=("bodies", "picture")))
    others: bool = control(True, Switch("body", "Other people", "The clip's other people on or off", needs=("others",)))
    difference: bool = control(
        False, Switch("compare", "Colour by distance", "Colour by distance between A and B", "d", needs=("two_fits",))
    )
    opacity: float = OPACITY
    """Of bodies."""
    groups: frozenset[str] = frozenset(GROUPS)
    """Keypoint groups shown."""
    plots: tuple[str, ...] = ("reprojection",)
    """The rows of the timeline, names of PLOTS."""
    queue_kind: str = ""
    """Only entries of this kind of the review queue are listed; empty: all."""
    ghost: bool = control(
        False, Switch("compare", "Other fit as a ghost in 3D", "A as a ghost in 3D, on or off", needs=("two_fits",))
    )
    settings: FitSettings = field(default_factory=FitSettings)
    folds: frozenset[str] = frozenset()
    """The open folds of the panels, by name."""
    keys: bool = False
    """The window of all keys is open."""
    steps: bool = False
    """The first steps are on show."""
    dark: bool = True
    """The browser's theme."""

    @property
    def comparing(self) -> bool:
        """Whether two fits are on show."""
        return self.mode == "ab" or self.blinked or self.difference or (self.mode == "space" and self.ghost)


CONTROLS: Mapping[str, Switch] = {
    one.name: one.metadata["control"] for one in fields(TabState) if "control" in one.metadata
}
"""The rows, by field."""
_OF_A_PERSON = {
    "frame",
    "a",
    "b",
    "selection",
    "suggested",
    "in_view",
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
