"""What a tab shows of one frame: video, bodies, room and side view, worked out once from fits, frame, state and edits.

`picture.py` draws such a `Frame`, and decides nothing. While the fit follows a drag, only its bodies are worked out
again.
"""

from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Float32

from fitting_core.clip import OtherView
from fitting_core.errors import InputError
from fitting_core.render.colors import rgb
from tcfit_app.analysis.curves import vertex_distances
from tcfit_app.analysis.seen import seen_joints, unseen_keypoints
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.project.other_view import ProjectView
from tcfit_app.review.browser.page_states import Color
from tcfit_app.review.scene.layers import MOST_OTHERS, OTHER_OPACITY, BodyLayer
from tcfit_app.review.scene.other_view import OtherCamera, other_camera
from tcfit_app.review.scene.room import UNKNOWN, Room
from tcfit_app.review.scene.side_view import SideView, side_view
from tcfit_app.review.scene.space import Rings
from tcfit_app.review.scene.windows import Arrangement
from tcfit_app.review.shared.drawing_data import FrameBody
from tcfit_app.review.shared.video_frames import VideoFrames
from tcfit_app.review.tab.on_show import SLOT_COLORS, OnShow, Slot, coming, live_window
from tcfit_app.review.tab.people import ReviewedPerson
from tcfit_app.review.tab.state import TabState
from tcfit_app.review.tab.tab import Tab

_AHEAD = 24
"""Frames decoded ahead of playback."""
Vertices = Float32[np.ndarray, "V 3"]
Present = Bool[np.ndarray, "137"] | None
_OTHER: dict[Slot, Slot] = {"a": "b", "b": "a"}


@dataclass(frozen=True, kw_only=True, eq=False)
class Other:
    """The body of another person of the clip."""

    someone: ReviewedPerson
    body: FrameBody
    layer: BodyLayer


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """What a tab shows of one frame."""

    state: TabState
    shown: OnShow
    edits: int
    """`Project.keypoints_version`."""
    unseen: tuple[int, ...]
    """BODY_25 keypoints of which there is no evidence."""
    image: bytes
    """A JPEG."""
    bodies: dict[Slot, BodyLayer]
    """Those of the fits that can be drawn; also hidden ones whose keypoints the side view or 3D shows."""
    problem: str
    """What cannot be shown, and why; empty if all can."""
    others: tuple[Other, ...]
    room: Room | None
    """Of the fit on show, relative to the camera of the frame; the previous one while another is computed."""
    side: SideView | OtherCamera | None
    """What is beside the picture."""
    beside: "Beside | None"
    """Another view there."""
    arrangement: Arrangement
    """Of two pictures."""
    labels: tuple[tuple[str, Color | None], ...]
    """Name and colour of each body's place."""
    rings: Rings | None

    @property
    def visible(self) -> dict[Slot, BodyLayer]:
        """The bodies that are drawn."""
        return self.bodies if self.state.bodies else {}

    @property
    def places(self) -> list[tuple[BodyLayer, ...]]:
        """The bodies drawn in each place."""
        return [tuple(self.visible[side] for side in place if side in self.visible) for place in self.shown.places]

    @property
    def fitted(self) -> dict[Slot, FrameBody]:
        """What the bodies were drawn from, the one being corrected last."""
        return {side: body for side in sorted(self.bodies) if (body := self.shown.body(side)) is not None}

    @property
    def key(self) -> Hashable:
        """Equal if all but the image and other people is."""
        return self.state, self.edits, self.shown.version, tuple(self.bodies), self.room, self.side


@dataclass(frozen=True, kw_only=True, eq=False)
class Beside:
    """What another view shows of the moment."""

    view: ProjectView
    frame: int | None
    """Its own, from its first; None: it was not filmed then."""
    image: bytes | None


