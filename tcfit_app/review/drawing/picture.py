"""The canvas of one tab: video, bodies and keypoints of the frame on show."""

from collections.abc import Callable, Hashable

import numpy as np
from jaxtyping import Bool

from fitting_core.errors import InputError
from fitting_core.keypoints import BODY
from tcfit_app.analysis.curves import vertex_distances
from tcfit_app.analysis.seen import seen_joints
from tcfit_app.fitting.fits import Shown
from tcfit_app.review.browser.page_states import Keypoints, Layout, Legend, Style, pixel_pairs, shares, triple
from tcfit_app.review.browser.page_states import Poster as PosterPlace
from tcfit_app.review.browser.page_states import Space as SpaceState
from tcfit_app.review.drawing.around import AroundPart
from tcfit_app.review.drawing.found import FoundPart
from tcfit_app.review.drawing.joints import JointsPart
from tcfit_app.review.drawing.others import OthersPart
from tcfit_app.review.drawing.side import SidePart
from tcfit_app.review.drawing.silhouette import SilhouettePart
from tcfit_app.review.drawing.status import lasting
from tcfit_app.review.scene.layers import DISTANCE_LIMIT, RGB, RUN_COLORS, BodyLayer, FrameImage, color_table, css
from tcfit_app.review.scene.poses import Window
from tcfit_app.review.scene.poster import PICTURE_NODES, PLATE, SIDE_NODE, Poster, Posters, body_nodes
from tcfit_app.review.scene.rings import Rings
from tcfit_app.review.scene.room import Room
from tcfit_app.review.scene.side_view import direction_text
from tcfit_app.review.scene.space import Space, offsets
from tcfit_app.review.shared.drawing_data import Drawn
from tcfit_app.review.tab.on_show import SLOTS, OnShow, Slot
from tcfit_app.review.tab.playback import coming
from tcfit_app.review.tab.tab import Tab

_AHEAD = 24
"""Frames decoded ahead of playback."""
_LEGEND_COLORS = 9
_BELOW = 34.0
"""CSS pixels below the posters kept free for the colour bar, and for messages that last."""
_APART = 1.2
"""Metres between A and B side by side in 3D: two bodies with outstretched arms do not touch."""
_PLAIN_COLOR = "#8a94a3"
"""Colour of the names that are not those of fits."""
_COLORS: dict[Slot, RGB] = dict(zip(SLOTS, RUN_COLORS, strict=True))
_OTHER: dict[Slot, Slot] = {"a": "b", "b": "a"}


