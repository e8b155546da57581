"""Noise of detectors by keypoint: the figures behind fitting_core/keypoint_noise.py.

Errors are measured in the image and stated in millimetres on the body, along x or y. Balancing: against points
triangulated from OpenPose's keypoints in two to four calibrated views, so OpenPose's own errors are larger than what is
left there, and those of others smaller; both are corrected for. Phone videos: against joint centres of markers, through
a camera that is found for each clip.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import least_squares
from tyro.conf import OmitArgPrefixes

from benchmarks.clips import data_folder
from benchmarks.report import Common, Row, report, start
from fitting_core import keypoints as kp
from fitting_core.io import read_detections
from fitting_core.keypoint_noise import OPENPOSE, part
from fitting_core.keypoints import Keypoints
from fitting_core.people.person import choose_person

CONFIDENT = 0.3
"""Detections above it count."""
_MEDIAN = 1.1774
"""Median distance of a normal distribution in the plane, in its standard deviations."""
_PHONE_MM = 26.0
"""What a phone's lens has on 35 mm film; a clip's own may be 5 % off."""
_JOINTS = {"sho": "shoulder", "elb": "elbow", "wri": "wrist", "hip": "hip", "kne": "knee", "ank": "ankle"}
_LAGS = np.arange(-0.1, 0.11, 0.02)
"""Seconds by which the markers' clock may be off."""


@dataclass(frozen=True, kw_only=True)
class KeypointNoise:
    """Which keypoints."""

    keypoints: Path
    """Folder of a detector's keypoints: in it balancing_cam03, balancing_cam04, squat and walk_ts, as far as they are
    there."""
    detector: str = "mediapipe"
    """Whose they are, for the table."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


@dataclass(frozen=True, kw_only=True)
class Errors:
    """Of one clip's body keypoints."""

    mm: Float[np.ndarray, "T 25 2"]
    """On the body."""
    seen: Bool[np.ndarray, "T 25"]
    reference: Float[np.ndarray, "T 25"]
    """Share of OpenPose's noise variance that the reference has; 0 if it is not made from OpenPose's keypoints."""

    def of(self, name: str) -> tuple[float, float, float, int]:
        """Of a part: standard deviation by the median, the same about each keypoint's mean, share, and how many."""
        rows = [(self.mm[self.seen[:, k], k], self.reference[self.seen[:, k], k]) for k in _keypoints_of(name)]
        rows = [row for row in rows if len(row[0]) > 4]
        if not rows:
            return np.nan, np.nan, np.nan, 0
        whole = np.concatenate([np.linalg.norm(mm, axis=1) for mm, _ in rows])
        about = np.concatenate([np.linalg.norm(mm - np.median(mm, 0), axis=1) for mm, _ in rows])
        share = float(np.concatenate([share for _, share in rows]).mean())
        return float(np.median(whole)) / _MEDIAN, float(np.median(about)) / _MEDIAN, share, len(whole)


def _keypoints_of(name: str) -> list[int]:
    return [k for k in range(25) if part(k) == name]


PARTS = list(dict.fromkeys(part(k) for k in range(25)))


def detected(folder: Path) -> Keypoints:
    """Of the most prominent person."""
    return choose_person(read_detections(folder))[0].keypoints


def balancing(view: str, keypoints: Keypoints) -> Errors:
    """Against the triangulated reference."""
    folder = data_folder() / "balancing"
    with np.load(folder / view / "camera.npz", allow_pickle=False) as camera:
        matrix, distortion, rotation, shift = (camera[name] for name in ("K", "dist", "R", "t"))
    with np.load(folder / "reference_3d.npz", allow_pickle=False) as reference:
        points, views = reference["points"] @ rotation.T + shift.reshape(3), reference["cameras"]
    flat = np.nan_to_num(points).reshape(-1, 3)
    xy = cv2.projectPoints(flat, np.zeros(3), np.zeros(3), matrix, distortion)[0].reshape(*points.shape[:2], 2)
    mm = 1000 * (keypoints.xy[:, kp.BODY] - xy) * points[..., 2:] / matrix[0, 0]
    seen = (keypoints.confidence[:, kp.BODY] > CONFIDENT) & np.isfinite(points).all(-1)
    # A point in space has three numbers, from two of each view.
    return Errors(mm=mm, seen=seen, reference=3 / (2 * np.maximum(views, 2)))


