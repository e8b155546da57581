"""How exactly bodies lie over the video in a real browser, and what drawing a frame costs.

Silhouettes of an opaque body in screenshots (Debian's Chromium, WebGL in software) against its triangles projected and
rasterized on the processor, at several window shapes and zooms, with the principal point in the middle and off it. Then
one frame after another of image and body: time on the server, and of the browser's main thread, which leaves out the
drawing itself.
"""

import time
from dataclasses import dataclass, field, replace
from statistics import median

import numpy as np
import torch
from tyro.conf import OmitArgPrefixes

from benchmarks.report import Common, Row, progress, repeated, report, start
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import BodyModel
from fitting_core.camera import Camera
from fitting_core.clips.demo import demo_clip
from fitting_core.io.truth import read_truth
from fitting_core.video.frames import FrameSource
from tcfit_app.review.scene.layers import BodyLayer, FrameImage
from tcfit_app.review.scene.poster import Poster, Posters
from tcfit_app.review.scene.space import Space
from tests.drivers.browser import chromium
from tests.drivers.screens import (
    PLATE,
    Screen,
    canvas_camera,
    expected_body,
    overlap,
    plain_body,
    plate_errors,
    screen,
    seen_body,
)


@dataclass(frozen=True, kw_only=True)
class Exactness:
    """What to measure."""

    windows: tuple[tuple[int, int], ...] = ((1440, 900), (1920, 1080), (900, 1000))
    """Widths and heights of the browser's window."""
    frames: int = 40
    """How many frames to play."""
    pace: float = 8.0
    """Frames a second while playing: slow enough that none is left out."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


def cameras(demo: Camera) -> dict[str, Camera]:
    """The demo's camera, and one whose image is cut from a larger one, so that its middle is elsewhere."""
    width, height = demo.size
    cut = replace(demo, center=(0.28 * width, 0.64 * height), focal=(demo.focal[0], 0.97 * demo.focal[1]))
    return {"centred": demo, "off-centre": cut}


def meshes(body: BodyModel, frames: int) -> np.ndarray:
    """The demo's true bodies (T, V, 3), spread over the clip, in camera space."""
    truth = read_truth(demo_clip().truth)
    chosen = torch.linspace(0, len(truth.params) - 1, frames).long()
    return Mesh(body)(truth.params[chosen]).numpy()


def in_view(vertices: np.ndarray, camera: Camera, demo: Camera) -> np.ndarray:
    """The body moved so that this camera sees it where the demo's does."""
    shift = (np.array(demo.center) - np.array(camera.center)) / np.array(camera.focal) * np.median(vertices[:, 2])
    return (vertices + np.array([*shift, 0.0])).astype(np.float32)


def zooms(vertices: np.ndarray, camera: Camera) -> dict[str, tuple[float, float, float, float] | None]:
    """Whole posters, and rectangles of image pixels: the upper body, and the crown of the head."""
    pixels = vertices[:, :2] / vertices[:, 2:] * camera.focal + camera.center
    low, high = pixels.min(0), pixels.max(0)
    height, (x, y) = high[1] - low[1], pixels[pixels[:, 1].argmin()]
    return {
        "whole": None,
        "head and arms": (low[0], low[1], high[0], low[1] + 0.35 * height),
        "crown": (x - 0.03 * height, y - 0.01 * height, x + 0.03 * height, y + 0.05 * height),
    }


def exactness_rows(shown: Screen, name: str, camera: Camera, body: BodyLayer, window: tuple[int, int]) -> list[Row]:
    """One row for each zoom at a window size, and the image's own edges."""
    posters = Posters(camera=camera, posters=(Poster(image=PLATE, bodies=(body,)),))
    rows: list[Row] = []
    shown.settle(window)
    for zoom, rectangle in zooms(body.vertices, camera).items():
        shown.show(posters)
        shown.view.zoom_to(rectangle) if rectangle else shown.view.cameras.reset()
        shown.settle()
        seen = seen_body(shown.picture())
        expected = expected_body(posters, shown.view.cameras.pose, window)
        row: dict[str, str | float | None] = {"camera": name, "window": f"{window[0]} x {window[1]}", "zoom": zoom}
        factor = canvas_camera(camera, shown.view.cameras.pose, window, (0.0, 0.0, *window)).focal[0] / camera.focal[0]
        row |= {"screen px per image px": factor, "silhouette px": float(expected.sum())}
        row |= {"IoU": f"{overlap(seen, expected):.4f}"}
        if rectangle is None:
            shown.show(replace(posters, posters=(Poster(image=PLATE),)))
            shown.settle()
            row["image edges off by px"] = plate_errors(shown.picture(), posters, shown.view.cameras.pose)
        rows.append(row)
    return rows