class Frames:
    """Works out the frames of one tab.

    Args:
        tab: the tab.
        rings: returns those that turn a joint in 3D, if any.
    """

    def __init__(self, tab: Tab, rings: Callable[[OnShow], Rings | None]) -> None:
        self._tab, self._data, self._rings = tab, tab.data, rings
        self._room: Room | None = None
        """Of the fit on show, in the first frame."""

    def of(self, shown: OnShow) -> Frame | None:
        """The frame on show; None while its image is being decoded."""
        tab, state, data = self._tab, self._tab.state, self._data
        video, flat = data.video, state.side and state.mode != "space"
        if (image := self._image(video, lambda frame: tab.first_frame + frame)) is None:
            return None
        view = tab.view if flat else None
        beside = None if view is None else self._beside(view)
        if beside is not None and beside.frame is not None and beside.image is None:
            return None
        plate = state.side and flat and view is None
        edits = tab.session.project.keypoints_version
        present = tab.once("present", (edits, shown.frame), lambda: data.present(shown.frame))
        bodies, problem = self._bodies(shown, present, hidden=plate or not flat)
        if bodies and shown.held is not None:  # without bodies the model may be missing, which is reported
            self._room = data.room(shown.held, shown.held) or self._room
        room, camera, frame = self._room, shown.camera, shown.frame
        return Frame(
            state=state,
            shown=shown,
            edits=edits,
            unseen=() if present is None else unseen_keypoints(present),
            image=image,
            bodies=bodies,
            problem=problem,
            others=self._others(),
            room=room and tab.once("room", (room, camera, frame), lambda: room.before(camera, frame)),
            side=self._side_view(shown) if view is None else self._camera(view.view, shown),
            beside=beside,
            arrangement=tab.arrangement,
            labels=tuple(
                _label(shown, side, present, lettered=state.comparing)
                for place in shown.places
                for side in place or (None,)
            ),
            rings=self._rings(shown) if state.mode == "space" and state.bodies and bodies else None,
        )

    def moved(self, frame: Frame, shown: OnShow) -> Frame | None:
        """A frame whose bodies a drag has changed; None if anything else has changed, or a body cannot be drawn."""
        if frame.state is not self._tab.state or shown.stored != frame.shown.stored:
            return None
        bodies: dict[Slot, BodyLayer] = {}
        for side, layer in frame.bodies.items():
            body = shown.body(side)
            assert body is not None
            vertices = self._data.vertices(body)
            bodies[side] = replace(layer, vertices=vertices, values=self._distances(shown, side, vertices))
        if any(layer.problem for layer in bodies.values()):
            return None
        return replace(frame, shown=shown, bodies=bodies, rings=frame.rings and self._rings(shown))

    def _image(self, video: VideoFrames, number: Callable[[int], int | None]) -> bytes | None:
        """A video's picture of the frame on show; the previous one while a paused frame is being decoded.

        Args:
            video: Where it is from.
            number: The video's frame for each of the clip, if it has one.
        """
        tab, state = self._tab, self._tab.state
        if (now := number(state.frame)) is None:
            return None
        if state.playing:
            frames = map(number, coming(state.frame, tab.played, _AHEAD, loop=state.loop))
            video.prefetch([now, *(frame for frame in frames if frame is not None)], reader=tab)
            return video.get(now, "playing")
        return video.nearest(now)

    def _beside(self, view: ProjectView) -> Beside:
        """What another view shows; without an image while it is being decoded."""
        tab, clip = self._tab, view.view.clip

        def number(frame: int) -> int | None:
            found = tab.frame_in(view, frame)
            return None if found is None else clip.first_frame + found

        image = self._image(self._data.video_of(clip), number)
        return Beside(view=view, frame=tab.frame_in(view, tab.state.frame), image=image)

    def _camera(self, view: OtherView, shown: OnShow) -> OtherCamera:
        """Another view's, relative to that of the fit on show."""
        fit = shown.held
        scale = 1.0 if fit is None else self._data.view_scale(view, fit)
        return self._tab.once("other camera", (view, scale), lambda: other_camera(view, scale))

    def _bodies(self, shown: OnShow, present: Present, *, hidden: bool) -> tuple[dict[Slot, BodyLayer], str]:
        """The bodies on show that can be drawn, and why another one cannot.

        Args:
            shown: The fits.
            present: Of the frame.
            hidden: Keypoints of bodies are shown even if the bodies are not.
        """
        if self._data.warming or not (self._tab.state.bodies or hidden):
            return {}, ""
        there: list[Slot] = [side for place in shown.places for side in place if shown.body(side) is not None]
        try:
            bodies: dict[Slot, BodyLayer] = {side: self._body(shown, side, present) for side in there}
        except InputError as error:
            return {}, str(error)
        problems = [body.problem for body in bodies.values() if body.problem]
        return {side: body for side, body in bodies.items() if not body.problem}, problems[-1] if problems else ""

    def _body(self, shown: OnShow, side: Slot, present: Present) -> BodyLayer:
        state, data, body = self._tab.state, self._data, shown.body(side)
        assert body is not None
        vertices, meshes = data.vertices(body), data.meshes(body.shown)
        return BodyLayer(
            vertices=vertices,
            faces=meshes.faces,
            color=rgb(SLOT_COLORS[side]),
            camera=body.shown.camera,
            opacity=state.opacity,
            opacities=None if present is None else meshes.opacities(seen_joints(present)),
            outline=state.outline,
            values=self._distances(shown, side, vertices),
        )

    def _distances(self, shown: OnShow, side: Slot, vertices: Vertices) -> Float[np.ndarray, "V"] | None:
        """Metres between each vertex of a body and the other fit's, if they are drawn."""
        other = shown.body(_OTHER[side]) if self._tab.state.difference else None
        if other is None or (theirs := self._data.vertices(other)).shape != vertices.shape:
            return None
        key = shown.version  # sent once for the same bodies
        return self._tab.once(f"distances {side}", key, lambda: vertex_distances(vertices, theirs) / 1e3)

    def _side_view(self, shown: OnShow) -> SideView | None:
        state, fit = self._tab.state, shown.held
        if not state.side or state.mode == "space" or fit is None:
            return None
        camera, frame = fit.camera, shown.frame
        tab, room, direction, width = self._tab, self._room or UNKNOWN, self._tab.direction, self._tab.side_width
        key = room, camera, direction, width
        view = tab.once("side view", key, lambda: side_view(room, camera, direction, width))
        return tab.once("side view of the frame", (view, frame), lambda: view.before(camera, frame))

    # --- other people ---

    def _others(self) -> tuple[Other, ...]:
        """The clip's other people: their newest fits, dimmed."""
        tab = self._tab
        if not (tab.someone.others and tab.state.others and tab.state.bodies) or self._data.warming:
            return ()
        found = (self._other(someone) for someone in tab.someone.others[:MOST_OTHERS])
        return tuple(one for one in found if one is not None and one.layer.problem is None)

    def _other(self, someone: ReviewedPerson) -> Other | None:
        """A person's newest fit; None without one, or without its body model."""
        state = self._tab.state
        frame = someone.frame_of(state.frame + self._tab.first_frame)
        try:
            fit = None if frame is None else someone.session.stored.show(FitChoice())
            if frame is None or fit is None or not fit.has(frame):
                return None
            body = FrameBody(shown=fit, frame=frame, live=live_window(someone.session, fit, frame))
            vertices, faces = someone.data.vertices(body), someone.data.meshes(fit).faces
        except InputError:  # reported when their page is opened
            return None
        layer = BodyLayer(
            vertices=vertices,
            faces=faces,
            color=rgb("beside"),
            camera=fit.camera,
            opacity=min(state.opacity, OTHER_OPACITY),
            outline=state.outline,
        )
        return Other(someone=someone, body=body, layer=layer)


def _label(shown: OnShow, side: Slot | None, present: Present, *, lettered: bool) -> tuple[str, Color | None]:
    """Name and colour of a fit; of the video for no side."""
    if side is None:
        return "Video", None
    fit = shown.fit(side)
    if fit is None:
        title = "no fit yet"
    elif not fit.has(shown.frame):
        title = f"{shown.title(side)}: {'not fitted yet' if fit.result is None else 'no pose in this frame'}"
    else:
        title = shown.title(side) + ("" if present is None or present.any() else ": no keypoints here")
    return f"{side.upper()}   {title}" if lettered else title, SLOT_COLORS[side]
