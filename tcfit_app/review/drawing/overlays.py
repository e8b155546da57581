"""What the page draws over the picture besides bodies: keypoints, people found, silhouette and close-up.

Each state is made again only when what it depends on has changed.
"""

import cv2
import numpy as np
from jaxtyping import Bool, Float

from fitting_core.camera import Camera, Lens
from fitting_core.ground import from_pictures
from fitting_core.keypoints import BODY, BONES, COUNT, GROUPS
from fitting_core.lens import straightened
from tcfit_app.imports.found_people import FoundInFrame
from tcfit_app.review.browser.page_states import (
    Focus,
    Keypoints,
    OtherPeople,
    OtherPerson,
    Silhouette,
    StraightLines,
    Style,
    View,
    pixel_pairs,
    segments,
    shares,
    triple,
)
from tcfit_app.review.drawing.frame import Beside, Frame, Other
from tcfit_app.review.scene.layers import NEAREST, BodyLayer
from tcfit_app.review.scene.other_view import OtherCamera
from tcfit_app.review.tab.state import HELD_BY, Part
from tcfit_app.review.tab.tab import Tab

_STEADIED = 2.0
"""Standard deviation in frames of the smoothing that steadies a close-up: detections jitter."""
_SEEN = 8
"""Frames before and after that the smoothing uses."""
_APART = 0.25
"""Minimum distance of another person's centre, relative to the chosen person's size, to be offered."""
_BODY_BONES = [pair for pair in BONES if max(pair) < BODY.stop]
_SMOOTHED = 0.8
"""Tolerance of an outline in mask pixels: the mask's border is stepped."""
_FEWEST = 3
"""Minimum number of an outline's corners."""


def draw_overlays(tab: Tab, frame: Frame) -> None:
    """Send what a drag does not change, as far as it has changed."""
    state, project, send = tab.state, tab.session.project, tab.channel.send
    style = Style(
        groups=tuple(sorted(state.groups)),
        points=state.keypoints,
        hand_along=state.hand_along,
    )
    send("style", style)
    key, clip, part = (state.frame, frame.edits), project.footage, state.close_up
    masks = clip.silhouettes if state.silhouette and state.mode != "space" else None
    if masks is None:
        send("silhouette", None)
    else:
        send("silhouette", tab.once("silhouette", key, lambda: silhouette(masks.mask(state.frame), clip.camera)))
    found = tab.data.straight_lines if state.straight_lines and state.mode != "space" else None
    send("straight_lines", found and tab.once("straight lines", found, lambda: _straight_lines(found)))
    focus = None if part is None else tab.once("focus", (part, *key), lambda: _focus(tab, part))
    if focus is not None or part is None:  # otherwise it stays put
        send("focus", focus)
    _draw_people(tab, frame)
    if project.has_detections:
        send("keypoints", tab.once("keypoints", key, lambda: _keypoints(tab)))


def draw_view(tab: Tab, frame: Frame) -> None:
    """Send another view's picture and keypoints, if one is beside the pictures."""
    beside, there = frame.beside, frame.side
    if beside is None or not isinstance(there, OtherCamera):
        tab.channel.send("view", None)
        return
    x, y, z = (triple(row) for row in np.round(there.turn, 6))
    camera = there.camera
    tab.channel.send(
        "view",
        View(
            image=camera.size,
            turn=(x, y, z),
            place=triple(np.round(there.place, 5)),
            camera=(*camera.focal, *camera.center),
        ),
    )
    key = beside.view, beside.frame, frame.edits
    tab.channel.send("view_keypoints", tab.once("view keypoints", key, lambda: _in_view(beside)))


def _in_view(beside: Beside) -> Keypoints:
    """Of the view's frame; all missing while it shows none."""
    corrected, frame = beside.view.corrected, beside.frame
    if frame is None:
        return Keypoints(frame=0, xy=((0.0, 0.0),) * COUNT, confidence=(0.0,) * COUNT)
    return Keypoints(
        frame=frame,
        xy=pixel_pairs(corrected.xy[frame]),
        confidence=shares(corrected.confidence[frame]),
        bad=tuple(np.flatnonzero(corrected.bad[frame]).tolist()),
        edited=tuple(np.flatnonzero(corrected.edited[frame]).tolist()),
    )


def _keypoints(tab: Tab) -> Keypoints:
    """Corrected keypoints of the frame on show."""
    project, frame = tab.session.project, tab.state.frame
    corrected = project.corrected
    here, ignored = corrected[frame], corrected[[frame]].keypoints().overruled[0]
    return Keypoints(
        frame=frame,
        xy=pixel_pairs(corrected.xy[frame]),
        confidence=shares(corrected.confidence[frame]),
        bad=tuple(np.flatnonzero(here.bad).tolist()),
        edited=tuple(np.flatnonzero(here.edited).tolist()),
        pinned=tuple(np.flatnonzero(here.pinned).tolist()),
        locked=tuple(np.flatnonzero(here.locked[BODY]).tolist()),
        deep=tuple(np.flatnonzero(np.isfinite(here.told_depth) & ~here.pinned).tolist()),
        ignored=tuple(np.flatnonzero(ignored).tolist()),
    )


# --- close-ups ---


def _focus(tab: Tab, part: Part) -> Focus | None:
    corrected, frame = tab.session.project.corrected, tab.state.frame
    first = max(frame - _SEEN, 0)
    near = slice(first, frame + _SEEN + 1)
    for group in (GROUPS[part], [HELD_BY[part]]):
        there = corrected.confidence[near, group] > 0
        found = followed(corrected.xy[near, group], there, frame - first)
        if found is not None:
            return Focus(x=float(found[0]), y=float(found[1]))
    return None


