"""The middle of one tab: video, bodies and keypoints of the frame on show."""

from collections.abc import Hashable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from fitting_core.errors import InputError
from tcfit_app.analysis.between_runs import vertex_distances
from tcfit_app.fitting.fits import FitChoice, Shown
from tcfit_app.review.browser.page_states import Keypoints, Layout, Legend, Style, pixel_pairs, shares
from tcfit_app.review.browser.page_states import Poster as PosterPlace
from tcfit_app.review.gestures.playback import coming
from tcfit_app.review.scene.layers import DISTANCE_LIMIT, RUN_COLORS, BodyLayer, FrameImage, color_table, css
from tcfit_app.review.scene.poster import Poster, Posters, poster_places
from tcfit_app.review.scene.scene import SceneView
from tcfit_app.review.scene.space import Space, extent

if TYPE_CHECKING:
    from tcfit_app.review.page import Page

_AHEAD = 24
"""Frames that are decoded before they are played."""
_LEGEND_COLORS = 9
_LEGEND_HEIGHT = 34.0
"""CSS pixels that posters leave free for the colour bar below them."""
_SAMPLED = 120
"""Frames of a clip, at most, whose whole bodies the 3D camera is fitted to: 0.1 s."""
_LEAST_MARGIN, _MARGIN = 1 / 12, 1 / 4
"""Around keypoints that are zoomed to: of the image's diagonal at least, and of their own extent."""


