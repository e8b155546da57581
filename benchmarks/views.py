"""Fits from two cameras that are neither synchronised nor calibrated, and the pose and offset that are found.

The balancing clips with shifts and at other frame rates, their lens known or estimated, beside each view alone; and
captured motion of the suite from two sides.

    python -m benchmarks.views --angles --shifts 0 13.5         only the balancing clips
    python -m benchmarks.views --angles --detected              the same from the own detector's points
    python -m benchmarks.views --no-fits                        only pose and offset
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation
from tyro.conf import OmitArgPrefixes

from benchmarks.clips import Focal, data_folder, read
from benchmarks.report import Common, Row, progress, report, start
from evaluation.synthetic.motion_suite.clips import make_motion, motion_sequences
from evaluation.synthetic.motion_suite.depth_figures import LIMB_JOINTS
from fitting_core import keypoints as kp
from fitting_core import metrics
from fitting_core.body.model import BodyModel
from fitting_core.body.points.positions import joints_in_space
from fitting_core.clip import Clip, OtherView
from fitting_core.config.schema import DEFAULT_PRESET, PRESETS
from fitting_core.errors import InputError
from fitting_core.fit.fitting import fit_clip
from fitting_core.fit.views.relating import related
from fitting_core.keypoints import Keypoints
from fitting_core.measure.limbs import HIPS, Limbs, limb_pa_mpjpe
from fitting_core.world_camera import WorldCamera, read_world_camera

_PAIR = ("cam03", "cam04")
_LATER = 9
"""Frames by which the suite's second view starts later."""


@dataclass(frozen=True, kw_only=True)
class Views:
    """What to fit."""

    shifts: tuple[float, ...] = (0.0, 7.0, 13.5)
    """Frames by which cam04 starts later; half frames are interpolated."""
    focals: tuple[Focal, ...] = ("auto", "true")
    detected: bool = False
    """Detect keypoints in the balancing videos instead of reading OpenPose's."""
    heights: tuple[float, ...] = ()
    """Also with these heights given, centimetres."""
    angles: tuple[int, ...] = (30, 60, 90, 150)
    """Degrees between the two views of the suite."""
    every: int = 6
    """Use every n-th of the suite's windows."""
    half: str = "tuning"
    fits: bool = True
    """Fit, besides finding pose and offset."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


@dataclass(frozen=True, kw_only=True, eq=False)
class Pair:
    """Two views, and the truth."""

    label: str
    first: Clip
    other: Clip
    cameras: tuple[WorldCamera, WorldCamera]
    offset: float
    """Seconds."""
    truth: Limbs
    """In the first camera's space."""


def at(clip: Clip, frames: Float[np.ndarray, "n"], *, step: int = 1) -> Clip:
    """A clip of some frames, interpolated between whole ones, with every `step`-th at a lower frame rate."""
    frames = frames[::step]
    before, share = np.floor(frames).astype(int), frames % 1
    after, points = np.minimum(before + 1, len(clip) - 1), clip.keypoints
    xy = (1 - share)[:, None, None] * points.xy[before] + share[:, None, None] * points.xy[after]
    sure = np.where(share[:, None] > 0, np.minimum(points.confidence[before], points.confidence[after]), 1.0)
    confidence = np.minimum(points.confidence[before], sure)
    return replace(clip, keypoints=Keypoints(xy=xy, confidence=confidence), frame_rate=clip.frame_rate / step)


def balancing(options: Views) -> Iterator[Pair]:
    """cam03 with cam04, whose clip starts later or has half the frame rate."""
    one, two = (read_world_camera(data_folder() / "balancing" / name / "camera.npz") for name in _PAIR)
    for focal in options.focals:
        samples = [read(name, focal=focal, detected=options.detected) for name in _PAIR]
        first, other = (sample.clip for sample in samples)
        truth = samples[0].truth
        assert truth is not None
        cases = [(shift, 1) for shift in options.shifts] + [(options.shifts[0], 2)]
        for shift, step in cases:
            count = len(first) - int(np.ceil(shift))
            yield Pair(
                label=f"{focal} focal length, {shift:g} frames later" + ", 30 frames/s" * (step == 2),
                first=at(first, np.arange(count, dtype=float)),
                other=at(other, np.arange(count) + shift, step=step),
                cameras=(one, two),
                offset=-shift / first.frame_rate,
                truth=truth[:count, kp.LIMBS],
            )


def suite(options: Views) -> Iterator[Pair]:
    """The suite's windows, also filmed from farther around."""
    chosen = [s for s in motion_sequences().values() if s.half == options.half] if options.angles else []
    for sequence in chosen[:: options.every]:
        first = make_motion(sequence)
        count = len(first.clip) - _LATER
        for angle in options.angles:
            shot = replace(sequence.shot, azimuth=sequence.shot.azimuth + angle)
            other = make_motion(replace(sequence, shot=shot, seed=sequence.seed + angle))
            poses = [made.view.pose() for made in (first, other)]
            yield Pair(
                label=f"{sequence.name} ({sequence.kind}, {sequence.shot.cut}), {angle}°",
                first=at(first.clip, np.arange(count, dtype=float)),
                other=at(other.clip, np.arange(_LATER, len(first.clip), dtype=float)),
                cameras=(poses[0], poses[1]),
                offset=-_LATER / first.clip.frame_rate,
                truth=first.truth.joints[:count, LIMB_JOINTS],
            )


def found(pair: Pair, body: BodyModel, *, fits: bool, height: float | None = None) -> Row:
    """How far off pose, offset and the fit are; the reason for a refusal."""
    config = replace(PRESETS[DEFAULT_PRESET], height=height)
    row: Row = {"": pair.label + (f", {height:g} cm" if height else "")}
    try:
        both = related(pair.first, [OtherView(clip=pair.other)])
    except InputError as error:
        return row | {"refused": str(error)}
    relation = both.views[0].relation
    assert relation is not None
    turn = pair.cameras[1].rotation @ pair.cameras[0].rotation.T
    way = pair.cameras[1].translation - turn @ pair.cameras[0].translation
    cosine = relation.shift @ way / np.linalg.norm(relation.shift) / np.linalg.norm(way)
    row |= {
        "offset, frames": (relation.offset - pair.offset) * pair.first.frame_rate,
        "stated": relation.offset_deviation * pair.first.frame_rate,
        "rotation °": float(np.degrees(Rotation.from_matrix(relation.turn @ turn.T).magnitude())),
        "direction °": float(np.degrees(np.arccos(np.clip(cosine, -1, 1)))),
        "mrad": 1e3 * relation.disagreement,
    }
    clips = {"alone": pair.first, "both": both} if fits else {}
    for name, clip in clips.items():
        joints = joints_in_space(body, fit_clip(clip, body, config).last.params)[:, LIMB_JOINTS]
        row[f"PA {name}"] = float(np.nanmean(limb_pa_mpjpe(joints, pair.truth)))
        row[f"MPJPE {name}"] = float(np.nanmean(metrics.mpjpe(joints, pair.truth, HIPS)))
    return row


def run(options: Views) -> None:
    """Measure and report."""
    body, rows = options.common.load_body(), list[Row]()
    for pairs in (balancing(options), suite(options)):
        for pair in pairs:
            for height in (None, *(options.heights if pair.label.startswith(("auto", "true")) else ())):
                rows.append(found(pair, body, fits=options.fits, height=height))
                progress(str(rows[-1]))
    report(options, {"Two views": rows})


if __name__ == "__main__":
    start(Views, run)