def apart(views: Mapping[str, Keypoints]) -> dict[str, float]:
    """By part, the standard deviation that two views' keypoints show against each other, in millimetres on the body.

    What both views have in common, such as an offset on the body, is not in it. Of the four numbers of two views, three
    are spent on the point in space, so that the distance that is left has the deviation of one number.
    """
    rays, scales, seen = [], [], []
    for view, keypoints in views.items():
        with np.load(data_folder() / "balancing" / view / "camera.npz", allow_pickle=False) as camera:
            matrix, distortion, rotation, shift = (camera[name] for name in ("K", "dist", "R", "t"))
        flat = keypoints.xy[:, kp.BODY].reshape(-1, 1, 2)
        rays.append(cv2.undistortPoints(flat, matrix, distortion)[:, 0])
        scales.append((rotation, shift.reshape(3)))
        seen.append(keypoints.confidence[:, kp.BODY] > CONFIDENT)
    matrices = [np.column_stack(pose) for pose in scales]
    points = cv2.triangulatePoints(*matrices, *(ray.T for ray in rays))
    points = (points[:3] / points[3]).T
    left = np.zeros(len(points))
    for ray, (rotation, shift) in zip(rays, scales, strict=True):
        inside = points @ rotation.T + shift
        left += (((inside[:, :2] / inside[:, 2:] - ray) * inside[:, 2:]) ** 2).sum(1)
    distance, both = 1000 * np.sqrt(left).reshape(seen[0].shape), seen[0] & seen[1]
    by_part = {name: [distance[both[:, k], k] for k in _keypoints_of(name)] for name in PARTS}
    return {n: float(np.median(np.concatenate(d))) / 0.6745 for n, d in by_part.items() if sum(map(len, d)) > 20}


def phone(name: str, keypoints: Keypoints, *, size: tuple[int, int] = (720, 1280), rate: float = 60.0) -> Errors:
    """Against joint centres of markers."""
    with np.load(data_folder() / "opencap" / name / "truth.npz", allow_pickle=False) as truth:
        time, markers, names = truth["time"], truth["markers"].astype(float), [str(n) for n in truth["names"]]
    places = [kp.INDEX[f"{'right' if n[0] == 'r' else 'left'}_{_JOINTS[n[1:]]}"] for n in names]
    frames = np.arange(len(keypoints)) / rate
    xy, confident = keypoints.xy[:, places], keypoints.confidence[:, places] > CONFIDENT
    best: _Resection | None = None
    for lag in _LAGS:
        at = frames + lag
        points = np.stack([[np.interp(at, time, row) for row in joint.T] for joint in markers.swapaxes(0, 1)])
        points = points.transpose(2, 0, 1)
        seen = confident & ((at >= time[0]) & (at <= time[-1]))[:, None]
        found = _Resection.of(points, xy, seen, size, best)
        best = found if best is None or found.cost < best.cost else best
    assert best is not None
    mm, seen = np.zeros((len(xy), 25, 2)), np.zeros((len(xy), 25), bool)
    mm[:, places], seen[:, places] = best.mm, best.seen
    return Errors(mm=mm, seen=seen, reference=np.zeros(seen.shape))


