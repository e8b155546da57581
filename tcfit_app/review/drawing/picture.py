"""The middle of one tab: video, bodies and keypoints of the frame on show."""

from collections.abc import Hashable

import numpy as np
from jaxtyping import Float

from fitting_core.camera import Camera
from fitting_core.errors import InputError
from tcfit_app.analysis.curves import vertex_distances
from tcfit_app.fitting.fits import Shown
from tcfit_app.review.browser.page_states import Keypoints, Layout, Legend, Style, pixel_pairs, shares
from tcfit_app.review.browser.page_states import Poster as PosterPlace
from tcfit_app.review.scene.layers import DISTANCE_LIMIT, RGB, RUN_COLORS, BodyLayer, FrameImage, color_table, css
from tcfit_app.review.scene.poster import PLATE, Poster, Posters, poster_places
from tcfit_app.review.scene.space import Space, extent
from tcfit_app.review.shared.desk import Drawn
from tcfit_app.review.tab.on_show import SIDES, OnShow, Side
from tcfit_app.review.tab.playback import coming
from tcfit_app.review.tab.tab import Tab

_AHEAD = 24
"""Frames that are decoded before they are played."""
_LEGEND_COLORS = 9
_LEGEND_HEIGHT = 34.0
"""CSS pixels that posters leave free for the colour bar below them."""
_SAMPLED = 120
"""Frames of a clip, at most, whose whole bodies the 3D camera is fitted to: 0.1 s."""
_COLORS: dict[Side, RGB] = dict(zip(SIDES, RUN_COLORS, strict=True))
_OTHER: dict[Side, Side] = {"a": "b", "b": "a"}


