"""How right a camera is that is read from its pictures: real clips, and rendered rooms around people who move.

Rooms are boxes with furniture, seen by the suite's cameras with lenses of phones and cameras, which are held up to 8
degrees askew; people are not rendered, only their detected keypoints are used. *Fields* have smooth ground and sky and
no straight edge: of them nothing but the prior can be said.
"""

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8
from scipy.spatial.transform import Rotation
from tyro.conf import OmitArgPrefixes

from benchmarks.accuracy_sets import PHONE_MM
from benchmarks.clips import data_folder
from benchmarks.report import Common, Row, progress, report, start
from evaluation.synthetic.motion_suite.clips import make_motion, motion_sequences
from fitting_core.camera import Camera, Lens, focal_from_35mm
from fitting_core.clip import Clip
from fitting_core.clips.options import CameraOptions
from fitting_core.clips.reading import read_clip
from fitting_core.ground.from_pictures import camera_from_pictures
from fitting_core.lens import filmed
from fitting_core.video.sampled import SampledPictures
from fitting_core.world_camera import WorldCamera

LENSES_MM = (24.0, 26.0, 28.0, 35.0, 50.0)
_HALF_DIAGONAL_MM = 21.6
_ASKEW = 8.0
"""Degrees."""
_ONE_IN_TEN = 1.2816
"""Standard deviations."""