def followed(xy: Float[np.ndarray, "t K 2"], there: Bool[np.ndarray, "t K"], now: int) -> Float[np.ndarray, "2"] | None:
    """The centre of keypoints at one frame, smoothed over frames; None without keypoints."""
    seen = np.flatnonzero(there.any(1))
    if not len(seen):
        return None
    middles = np.array([xy[t][there[t]].mean(0) for t in seen])
    weights = np.exp(-0.5 * ((seen - now) / _STEADIED) ** 2) + 1e-9
    return weights @ middles / weights.sum()


def in_image(points: Float[np.ndarray, "n 3"], camera: Camera) -> Float[np.ndarray, "n 2"]:
    """Pixels of points in camera space; NaN behind the camera."""
    z = np.where(points[:, 2:] > 0.01, points[:, 2:], np.nan)
    return points[:, :2] / z * np.array(camera.focal) + np.array(camera.center)


# --- people found by a detection, and the clip's other people ---


def _draw_people(tab: Tab, frame: Frame) -> None:
    """Send the chosen person's keypoints until the project has them, and the people who can be clicked on instead."""
    people, fresh = tab.session.source.people, not tab.session.project.has_detections
    looking = people if fresh or tab.session.can_choose_person else None
    now = tab.state.frame
    key = now, looking, looking and looking.version
    chosen, others = tab.once("found", key, lambda: found_in(now, looking and looking.at(now)))
    if fresh:
        tab.channel.send("keypoints", chosen)
    if tab.someone.others:
        flat = tab.state.mode != "space"
        key = flat, tuple((one.someone.number, one.body.version) for one in frame.others)
        named = tab.once("other people", key, lambda: tuple(_named(one, flat=flat) for one in frame.others))
        others = OtherPeople(people=named)
    tab.channel.send("other_people", others)


def found_in(frame: int, found: FoundInFrame | None) -> tuple[Keypoints, OtherPeople]:
    """The chosen person's keypoints in a frame, and the others who can be chosen instead."""
    nobody = np.zeros((COUNT, 3))
    points = nobody if found is None or found.chosen is None else found.points[found.chosen]
    people = (
        ()
        if found is None
        else tuple(
            _offered(place, found.points[place])
            for place in found.others
            if not in_the_same_place(found.points[place], points)
        )
    )
    shown = Keypoints(frame=frame, xy=pixel_pairs(points[:, :2]), confidence=shares(points[:, 2]))
    return shown, OtherPeople(people=people)


def in_the_same_place(points: Float[np.ndarray, "137 3"], meant: Float[np.ndarray, "137 3"]) -> bool:
    """Whether a person is in the same place as the chosen one: a press would be ambiguous, and such a detection is
    often a part of the chosen person."""
    one, other = (of[BODY][of[BODY, 2] > 0, :2] for of in (points, meant))
    if not len(one) or not len(other):
        return False
    size = float(np.linalg.norm(np.ptp(other, axis=0)))
    return float(np.linalg.norm(one.mean(0) - other.mean(0))) < _APART * size


def _offered(place: int, points: Float[np.ndarray, "137 3"]) -> OtherPerson:
    """A person who was not chosen."""
    sure = points[BODY][points[BODY, 2] > 0, :2]
    bones = [points[[a, b], :2] for a, b in _BODY_BONES if points[a, 2] > 0 and points[b, 2] > 0]
    drawn = segments(np.reshape(bones, (-1, 4)))
    return OtherPerson(number=place, name="This one?", hint="Choose this person instead", at=_top(sure), bones=drawn)


def _named(one: Other, *, flat: bool) -> OtherPerson:
    """A person of the clip, whose name leads to them; in the 2D modes it is above the head."""
    someone = one.someone
    at = _top(_pixels(one.layer)) if flat else None
    return OtherPerson(number=someone.number, name=someone.name, hint=f"Show and correct {someone.name}", at=at)


def _pixels(layer: BodyLayer) -> Float[np.ndarray, "n 2"]:
    assert layer.camera is not None
    return in_image(layer.vertices[layer.vertices[:, 2] > NEAREST], layer.camera)


def _top(xy: Float[np.ndarray, "n 2"]) -> tuple[float, float] | None:
    """The highest of some points."""
    return pixel_pairs(xy[[xy[:, 1].argmin()]])[0] if len(xy) else None


# --- the silhouette, and straight lines ---


def _straight_lines(found: from_pictures.StraightLines) -> StraightLines:
    return StraightLines(along=segments(found.edges[found.along]), other=segments(found.edges[~found.along]))


def silhouette(mask: Bool[np.ndarray, "h w"] | None, camera: Camera) -> Silhouette | None:
    """A mask's outlines for the page, if any."""
    found = [] if mask is None else outlines(mask, camera.size, camera.lens)
    return Silhouette(lines=tuple(map(pixel_pairs, found))) if found else None


def outlines(mask: Bool[np.ndarray, "h w"], size: tuple[int, int], lens: Lens | None) -> list[Float[np.ndarray, "n 2"]]:
    """The borders of a mask and of its holes, in pixels of the undistorted picture.

    Args:
        mask: Of the distorted picture, see `Silhouettes`.
        size: Width and height of the picture.
        lens: Of its camera.
    """
    borders, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    scale = np.array(size) / mask.shape[::-1]
    lines = []
    for border in borders:
        corners = cv2.approxPolyDP(border, _SMOOTHED, True)[:, 0].astype(float)
        points = (corners + 0.5) * scale - 0.5
        if lens is not None:
            points, there = straightened(lens, points)
            points = points[there]
        if len(points) >= _FEWEST:
            lines.append(points)
    return lines