@dataclass(frozen=True, kw_only=True)
class _Resection:
    """A camera that stands where a clip's joint centres look as detected, and what is left."""

    numbers: Float[np.ndarray, "7"]
    """Turn and shift into camera space, and the logarithm of the focal length in lenses of a phone."""
    cost: float
    mm: Float[np.ndarray, "T 12 2"]
    seen: Bool[np.ndarray, "T 12"]

    @staticmethod
    def of(
        points: Float[np.ndarray, "T 12 3"],
        xy: Float[np.ndarray, "T 12 2"],
        seen: Bool[np.ndarray, "T 12"],
        size: tuple[int, int],
        near: "_Resection | None",
    ) -> "_Resection":
        focal, center = _PHONE_MM / 36 * max(size), np.array(size) / 2
        some = seen & (np.arange(len(xy)) % 3 == 0)[:, None]

        def pixels(numbers: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            inside = at @ cv2.Rodrigues(numbers[:3])[0].T + numbers[3:6]
            depth = inside[..., 2:] / (focal * np.exp(numbers[6]))
            return inside[..., :2] / depth + center, depth

        def left(numbers: np.ndarray) -> np.ndarray:
            return np.append(
                (pixels(numbers, points[some])[0] - xy[some]).ravel(), numbers[6] / 0.05 * some.sum() ** 0.5
            )

        if near is None:
            matrix = np.array([[focal, 0, center[0]], [0, focal, center[1]], [0, 0, 1.0]])
            _, turn, shift, _ = cv2.solvePnPRansac(points[some], xy[some], matrix, None, reprojectionError=40.0)
            first = np.concatenate([turn.ravel(), shift.ravel(), [0.0]])
        else:
            first = near.numbers
        found = least_squares(left, first, loss="soft_l1", f_scale=15.0)
        where, depth = pixels(found.x, points)
        return _Resection(numbers=found.x, cost=found.cost / some.sum(), mm=1000 * (xy - where) * depth, seen=seen)


def rows(clips: Mapping[str, Errors], *, own: bool, openpose: Mapping[str, float]) -> list[Row]:
    """A row for each part and clip, corrected for what the reference has of OpenPose's noise.

    Args:
        clips: By name.
        own: Whether the keypoints are OpenPose's, which the reference was made of.
        openpose: By part, OpenPose's standard deviation; not used for its own.
    """
    table: list[Row] = []
    for name in PARTS:
        for clip, errors in clips.items():
            found, about, share, count = errors.of(name)
            if not count:
                continue
            variance = found**2 / (1 - share) if own else found**2 - share * openpose.get(name, 0.0) ** 2
            table.append(
                {
                    "part": name,
                    "clip": clip,
                    "left mm": found,
                    "about its mean mm": about,
                    "noise mm": float(np.sqrt(max(variance, 0.0))),
                    "n": str(count),
                }
            )
    return table


def pooled(table: list[Row], clips: tuple[str, ...]) -> dict[str, float]:
    """By part, the root of the mean variance over clips."""
    found: dict[str, list[float]] = {}
    for row in table:
        value = row["noise mm"]
        if row["clip"] in clips and isinstance(value, float):
            found.setdefault(str(row["part"]), []).append(value**2)
    return {name: float(np.sqrt(np.mean(variances))) for name, variances in found.items()}


def run(options: KeypointNoise) -> None:
    """Measures both detectors, and reports."""
    views = ("cam03", "cam04")
    of_openpose = {v: balancing(v, detected(data_folder() / "balancing" / v / "keypoints")) for v in views}
    known = rows(of_openpose, own=True, openpose={})
    noise = pooled(known, views)
    there = {v: options.keypoints / f"balancing_{v}" for v in views}
    clips = {v: balancing(v, detected(folder)) for v, folder in there.items() if folder.is_dir()}
    # The same points for both: the man is seen from behind, where one of them makes up a face and the other does not.
    clips = {v: replace(errors, seen=errors.seen & of_openpose[v].seen) for v, errors in clips.items()}
    phones = {name: options.keypoints / name for name in ("squat", "walk_ts")}
    clips |= {name: phone(name, detected(folder)) for name, folder in phones.items() if folder.is_dir()}
    theirs = rows(clips, own=False, openpose=noise)
    other = pooled(theirs, (*views, "squat"))
    both: list[Row] = [{"part": p, OPENPOSE: noise.get(p), options.detector: other.get(p)} for p in PARTS]
    titles = {"OpenPose": known, options.detector: theirs, "Together, without walk_ts, mm": both}
    if all(folder.is_dir() for folder in there.values()):
        own = {OPENPOSE: {v: detected(data_folder() / "balancing" / v / "keypoints") for v in views}}
        own[options.detector] = {v: detected(folder) for v, folder in there.items()}
        found = {name: apart(of_views) for name, of_views in own.items()}
        titles["Two views against each other, mm"] = [
            {"part": p} | {n: f.get(p) for n, f in found.items()} for p in PARTS
        ]
    report(options, titles)


if __name__ == "__main__":
    start(KeypointNoise, run)