@dataclass(frozen=True, kw_only=True)
class CameraBenchmark:
    """What to measure."""

    rooms: int = 30
    fields: int = 10
    k1: float = 0.0
    """Distortion of the lens that films rooms and fields, which is not passed to the estimate."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


@dataclass(frozen=True, kw_only=True)
class Judged:
    """An estimated camera beside the true one."""

    log_focal: float
    """Natural logarithm of estimated over true focal length."""
    focal_deviation: float
    """As stated."""
    up_off: float | None
    """Degrees; None if no vertical is stated."""
    up_deviation: float | None


def judged(found: Camera, focal: float, up: Float[np.ndarray, "3"] | None) -> Judged:
    """A camera beside the true focal length in pixels and the true direction against gravity in camera space."""
    off = None
    if found.vertical is not None and up is not None:
        off = float(np.degrees(np.arccos(min(1.0, float(up @ found.vertical.up)))))
    deviation = None if found.vertical is None else found.vertical.deviation
    log_focal = float(np.log(found.focal[0] / focal))
    assert found.focal_deviation is not None
    return Judged(log_focal=log_focal, focal_deviation=found.focal_deviation, up_off=off, up_deviation=deviation)


def drawn(
    view: WorldCamera, camera: Camera, rng: np.random.Generator, *, room: bool, k1: float = 0.0
) -> UInt8[np.ndarray, "h w 3"]:
    """A noisy, slightly blurred picture of a room of boxes, or of a field below a sky."""
    (width, height), place = camera.size, -view.rotation.T @ view.translation
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    rays = np.stack([(x - camera.center[0]) / camera.focal[0], (y - camera.center[1]) / camera.focal[1], 0 * x + 1], -1)
    filmed_radius = np.hypot(rays[..., 0], rays[..., 1])
    radius = filmed_radius.copy()
    for _ in range(20 if k1 else 0):
        radius -= (radius * (1 + k1 * radius**2) - filmed_radius) / np.maximum(1 + 3 * k1 * radius**2, 0.05)
    rays[..., :2] *= (radius / np.maximum(filmed_radius, 1e-9))[..., None]
    rays = rays.reshape(-1, 3) @ view.rotation
    if room:
        grey = _room(place, rays, rng)
    else:
        hills = cv2.GaussianBlur(rng.normal(0, 1, (height, width)), (0, 0), 25).ravel()
        grey = 150 - 300 * np.arctan(rays[:, 1] / np.hypot(rays[:, 0], rays[:, 2])) / np.pi + 300 * hills
    picture = cv2.GaussianBlur(grey.reshape(height, width).astype(np.float32), (0, 0), 0.7)
    picture += rng.normal(0, 3, picture.shape)
    return cv2.cvtColor(np.clip(picture, 0, 255).astype(np.uint8), cv2.COLOR_GRAY2RGB)


def _room(
    place: Float[np.ndarray, "3"], rays: Float[np.ndarray, "n 3"], rng: np.random.Generator
) -> Float[np.ndarray, "n"]:
    """Grey values of a room with tiles, boards or panels, and of furniture, one piece in four askew."""
    heading = rng.uniform(0, 90)
    reach = max(3.0, 0.6 + float(np.abs(place[[0, 2]]).max()) * 1.5)
    boxes = [(heading, np.array([-reach, -0.02, -reach]), np.array([reach, max(2.6, place[1] + 0.7), reach]))]
    for _ in range(rng.integers(5, 16)):
        size = rng.uniform([0.3, 0.4, 0.3], [1.2, 2.0, 1.2])
        at = np.array([rng.choice([-1, 1]) * (reach - size[0] / 2), 0, rng.uniform(-reach, reach)])
        at = at[[2, 1, 0]] if rng.random() < 0.5 else at
        turned = rng.uniform(0, 90) if rng.random() < 0.25 else 0.0
        boxes.append((heading + turned, at - size * [0.5, 0, 0.5], at + size * [0.5, 1, 0.5]))
    nearest, grey = np.full(len(rays), np.inf), np.zeros(len(rays))
    for number, (angle, low, high) in enumerate(boxes):
        turn = Rotation.from_euler("y", angle, degrees=True).as_matrix()
        eye, ahead = place @ turn, rays @ turn
        with np.errstate(divide="ignore", invalid="ignore"):
            one, two = (low - eye) / ahead, (high - eye) / ahead
        enters, leaves = np.fmin(one, two), np.fmax(one, two)
        near, far = enters.max(1), leaves.min(1)
        # Rooms are seen from inside: the face where a ray leaves.
        axis = leaves.argmin(1) if number == 0 else enters.argmax(1)
        depth = far if number == 0 else np.where((near < far) & (near > 0.1), near, np.inf)
        seen = depth < nearest
        hit, faces = (eye + depth[:, None] * ahead)[seen], 2 * axis[seen]
        faces += np.take_along_axis(ahead, axis[:, None], 1)[seen, 0] > 0
        nearest[seen], grey[seen] = depth[seen], _tints(hit, faces, rng)
    return grey


def _tints(
    hit: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "n"], rng: np.random.Generator
) -> Float[np.ndarray, "n"]:
    """Grey values of a box's faces, numbered 0 to 5: plain, or with joints along one or two of their axes."""
    tint = rng.uniform(40, 220, 6)[faces]
    steps, joints = rng.uniform(0.25, 1.2, (6, 3)), rng.random((6, 3)) < 0.5
    for axis in range(3):
        crossed = joints[faces, axis] & (faces // 2 != axis)
        tint = np.where(crossed & (hit[:, axis] / steps[faces, axis] % 1 < 0.05), tint * 0.6, tint)
    return tint


def scene(number: int, *, room: bool, folder: Path, k1: float = 0.0) -> tuple[Clip, Float[np.ndarray, "3"]]:
    """A clip with one picture and the keypoints of a person in it, from the number as its seed; and up in its camera's
    axes."""
    rng = np.random.default_rng([number, room])
    whole = [sequence for sequence in motion_sequences().values() if sequence.shot.cut == "whole"]
    sequence = whole[number % len(whole)]
    lens = float(rng.choice(LENSES_MM))
    if k1 < 0 and _HALF_DIAGONAL_MM / lens > 0.95 * (2 / 3) / np.sqrt(-3 * k1):
        lens = 35.0  # a shorter one folds its corners
    made = make_motion(replace(sequence, shot=replace(sequence.shot, lens=lens)), cached=False)
    camera, pose = made.clip.camera, made.view.pose()
    roll = Rotation.from_euler("z", rng.uniform(-_ASKEW, _ASKEW), degrees=True).as_matrix()
    view = WorldCamera(rotation=roll @ pose.rotation, translation=roll @ pose.translation)
    points = made.clip.keypoints
    straight = (points.xy - camera.center) @ roll[:2, :2].T + camera.center
    bent = Lens(focal=camera.focal, center=camera.center, distortion=(k1, 0.0, 0.0, 0.0))
    points = replace(points, xy=filmed(bent, straight))
    path = folder / f"{number}.png"
    cv2.imwrite(str(path), drawn(view, camera, rng, room=room, k1=k1))
    return replace(made.clip, keypoints=points, source=path), view.rotation @ [0.0, 1.0, 0.0]


def estimated(clip: Clip, up: Float[np.ndarray, "3"]) -> Judged:
    """What its picture tells of the camera of a `scene`."""
    assert clip.source is not None
    found = camera_from_pictures(
        clip.camera, clip.keypoints, clip.frame_rate, SampledPictures(clip.source, [0], clip.camera), estimate=True
    )
    return judged(found, clip.camera.focal[0], up)


def real() -> Iterator[tuple[str, Judged]]:
    """The clips whose focal length is known; where the camera is calibrated in space, the vertical is too."""
    for name in ("cam03", "cam04"):
        folder = data_folder() / "balancing" / name
        with np.load(folder / "camera.npz", allow_pickle=False) as arrays:
            focal, up = float(arrays["K"][[0, 1], [0, 1]].mean()), arrays["R"][:, 2]
        found = read_clip(folder / "video.mp4", folder / "keypoints", camera=CameraOptions()).camera
        yield name, judged(found, focal, up)
    for name in ("squat", "walk_ts"):
        found = read_clip(data_folder() / "opencap" / name / "video.mp4", camera=CameraOptions()).camera
        yield name, judged(found, focal_from_35mm(PHONE_MM, found.size), None)


def row(what: str, results: Sequence[Judged]) -> Row:
    """Means over some cameras."""
    off = np.array([result.log_focal for result in results])
    inside = np.mean([abs(r.log_focal) < _ONE_IN_TEN * r.focal_deviation for r in results])
    ups = np.array([(r.up_off, r.up_deviation) for r in results if r.up_off is not None], float).reshape(-1, 2)
    off_up, stated = np.sqrt((ups**2).mean(0)) if len(ups) else (None, None)
    return {
        "what": what,
        "n": str(len(results)),
        "ln f off": float(np.abs(off).mean()),
        "bias": float(off.mean()),
        "stated": float(np.mean([r.focal_deviation for r in results])),
        "% within 80 %": 100 * float(inside),
        "verticals": str(len(ups)),
        "up off ° RMS": off_up,
        "stated °": stated,
    }


def main(options: CameraBenchmark) -> None:
    """Measure and report."""
    rows: list[Row] = []
    clips = list(real())
    rows += [row(name, [one]) for name, one in clips] + [row("real clips", [one for _, one in clips])]
    with tempfile.TemporaryDirectory() as folder:
        for what, count in (("rooms", options.rooms), ("fields", options.fields)):
            results = list[Judged]()
            for number in range(count):
                results.append(estimated(*scene(number, room=what == "rooms", folder=Path(folder), k1=options.k1)))
                progress(f"{what} {number}: {results[-1]}")
            rows.append(row(what, results))
    report(options, {"Camera from the picture": rows})


if __name__ == "__main__":
    start(CameraBenchmark, main)
