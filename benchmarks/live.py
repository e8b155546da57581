"""What a live correction costs: a drag of one keypoint, re-solved at every move, against a plain re-run at every move.

Both start from the same fit and see the same moves. A re-run converges and prepares everything again; a re-solve is one
step from where the last one left off. Wall time is what the user feels, CPU time what other programs do not disturb.
Needs the development data (see clips.py).
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from statistics import median

import numpy as np
import torch
from jaxtyping import Float
from tyro.conf import OmitArgPrefixes

from benchmarks.clips import read
from benchmarks.excerpts import mirrored
from benchmarks.report import Common, Row, progress, repeated, report, start
from fitting_core import keypoints as kp
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.clip import Clip
from fitting_core.config.schema import PRESETS, FitConfig
from fitting_core.fit.events import drained
from fitting_core.fit.fitting import fit_clip, rerun_events
from tcfit_app.fitting.live import LIVE_REACH, Correction, LiveCorrection


@dataclass(frozen=True, kw_only=True)
class Live:
    """What to drag."""

    clips: tuple[str, ...] = ("cam03", "gebaerden")
    """Which clips: body keypoints only, and with hands and face."""
    frames: int = 100
    """Of each clip."""
    keypoint: str = "right_elbow"
    """Which keypoint is dragged, in the middle frame."""
    pixels: float = 40.0
    """How far, at an image height of 1000 pixels."""
    moves: int = 40
    """In how many moves."""
    reruns: int = 5
    """How many of the moves a plain re-run follows too."""
    reaches: tuple[int, ...] = (LIVE_REACH, 2)
    """Frames that follow on each side."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


Times = list[tuple[float, float]]
"""Milliseconds on the wall's clock and of the processor."""
_BEGINS = 3
"""Times that a drag is begun: that happens once for each."""


@dataclass(frozen=True, kw_only=True)
class Drag:
    """What a drag took and where it ended; parameters of all frames."""

    times: dict[str, Times]
    on_the_way: BodyParams
    """After the last move."""
    released: BodyParams


def quick(config: FitConfig) -> FitConfig:
    """The same without the restarts of phase 1: what the drag starts from need not be the best."""
    return replace(config, relay_rounds=0, limb_flips=False, yaws="side_view")


def timed(work: Callable[[], object]) -> tuple[float, float]:
    """Milliseconds that it takes, on the wall's clock and of the processor."""
    wall, cpu = time.perf_counter(), time.thread_time()
    work()
    return 1e3 * (time.perf_counter() - wall), 1e3 * (time.thread_time() - cpu)


def dragged(correction: Correction, targets: list[Float[np.ndarray, "n 2"]]) -> Drag:
    """Drag keypoints along a way.

    Args:
        correction: What is dragged.
        targets: Where the keypoints are at each move, pixels.
    """
    live: list[LiveCorrection] = []
    ends: list[BodyParams] = []
    begins = [timed(lambda: live.append(LiveCorrection(correction, targets[0]))) for _ in range(_BEGINS)]
    drag = live[-1]

    def follow(xy: np.ndarray) -> None:
        drag.move(xy)
        drag.resolve()

    moves = [timed(lambda xy=xy: follow(xy)) for xy in targets]
    on_the_way = drag.params
    release = [timed(lambda: ends.append(drained(drag.release()).params))]
    times = {"begin": begins, "move": moves, "release": release}
    return Drag(times=times, on_the_way=on_the_way, released=ends[0])


def _row(clip: str, reach: int, what: str, times: Times) -> Row:
    wall, cpu = zip(*times, strict=True)
    return {"clip": clip, "window": f"{2 * reach + 1}"} | repeated(what, wall) | {"CPU median ms": median(cpu)}


def drag_rows(name: str, correction: Correction, targets: list[np.ndarray], reruns: int) -> tuple[list[Row], Row]:
    """Times of one drag's parts, and how far apart its ways end."""
    c, reach = correction, correction.reach
    drag, ends = dragged(c, targets), list[BodyParams]()

    def again(xy: np.ndarray) -> None:
        ends.append(drained(rerun_events(c.edited(xy), c.body, c.converging, c.params, c.frames)).params)

    plain = [timed(lambda xy=xy: again(xy)) for xy in targets[:: -max(1, len(targets) // max(1, reruns))]]
    apart: Row = {"clip": name, "window": f"{2 * reach + 1}"} | {
        title: _millimetres(c.body, a, b)
        for title, a, b in (
            ("moved mm", c.params, drag.released),
            ("last move to release mm", drag.on_the_way, drag.released),
            ("release to plain re-run mm", drag.released, ends[0]),
        )
    }
    return [_row(name, reach, what, times) for what, times in (drag.times | {"plain re-run": plain}).items()], apart


def _millimetres(body: BodyModel, a: BodyParams, b: BodyParams) -> float:
    """Between two results: the body joint and frame that differ most."""
    mesh = Mesh(body, dtype=torch.float64)
    return 1e3 * float((mesh.joints(a)[:, :22] - mesh.joints(b)[:, :22]).norm(dim=-1).max())


def run(options: Live) -> None:
    """Drags in each clip."""
    body, config = options.common.load_body(), PRESETS["tcfit"]
    times: list[Row] = []
    apart: list[Row] = []
    for name in options.clips:
        whole = read(name).clip
        clip: Clip = mirrored(whole, min(len(whole), options.frames), options.frames)
        progress(f"{name}: fit of {len(clip)} frames")
        params = fit_clip(clip, body, quick(config)).last.params
        frame, keypoint = len(clip) // 2, kp.INDEX[options.keypoint]
        shares = np.linspace(0, 1, options.moves)[:, None, None]
        way = np.array([[1.0, 0.5]]) * options.pixels * clip.camera.size[1] / 1000
        targets = list(clip.keypoints.xy[frame, [keypoint]] + shares * way)
        for reach in options.reaches:
            progress(f"{name}: drag, window of {2 * reach + 1}")
            c = Correction(
                clip=clip, body=body, config=config, params=params, frame=frame, keypoints=(keypoint,), reach=reach
            )
            rows, distance = drag_rows(name, c, targets, options.reruns)
            times += rows
            apart.append(distance)
    report(options, {"Live correction": times, "How far apart": apart})


if __name__ == "__main__":
    start(Live, run)