def layouts(body: BodyLayer, camera: Camera, image: FrameImage, moved: BodyLayer) -> dict[str, Posters | Space]:
    """What one frame of each mode consists of."""
    one, other = Poster(image=image, bodies=(body,)), Poster(image=image, bodies=(moved,))
    distance = np.linalg.norm(moved.vertices - body.vertices, axis=1)
    return {
        "image": Posters(camera=camera, posters=(Poster(image=image),)),
        "image, body": Posters(camera=camera, posters=(one,)),
        "image, body in colours": Posters(
            camera=camera, posters=(Poster(image=image, bodies=(replace(body, values=distance),)),)
        ),
        "A|B: 2 images, 2 bodies": Posters(camera=camera, posters=(one, other)),
        "3D: image, 2 bodies": Space(camera=camera, image=image, bodies=(body, moved), ground=1.0),
    }


def cost_rows(shown: Screen, options: Exactness, body: BodyModel) -> list[Row]:
    """One row for each kind of frame."""
    demo = demo_clip()
    vertices = meshes(body, options.frames)
    with FrameSource(demo.video) as video:
        images = [FrameImage.encode(video.frame(i)) for i in range(options.frames)]
    frames = [
        layouts(
            BodyLayer(vertices=vertices[i], faces=body.faces),
            demo.camera,
            images[i],
            BodyLayer(vertices=vertices[i] + np.float32(0.05), faces=body.faces),
        )
        for i in range(options.frames)
    ]
    return [play(shown, what, [frame[what] for frame in frames], options.pace) for what in frames[0]]


def play(shown: Screen, what: str, snapshots: list[Posters | Space], pace: float) -> Row:
    """Shows the snapshots at that pace."""
    shown.show(snapshots[0])
    shown.settle()
    session = shown.page.context.new_cdp_session(shown.page)
    session.send("Performance.enable")

    def busy() -> float:
        return next(
            m["value"] for m in session.send("Performance.getMetrics")["metrics"] if m["name"] == "TaskDuration"
        )

    shown.page.wait_for_timeout(1000)
    idle = busy()
    shown.page.wait_for_timeout(2000)
    before, processor = busy(), time.process_time()
    idle = (before - idle) / 2  # seconds in a second
    began, times, own = time.perf_counter(), [], []
    for i, snapshot in enumerate(snapshots):
        shown.page.wait_for_timeout(max(0.0, 1e3 * (began + i / pace - time.perf_counter())))
        start, own_start = time.perf_counter(), time.thread_time()
        shown.show(snapshot)
        times.append(1e3 * (time.perf_counter() - start))
        own.append(1e3 * (time.thread_time() - own_start))
    shown.page.wait_for_timeout(1e3 / pace)
    length = time.perf_counter() - began
    used = busy() - before - idle * length
    return repeated(what, times) | {
        "CPU median ms": median(own),
        "server CPU ms with sending": 1e3 * (time.process_time() - processor) / len(snapshots),
        "browser main thread ms": 1e3 * used / len(snapshots),
    }


def run(options: Exactness) -> None:
    """Measures and prints both tables."""
    body = options.common.load_body()
    demo = demo_clip().camera
    vertices = meshes(body, 3)[1]
    rows: list[Row] = []
    with chromium() as browser, screen(browser) as shown:
        for name, camera in cameras(demo).items():
            layer = plain_body(in_view(vertices, camera, demo), body.faces)
            for window in options.windows:
                progress(f"{name}, {window[0]} x {window[1]}")
                rows += exactness_rows(shown, name, camera, layer, window)
        progress("playing")
        shown.settle((1440, 900))
        costs = cost_rows(shown, options, body)
    report(options, {"Silhouette and image against projection": rows, "One frame": costs})


if __name__ == "__main__":
    start(Exactness, run)