class Picture:
    """Draws one tab's picture; called repeatedly, it sends only changes."""

    def __init__(self, tab: Tab, rings: Callable[[OnShow], Rings | None]) -> None:
        """For a tab; `rings` says where those are that turn a joint in 3D."""
        self._tab, self._data, self._rings = tab, tab.data, rings
        self._size = (0, 0)
        self._image: FrameImage | None = None
        self._side, self._joints, self._around = SidePart(tab), JointsPart(tab), AroundPart(tab)
        self._others, self._found, self._silhouette = OthersPart(tab), FoundPart(tab), SilhouettePart(tab)
        self._room: Room | None = None
        """Of the fit on show; the previous one while another is computed."""
        self._layers: dict[Hashable, BodyLayer] = {}
        self._compared = False
        """Whether colours show the distance between A and B."""
        self.problem = ""
        """What cannot be shown, and why; empty if all can."""

    def resized(self, width: int, height: int) -> None:
        """The canvas was resized, in CSS pixels."""
        self._size = (width, height)

    def draw(self) -> bool:
        """Send what changed; False if the frame is not decoded yet, and nothing was sent."""
        tab, shown = self._tab, self._tab.shown
        image = self._frame_image()
        if image is None:
            return False
        self.problem = ""
        bodies = self._bodies(shown)
        self._compared = self._tab.state.bodies and any(body.values is not None for body in bodies.values())
        with tab.client.atomic():
            self._draw_scene(image, shown, bodies)
            self._around.draw(shown)
            self._draw_keypoints()
        tab.once("flushed", (shown.frame, shown.revision), tab.client.flush)  # viser would wait 16 ms for more
        tab.channel.send("legend", LEGEND if self._compared else None)
        return True

    def _frame_image(self) -> FrameImage | None:
        """The video frame; the previous one while a paused frame is being decoded."""
        tab, state, video = self._tab, self._tab.state, self._data.video
        if not state.video:
            return PLATE
        if state.playing:
            frames = coming(state.frame, tab.played, _AHEAD, loop=state.loop)
            video.prefetch([state.frame, *frames], reader=tab)
            data = video.get(state.frame, "playing")
        else:
            data = video.nearest(state.frame)
        if data is None:
            return None
        if self._image is None or self._image.data is not data:
            self._image = FrameImage(data=data)
        return self._image

    # --- bodies ---

    def _bodies(self, shown: OnShow) -> dict[Slot, BodyLayer]:
        """The bodies on show; if they are hidden, those whose keypoints the side view or 3D shows."""
        state = self._tab.state
        if self._data.warming or not (state.bodies or self._side.wanted(shown) or state.mode == "space"):
            return {}
        sides: list[Slot] = [side for place in shown.places for side in place]
        try:
            return {side: self._body(shown, side, fit) for side in sides if (fit := shown.with_body(side)) is not None}
        except InputError as error:
            self.problem = str(error)
            return {}

    def _body(self, shown: OnShow, side: Slot, fit: Shown) -> BodyLayer:
        state, data = self._tab.state, self._data
        drawn = data.body(fit, shown.frame, shown.live_of(side))
        compared = self._compared_with(shown, _OTHER[side], drawn) if state.difference else None
        present = self._present(shown.frame)
        opacities = None if present is None else data.meshes(fit).opacities(seen_joints(present))
        against = compared.version if compared else None
        look = (_COLORS[side], state.opacity, state.outline, against, id(opacities))
        key = (drawn.version, fit.camera, *look)
        if key not in self._layers:
            values = None if compared is None else vertex_distances(drawn.vertices, compared.vertices) / 1e3
            if len(self._layers) > 4:
                self._layers.clear()
            self._layers[key] = BodyLayer(
                vertices=drawn.vertices,
                faces=data.meshes(fit).faces,
                color=_COLORS[side],
                camera=fit.camera,
                opacity=state.opacity,
                opacities=opacities,
                outline=state.outline,
                values=values,
            )
        return self._layers[key]

    def _present(self, frame: int) -> Bool[np.ndarray, "137"] | None:
        key = frame, self._tab.session.project.keypoints_version
        return self._tab.once("present", key, lambda: self._data.present(frame))

    def _seen(self, frame: int) -> bool:
        present = self._present(frame)
        return present is None or bool(present.any())

    def _compared_with(self, shown: OnShow, other: Slot, drawn: Drawn) -> Drawn | None:
        """The other side's body, if it has the same topology."""
        fit = shown.with_body(other)
        found = None if fit is None else self._data.body(fit, shown.frame, shown.live_of(other))
        return found if found is not None and found.vertices.shape == drawn.vertices.shape else None

    # --- the scene ---

    def _draw_scene(self, image: FrameImage, shown: OnShow, bodies: dict[Slot, BodyLayer]) -> None:
        tab, mode = self._tab, self._tab.state.mode
        if bodies and shown.held is not None:  # without bodies the model may be missing, which is reported
            self._room = self._data.room(shown.held, shown.held) or self._room
        room = None if self._room is None else self._before(shown, self._room)
        self._joints.tell(shown, bodies, room)
        drawn, others = bodies if tab.state.bodies else {}, self._others.layers()
        layers = [tuple(drawn[side] for side in place if side in drawn) for place in shown.places]
        labels = tuple(
            (self._label(shown, side), css(_COLORS[side])) if side else ("Video", _PLAIN_COLOR)
            for place in shown.places
            for side in place or (None,)
        )
        if mode == "space":
            self._show(space := self._space(image, shown, layers[0], others, room))
            self._tell_space(space, bodies)
            places = tuple(PosterPlace(width=0.0, label=label, color=color) for label, color in labels)
            tab.channel.send("layout", Layout(mode="space", posters=places))
            return
        side = self._side.poster(shown, drawn, others, self._room) if self._side.wanted(shown) else None
        posters = tuple(
            Poster(image=image, bodies=made, others=others) if place else Poster(image=image, plain=True)
            for place, made in zip(shown.places, layers, strict=True)
        )
        snapshot = Posters(
            camera=tab.session.project.footage.camera, posters=posters, side=side, arrangement=tab.arrangement
        )
        self._show(snapshot)
        named = labels if side is None else (*labels, (direction_text(tab.state.side_from), _PLAIN_COLOR))
        tab.channel.send("layout", poster_layout(snapshot, named, tab.scene.cameras.window, clipped=tab.clipped))
        if side is not None:
            self._side.tell(shown, side.view, bodies if self._room is not None else {})

    def _before(self, shown: OnShow, room: Room) -> Room:
        """The room relative to the camera of the frame on show; the same object while it is unchanged."""
        camera, frame = shown.camera, shown.frame
        return self._tab.once("room", (room, camera, frame), lambda: room.before(camera, frame))

    def _space(
        self,
        image: FrameImage,
        shown: OnShow,
        layers: tuple[BodyLayer, ...],
        others: tuple[BodyLayer, ...],
        room: Room | None,
    ) -> Space:
        there = [fit for side in shown.places[0] if (fit := shown.with_body(side)) is not None] if layers else []
        rooms = [self._data.room(fit, shown.held or fit) for fit in there]
        return Space(
            camera=shown.camera,
            bodies=layers,
            others=others,
            others_extents=self._others.extents(shown),
            extents=tuple(None if room is None else room.extent for room in rooms),
            image=image,
            turn=np.eye(3) if room is None else room.turn,
            place=np.zeros(3) if room is None else room.place,
            ground=None if room is None else room.floor,
            apart=_APART if self._tab.state.beside == "apart" else 0.0,
            ghost=self._tab.state.beside == "ghost" and len(layers) == len(SLOTS),
            rings=self._rings(shown) if layers and "b" in shown.places[0] else None,
        )

    def _tell_space(self, space: Space, bodies: dict[Slot, BodyLayer]) -> None:
        count = sum(body.problem is None for body in bodies.values())
        x, y, z = (triple(row) for row in space.turn)
        state = SpaceState(turn=(x, y, z), place=triple(space.place), offsets=offsets(count, space.apart))
        self._tab.channel.send("space", state)

    def _show(self, snapshot: Posters | Space) -> None:
        below = isinstance(snapshot, Posters) and (self._compared or lasting(self._tab))
        covered = _BELOW if below else 0.0
        scene = self._tab.scene
        scene.cameras.follow(self._size if self._size[0] else None, covered)
        for problem in scene.show(snapshot):
            self.problem = problem

    def _label(self, shown: OnShow, side: Slot) -> str:
        fit = shown.fit(side)
        if fit is None:
            title = "no fit yet"
        elif not fit.has(shown.frame):
            title = f"{fit.title}: {'not fitted yet' if fit.result is None else 'no pose in this frame'}"
        else:
            title = fit.title if self._seen(shown.frame) else f"{fit.title}: no keypoints here"
        return f"{side.upper()}   {title}"

    def _draw_keypoints(self) -> None:
        tab, state, project = self._tab, self._tab.state, self._tab.session.project
        style = Style(
            groups=tuple(sorted(state.groups)),
            color_by=state.color_by,
            points=state.keypoints,
            bones=state.keypoints and state.bones,
            minimum=state.minimum,
            ghosts=state.detections,
            hand_along=state.hand_along,
            error_bars=state.error_bars,
        )
        tab.channel.send("style", style)
        self._found.draw()
        self._silhouette.draw()
        if project.has_detections:
            key = state.frame, project.keypoints_version
            tab.channel.send("keypoints", tab.once("keypoints", key, self._keypoints))

    def _keypoints(self) -> Keypoints:
        """Corrected keypoints of the frame on show."""
        project, frame = self._tab.session.project, self._tab.state.frame
        corrected, found = project.corrected, project.detected
        here, ignored = corrected[frame], corrected[[frame]].keypoints().overruled[0]
        edited = np.flatnonzero(here.edited)
        detected = [int(j) for j in edited if found.confidence[frame, j] > 0]
        return Keypoints(
            frame=frame,
            xy=pixel_pairs(corrected.xy[frame]),
            confidence=shares(corrected.confidence[frame]),
            bad=tuple(np.flatnonzero(here.bad).tolist()),
            edited=tuple(edited.tolist()),
            pinned=tuple(np.flatnonzero(here.pinned).tolist()),
            locked=tuple(np.flatnonzero(here.locked[BODY]).tolist()),
            deep=tuple(np.flatnonzero(np.isfinite(here.told_depth) & ~here.pinned).tolist()),
            ignored=tuple(np.flatnonzero(ignored).tolist()),
            detections=tuple((j, *pixel_pairs(found.xy[frame, [j]])[0]) for j in detected),
        )