class Picture:
    """Draws one tab's picture; asked again and again, it sends what changed."""

    def __init__(self, tab: Tab) -> None:
        self._tab, self._desk = tab, tab.desk
        self._size = (0, 0)
        self._image: FrameImage | None = None
        self._layers: dict[Hashable, BodyLayer] = {}
        self._compared = False
        """Whether colours tell how far A and B lie apart."""
        self.problem = ""
        """What cannot be shown, and why; empty if nothing is wrong."""

    def resized(self, width: int, height: int) -> None:
        """The canvas has another size, in CSS pixels."""
        self._size = (width, height)

    def draw(self) -> bool:
        """Send what changed; False if the frame is not decoded yet, and then nothing was sent."""
        tab, shown = self._tab, self._tab.shown
        image = self._frame_image()
        if image is None:
            return False
        self.problem = ""
        bodies = self._bodies(shown)
        self._compared = any(body.values is not None for body in bodies.values())
        with tab.client.atomic():
            self._draw_scene(image, shown, bodies)
            self._draw_keypoints()
        if tab.sent.differs("flushed", shown.frame, shown.revision):
            tab.client.flush()  # viser would wait 16 ms for more
        if tab.sent.differs("legend", self._compared):
            tab.channel.send("legend", LEGEND if self._compared else None)
        return True

    def _frame_image(self) -> FrameImage | None:
        """The video's frame, the last one while a paused one is still to come."""
        tab, state, video = self._tab, self._tab.state, self._desk.video
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

    def _bodies(self, shown: OnShow) -> dict[Side, BodyLayer]:
        """The bodies that are drawn."""
        if self._desk.warming or not self._tab.state.bodies:
            return {}
        sides: list[Side] = [side for place in shown.places for side in place]
        try:
            return {side: self._body(shown, side, fit) for side in sides if (fit := shown.fit(side)) is not None}
        except InputError as error:
            self.problem = str(error)
            return {}

    def _body(self, shown: OnShow, side: Side, fit: Shown) -> BodyLayer:
        state, desk = self._tab.state, self._desk
        drawn = desk.body(fit, shown.frame, shown.live_of(side))
        compared = self._compared_with(shown, _OTHER[side], drawn) if state.difference else None
        look = (_COLORS[side], state.opacity, state.wireframe, compared.version if compared else None)
        key = (drawn.version, fit.camera, *look)
        if key not in self._layers:
            values = None if compared is None else vertex_distances(drawn.vertices, compared.vertices) / 1e3
            if len(self._layers) > 4:
                self._layers.clear()
            self._layers[key] = BodyLayer(
                vertices=drawn.vertices,
                faces=desk.meshes(fit).faces,
                color=_COLORS[side],
                camera=fit.camera,
                opacity=state.opacity,
                wireframe=state.wireframe,
                values=values,
            )
        return self._layers[key]

    def _compared_with(self, shown: OnShow, other: Side, drawn: Drawn) -> Drawn | None:
        """The other side's body, if it has the same vertices."""
        fit = shown.fit(other)
        found = None if fit is None else self._desk.body(fit, shown.frame, shown.live_of(other))
        return found if found is not None and found.vertices.shape == drawn.vertices.shape else None

    # --- the scene ---

    def _draw_scene(self, image: FrameImage, shown: OnShow, bodies: dict[Side, BodyLayer]) -> None:
        tab, mode = self._tab, self._tab.state.mode
        layers = [tuple(bodies[side] for side in place if side in bodies) for place in shown.places]
        clip = tab.session.project.clip.camera
        if mode == "space":
            self._show(self._space(image, shown, layers[0]))
        else:
            self._show(Posters(camera=clip, posters=tuple(Poster(image=image, bodies=made) for made in layers)))
        labels = tuple((self._label(shown, side), css(_COLORS[side])) for place in shown.places for side in place)
        if tab.sent.differs("layout", mode, labels):
            tab.channel.send("layout", _layout(clip, labels, flat=mode != "space"))

    def _space(self, image: FrameImage, shown: OnShow, layers: tuple[BodyLayer, ...]) -> Space:
        there = [fit for fit in (shown.a, shown.b) if fit is not None]
        return Space(
            camera=shown.camera,
            bodies=layers,
            extents=tuple(map(self._extent, there)) if layers else (),
            image=image,
            ground=None if shown.b is None else self._desk.ground(shown.b),
            apart=self._tab.state.apart,
        )

    def _extent(self, fit: Shown) -> Float[np.ndarray, "2 3"] | None:
        """Where a fit's body is in the clip; None while that is made."""
        meshes, step = self._desk.meshes(fit), -(-len(fit.params) // _SAMPLED)
        key = ("extent", fit.run.id, fit.phase, fit.revision)
        return self._desk.tasks.get(key, lambda: extent(meshes.batch(fit.params[::step])))

    def _show(self, snapshot: Posters | Space) -> None:
        covered = _LEGEND_HEIGHT if self._compared and isinstance(snapshot, Posters) else 0.0
        scene = self._tab.scene
        scene.cameras.follow(self._size if self._size[0] else None, covered)
        for problem in scene.show(snapshot):
            self.problem = problem

    @staticmethod
    def _label(shown: OnShow, side: Side) -> str:
        fit = shown.fit(side)
        return f"{side.upper()}   {'no fit yet' if fit is None else fit.title}"

    def _draw_keypoints(self) -> None:
        tab, state = self._tab, self._tab.state
        session = tab.session
        style = Style(
            groups=tuple(sorted(state.groups)),
            color_by=state.color_by,
            points=state.keypoints,
            bones=state.keypoints and state.bones,
            minimum=state.minimum,
            ghosts=state.detections,
        )
        if tab.sent.differs("style", style):
            tab.channel.send("style", style)
        if not tab.sent.differs("keypoints", state.frame, session.edits):
            return
        corrected, detections, frame = session.project.corrected, session.project.detections, state.frame
        edited = np.flatnonzero(corrected.edited[frame])
        detected = [int(j) for j in edited if detections.confidence[frame, j] > 0]
        keypoints = Keypoints(
            frame=frame,
            xy=pixel_pairs(corrected.xy[frame]),
            confidence=shares(corrected.confidence[frame]),
            bad=tuple(np.flatnonzero(corrected.bad[frame]).tolist()),
            edited=tuple(edited.tolist()),
            detections=tuple((j, *pixel_pairs(detections.xy[frame, [j]])[0]) for j in detected),
        )
        tab.channel.send("keypoints", keypoints)


def _layout(clip: Camera, labels: tuple[tuple[str, str], ...], *, flat: bool) -> Layout:
    """Where the posters are, or that there is a room, and what they are called."""
    places = poster_places(len(labels), clip.size) if flat else (0.0,) * len(labels)
    posters = tuple(PosterPlace(x=x, label=label, color=c) for x, (label, c) in zip(places, labels, strict=True))
    return Layout(mode="poster", image=clip.size, posters=posters) if flat else Layout(mode="space", posters=posters)


_SHADES = color_table()[np.linspace(0, 255, _LEGEND_COLORS).astype(int)].tolist()
LEGEND = Legend(
    title="Distance between A and B",
    unit="mm",
    low=0.0,
    high=1e3 * DISTANCE_LIMIT,
    colors=tuple(css((r, g, b)) for r, g, b in _SHADES),
)