class Picture:
    """Draws one page's picture; asked again and again, it sends what changed."""

    def __init__(self, page: "Page") -> None:
        self._page, self._desk = page, page.desk
        self._view = SceneView(page.client, strip_height=0)  # the timeline lies below the canvas
        self._size = (0, 0)
        self._image: FrameImage | None = None
        self._layers: dict[Hashable, BodyLayer] = {}
        self._compared = False
        """Whether colours tell how far A and B lie apart."""

    def resized(self, width: int, height: int) -> None:
        """The canvas has another size, in CSS pixels."""
        self._size = (width, height)

    def touched(self) -> None:
        """The user moves the camera: it is the user's until it is reset."""
        self._view.cameras.touched()

    def reset_camera(self) -> None:
        """Show the whole picture again."""
        self._view.reset_view()

    def zoom_to_selection(self) -> None:
        """Zoom to the selected keypoints. Raises InputError without any that are in the picture."""
        page = self._page
        if not page.state.selection or page.state.mode == "space":
            raise InputError("Select keypoints in Edit or A | B first: the view then zooms to them.")
        chosen = page.session.project.corrected.at((page.state.frame,), tuple(page.state.selection))
        # Undetected ones lie at (0, 0), and so do copies of them.
        xy = chosen.xy[(chosen.confidence > 0) | (chosen.edited & chosen.xy.any(-1))]
        if not len(xy):
            raise InputError("None of the selected keypoints was detected in this frame: there is nothing to zoom to.")
        low, high = _surroundings(xy, page.session.project.clip.camera.size)
        self._view.zoom_to((*low.tolist(), *high.tolist()))

    def draw(self) -> bool:
        """Send what changed; False if the frame is not decoded yet, and then nothing was sent."""
        page, state = self._page, self._page.state
        image = self._frame_image()
        if image is None:
            return False
        a, b = page.fit(state.a), page.fit(state.b)
        try:
            bodies = [] if self._desk.warming else self._bodies(a, b)
        except InputError as error:
            page.status.problem = str(error)
            bodies = []
        self._compared = any(body.values is not None for place in bodies for body in place)
        with page.client.atomic():
            self._draw_scene(image, bodies, a, b)
            self._draw_keypoints()
        live = page.session.following.live
        if page.changes.of("flushed", state.frame, live and live.revision):
            page.client.flush()  # viser would wait 16 ms for more
        self._draw_legend()
        return True

    def _frame_image(self) -> FrameImage | None:
        """The video's frame, the last one while a paused one is still to come."""
        state, video = self._page.state, self._desk.video
        if not state.video:
            return PLAIN
        if state.playing:
            frames = coming(state.frame, self._page.played, _AHEAD, loop=state.loop)
            video.prefetch([state.frame, *frames], reader=self._page)
            data = video.get(state.frame, "playing")
        else:
            data = video.nearest(state.frame)
        if data is None:
            return None
        if self._image is None or self._image.data is not data:
            self._image = FrameImage(data=data)
        return self._image

    def _bodies(self, a: Shown | None, b: Shown | None) -> list[tuple[BodyLayer, ...]]:
        """For each poster, or for the room, its bodies."""
        state = self._page.state
        if not state.bodies:
            return [()] * (2 if state.mode == "ab" else 1)
        if state.mode == "edit":
            shown, color = (a, RUN_COLORS[0]) if state.blinked else (b, RUN_COLORS[1])
            return [self._body(shown, color, b if state.blinked else a)]
        layers = [self._body(a, RUN_COLORS[0], b), self._body(b, RUN_COLORS[1], a)]
        if state.mode == "space":
            return [layers[0] + layers[1]]
        return [layers[1], layers[0]] if state.blinked else layers

    def _body(self, shown: Shown | None, color: tuple[int, int, int], other: Shown | None) -> tuple[BodyLayer, ...]:
        if shown is None:
            return ()
        state, desk = self._page.state, self._desk
        drawn = desk.body(shown, state.frame)
        compared = desk.body(other, state.frame) if state.difference and other is not None else None
        if compared is not None and compared.vertices.shape != drawn.vertices.shape:
            compared = None
        look = (color, state.opacity, state.wireframe, compared.version if compared else None)
        key = (drawn.version, shown.camera, *look)
        if key not in self._layers:
            values = None if compared is None else vertex_distances(drawn.vertices, compared.vertices) / 1e3
            if len(self._layers) > 4:
                self._layers.clear()
            self._layers[key] = BodyLayer(
                vertices=drawn.vertices,
                faces=desk.meshes(shown).faces,
                color=color,
                camera=shown.camera,
                opacity=state.opacity,
                wireframe=state.wireframe,
                values=values,
            )
        return (self._layers[key],)

    def _draw_scene(
        self, image: FrameImage, bodies: list[tuple[BodyLayer, ...]], a: Shown | None, b: Shown | None
    ) -> None:
        page, state = self._page, self._page.state
        camera = page.session.project.clip.camera
        if state.mode == "space":
            camera = next((shown.camera for shown in (b, a) if shown is not None), camera)
            ground = self._desk.ground(b) if b is not None else None
            both = bodies[0] if bodies else ()
            extents = tuple(self._extent(shown) for shown in (a, b) if shown is not None) if both else ()
            space = Space(camera=camera, bodies=both, extents=extents, image=image, ground=ground, apart=state.apart)
            self._show(space)
            labels = self._labels(a, b)
            if page.changes.of("layout", "space", labels):
                page.channel.send("layout", Layout(mode="space", posters=_places((0.0,) * len(labels), labels)))
            return
        count = 2 if state.mode == "ab" else 1
        posters = [Poster(image=image, bodies=bodies[i] if bodies else ()) for i in range(count)]
        self._show(Posters(camera=camera, posters=tuple(posters)))
        labels = self._labels(a, b)
        if page.changes.of("layout", state.mode, labels):
            places = _places(poster_places(count, camera.size), labels)
            page.channel.send("layout", Layout(mode="poster", image=camera.size, posters=places))

    def _extent(self, shown: Shown) -> Float[np.ndarray, "2 3"] | None:
        """Where a fit's body is in the clip; None while that is made."""
        meshes, step = self._desk.meshes(shown), -(-len(shown.params) // _SAMPLED)
        key = ("extent", shown.run.id, shown.phase, shown.revision)
        return self._desk.tasks.get(key, lambda: extent(meshes.batch(shown.params[::step])))

    def _show(self, snapshot: Posters | Space) -> None:
        covered = _LEGEND_HEIGHT if self._compared and isinstance(snapshot, Posters) else 0.0
        self._view.follow(self._size if self._size[0] else None, covered)
        for problem in self._view.show(snapshot):
            self._page.status.problem = problem

    def _labels(self, a: Shown | None, b: Shown | None) -> tuple[tuple[str, str], ...]:
        """Label and colour of each poster, or of each body in space."""
        state = self._page.state
        both = [(_label(a, "A", state.a), css(RUN_COLORS[0])), (_label(b, "B", state.b), css(RUN_COLORS[1]))]
        if state.mode == "edit":
            return (both[0 if state.blinked else 1],)
        return tuple(reversed(both)) if state.blinked else tuple(both)

    def _draw_keypoints(self) -> None:
        page, state = self._page, self._page.state
        session = page.session
        style = Style(
            groups=tuple(sorted(state.groups)),
            color_by=state.color_by,
            points=state.keypoints,
            bones=state.keypoints and state.bones,
            minimum=state.minimum,
            ghosts=state.detections,
        )
        if page.changes.of("style", style):
            page.channel.send("style", style)
        if not page.changes.of("keypoints", state.frame, session.edits):
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
        page.channel.send("keypoints", keypoints)

    def _draw_legend(self) -> None:
        if self._page.changes.of("legend", self._compared):
            self._page.channel.send("legend", LEGEND if self._compared else None)


def _surroundings(xy: Float[np.ndarray, "n 2"], size: tuple[int, int]) -> Float[np.ndarray, "2 2"]:
    """A rectangle around points, with a margin as far as the image goes: first its least, then its largest corner."""
    low, high = xy.min(0), xy.max(0)
    margin = max(_LEAST_MARGIN * float(np.hypot(*size)), _MARGIN * float((high - low).max()))
    inside = np.array([np.maximum(low - margin, 0), np.minimum(high + margin, size)])
    return np.array([np.minimum(inside[0], low), np.maximum(inside[1], high)])


def _places(places: Sequence[float], labels: tuple[tuple[str, str], ...]) -> tuple[PosterPlace, ...]:
    return tuple(PosterPlace(x=x, label=label, color=color) for x, (label, color) in zip(places, labels, strict=True))


def _label(shown: Shown | None, name: str, choice: FitChoice) -> str:
    return f"{name}   {shown.title}" if shown is not None else f"{name}   no fit yet"


PLAIN = FrameImage.uniform((38, 40, 44))
"""In place of the video where that is switched off."""
_SHADES = color_table()[np.linspace(0, 255, _LEGEND_COLORS).astype(int)].tolist()
LEGEND = Legend(
    title="Distance between A and B",
    unit="mm",
    low=0.0,
    high=1e3 * DISTANCE_LIMIT,
    colors=tuple(css((r, g, b)) for r, g, b in _SHADES),
)