def poster_layout(snapshot: Posters, named: tuple[tuple[str, str], ...], canvas: Window, *, clipped: bool) -> Layout:
    """The positions and labels of the posters."""
    division = snapshot.divide(canvas)
    pictures = len(snapshot.posters)
    nodes = (*PICTURE_NODES[:pictures], SIDE_NODE)
    posters = tuple(
        PosterPlace(
            node=node,
            bodies=body_nodes(node),
            window=(left / canvas.width, top / canvas.height, right / canvas.width, bottom / canvas.height),
            width=snapshot.width if snapshot.side is None or i < pictures else snapshot.side.view.width,
            kind="side" if i >= pictures else "video" if snapshot.posters[i].plain else "picture",
            clipped=clipped or i >= pictures,
            label=label,
            color=color,
        )
        for i, (node, (left, top, right, bottom), (label, color)) in enumerate(
            zip(nodes, division.windows, named, strict=False)
        )
    )
    wipe = pictures == 2 and division.arrangement == "wipe"
    return Layout(mode="poster", image=snapshot.camera.size, posters=posters, wipe=wipe)


_SHADES = color_table()[np.linspace(0, 255, _LEGEND_COLORS).astype(int)].tolist()
LEGEND = Legend(
    title="Distance between A and B",
    unit="mm",
    low=0.0,
    high=1e3 * DISTANCE_LIMIT,
    colors=tuple(css((r, g, b)) for r, g, b in _SHADES),
)
