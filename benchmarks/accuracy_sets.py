"""The data sets of accuracy.py: each is read, fitted and judged by a function of the table SETS."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from benchmarks.clips import data_folder, read
from benchmarks.standing import bend, case, lean
from evaluation.synthetic.motion_suite.clips import make_motion, motion_sequences
from evaluation.synthetic.motion_suite.depth_figures import LIMB_JOINTS, DepthRecord, depth_figures, measured
from fitting_core import keypoints as kp
from fitting_core import metrics
from fitting_core.body.markers.joint_centres import joint_centres_in_space
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space
from fitting_core.camera import Camera, focal_from_35mm
from fitting_core.clip import Clip
from fitting_core.clips.options import CameraOptions, ClipOptions
from fitting_core.clips.reading import read_clip
from fitting_core.config.schema import FitConfig
from fitting_core.fit.fitting import fit_clip
from fitting_core.measure.limbs import HIPS, Limbs, limb_figures, limb_pa_mpjpe
from fitting_core.measure.references.points import read_points
from fitting_core.measure.references.reference import Reference
from fitting_core.measure.references.resampling import at_frames_of
from tests.samples.carried import CARRIED, carried_clip, gesturing, pixel_errors

Figures = dict[str, float]
"""By column."""
_JOINTS = ("PA-MPJPE mm", "MPJPE mm", "knee °", "hip °", "elbow °", "trunk °")
_OTHERS = ("slip mm/s", "jitter mm/f²", "px p95", "none held", "ln f off", "f outside", "s")
COLUMNS = (*_JOINTS, *_OTHERS)
"""Of the table, from left to right."""
PHONE_MM = 26.0
"""Of OpenCap's phones, on 35 mm film."""
_SYSTEMS = {"opencap_monocular": "OpenCap Monocular", "wham": "WHAM"}
_SHORT = {"sho": "shoulder", "elb": "elbow", "wri": "wrist", "hip": "hip", "kne": "knee", "ank": "ankle"}
_OFFSETS = np.arange(-0.1, 0.1001, 0.01)
"""Seconds by which the markers' clock may be off the video's."""
_COLUMNS = {"turned_mpjpe": "MPJPE mm", "knee_flexion": "knee °", "hip_flexion": "hip °", "elbow_flexion": "elbow °"}
PHONES = {"squat": 120, "walk_ts": 80}
"""By name, frames that a quick run takes: the person goes down and comes up again, and nearly the whole walk."""
_PEOPLE, _QUICK_PEOPLE, _QUICK_WINDOWS = 48, 9, 5
"""People who stand; the step between the windows of a half of the suite."""


@dataclass(frozen=True, kw_only=True)
class Variant:
    """How everything is fitted."""

    config: FitConfig
    body: BodyModel
    quick: bool

    def fitted(self, clip: Clip, config: FitConfig | None = None) -> tuple[BodyParams, float]:
        """The last phase's parameters, and seconds of processor time."""
        begun = time.process_time()
        found = fit_clip(clip, self.body, config or self.config)
        return found.last.params, time.process_time() - begun

    def limbs(self, params: BodyParams) -> dict[str, Limbs]:
        """Limbs in camera space by what is added to a row's label: joint centres, and SMPL-X's joints of `fit.npz`."""
        joints = joints_in_space(self.body, params)[:, LIMB_JOINTS]
        return {"": joint_centres_in_space(self.body, params), ", SMPL-X's joints": joints}

    @property
    def free(self) -> FitConfig:
        """The same with no foot held."""
        return replace(self.config, weights=replace(self.config.weights, held_position=(0.0,) * 5))


Rows = dict[str, Figures]
"""By label."""


def _of_limbs(found: Limbs, true: Limbs) -> Figures:
    own = {_COLUMNS[name]: value for name, value in limb_figures(found, true).items() if value is not None}
    return {"PA-MPJPE mm": float(np.nanmean(limb_pa_mpjpe(found, true)))} | own


def _of_focal(camera: Camera, true: float) -> Figures:
    """How far off the estimated focal length is, and whether the right one lies outside its bounds of 80 %."""
    off = abs(float(np.log(camera.focal[0] / true)))
    assert camera.focal_deviation is not None
    return {"ln f off": off, "f outside": float(off > 1.2816 * camera.focal_deviation)}


def _smooth(variant: Variant, params: BodyParams) -> Figures:
    return {"jitter mm/f²": metrics.jitter(joints_in_space(variant.body, params)[:, : JOINT["right_wrist"] + 1])}


def phone(variant: Variant, name: str) -> Rows:
    """A phone's video with the joint centres of markers, and two learned systems in the same frames."""
    reference, rows = opencap(name), Rows()
    for focal, millimetres in (("26 mm", PHONE_MM), ("auto", None)):
        clip = phone_clip(name, quick=variant.quick, millimetres=millimetres)
        params, seconds = variant.fitted(clip)
        found = variant.limbs(params)
        true, others = in_time(found[""], clip, reference)
        rows |= {f"{name}, {focal}{label}": _of_limbs(limbs, true) for label, limbs in found.items()}
        rows[f"{name}, {focal}"] |= _smooth(variant, params)
        if focal == "auto":
            rows[f"{name}, {focal}"] |= _of_focal(clip.camera, focal_from_35mm(PHONE_MM, clip.camera.size))
        rows[f"{name}, {focal}"]["s"] = seconds
        rows |= {f"{name}, {system}": _of_limbs(points, true) for system, points in others.items()}
    return rows


def phone_clip(name: str, *, quick: bool, millimetres: float | None = PHONE_MM) -> Clip:
    """A phone's video with a focal length on 35 mm film; None: it is estimated."""
    video, last = data_folder() / "opencap" / name / "video.mp4", PHONES[name] - 1 if quick else None
    return read_clip(video, clip=ClipOptions(last_frame=last), camera=CameraOptions(focal_length_35mm=millimetres))


def opencap(name: str) -> Reference:
    """Joint centres of markers and both systems' points beside a phone's video."""
    path = data_folder() / "opencap" / name / "truth.npz"
    with np.load(path, allow_pickle=False) as file:
        sides = {"r": "right", "l": "left"}
        names = np.array([f"{sides[short[0]]}_{_SHORT[short[1:]]}" for short in file["names"]])
        systems = {title: file[key] for key, title in _SYSTEMS.items()}
        return read_points(path, {"points": file["markers"], "names": names, "time": file["time"], **systems}, None)


def in_time(found: Limbs, clip: Clip, reference: Reference) -> tuple[Limbs, dict[str, Limbs]]:
    """The truth and other systems' points at the clip's frames, at the offset at which the truth fits best."""
    best = min((_at(clip, reference, offset) for offset in _OFFSETS), key=lambda r: np.nanmean(_errors(found, clip, r)))
    frames = best.frames_of(len(clip), clip.first_frame, clip.frame_rate)

    def matched(points: np.ndarray) -> Limbs:
        return np.where(frames[:, None, None] >= 0, points[frames][:, kp.LIMBS], np.nan)

    return matched(best.points), {name: matched(points) for name, points in best.others.items()}


def _at(clip: Clip, reference: Reference, offset: float) -> Reference:
    assert reference.frame_rate is not None
    return at_frames_of(reference, clip.frame_rate, start=reference.first_frame / reference.frame_rate - offset)


def _errors(found: Limbs, clip: Clip, reference: Reference) -> np.ndarray:
    frames = reference.frames_of(len(clip), clip.first_frame, clip.frame_rate)
    return limb_pa_mpjpe(found, np.where(frames[:, None, None] >= 0, reference.points[frames][:, kp.LIMBS], np.nan))


def balancing(variant: Variant, camera: str) -> Rows:
    """A man who balances, beside points triangulated from four views; OpenPose's keypoints and the detector's own."""
    rows: Rows = {}
    for keypoints in ("OpenPose", "detected"):
        for focal in ("true", "auto"):
            sample = read(camera, focal=focal, detected=keypoints == "detected")
            assert sample.truth is not None
            params, seconds = variant.fitted(sample.clip)
            row, true = f"{camera}, {keypoints}, {focal} focal length", sample.truth[:, kp.LIMBS]
            for label, found in variant.limbs(params).items():
                rows[row + label] = _of_limbs(found, true) | {
                    "MPJPE mm": float(metrics.mpjpe(found, true, HIPS).mean())
                }
            rows[row] |= _smooth(variant, params) | {"s": seconds}
            if focal == "auto":
                rows[row] |= _of_focal(sample.clip.camera, read(camera).clip.camera.focal[0])
    return rows


def suite(variant: Variant, half: str) -> Rows:
    """A half of the motion suite."""
    chosen = [sequence for sequence in motion_sequences().values() if sequence.half == half]
    records, own, seconds = list[DepthRecord](), list[tuple[str, Limbs, Limbs]](), 0.0
    for sequence in chosen[:: _QUICK_WINDOWS if variant.quick else 1]:
        made = make_motion(sequence, focal="true")
        params, spent = variant.fitted(made.clip)
        joints = joints_in_space(variant.body, params)
        records.append(measured(made, joints, method="", seconds=spent))
        own.append((sequence.shot.cut, joints[:, LIMB_JOINTS], made.truth.joints[:, LIMB_JOINTS]))
        seconds += spent
    whole = [record for record in records if record.cut == "whole"]
    rows = {
        f"suite, {half}": _of_suite(records, [limbs for _, *limbs in own]),
        f"suite, {half}, whole": _of_suite(whole, [limbs for cut, *limbs in own if cut == "whole"]),
    }
    rows[f"suite, {half}"]["s"] = seconds
    return rows


_OF_SUITE = {
    "PA-MPJPE, mm": "PA-MPJPE mm",
    "MPJPE, mm": "MPJPE mm",
    "Lean, °": "trunk °",
    "Slip, mm/s": "slip mm/s",
}


def _of_suite(records: list[DepthRecord], limbs: list[list[Limbs]]) -> Figures:
    found, true = (np.concatenate(side) for side in zip(*limbs, strict=True))
    own = depth_figures(records, "")["all"]
    return _of_limbs(found, true) | {column: own[title] or 0.0 for title, column in _OF_SUITE.items()}


def standing(variant: Variant) -> Rows:
    """People who stand upright: how far trunks are off, and how far knees are bent (4 degrees in truth), medians."""
    trunks, knees, seconds = list[float](), list[float](), 0.0
    for number in range(_QUICK_PEOPLE if variant.quick else _PEOPLE):
        made = case(number, frames=25, focal="default")
        params, spent = variant.fitted(made.clip)
        joints, middle = joints_in_space(variant.body, params), len(params) // 2
        trunks.append(lean(joints[middle], made.joints[middle]))
        knees.append(bend(joints[middle]))
        seconds += spent
    return {"standing people": {"knee °": float(np.median(knees)), "trunk °": float(np.median(trunks)), "s": seconds}}


def carried(variant: Variant) -> Rows:
    """People who glide, turn, or are filmed by a camera that pans: as near to the keypoints as without held feet."""
    rows: Rows = {}
    for name, way in CARRIED.items():
        clip = carried_clip(variant.body, gesturing(way, frames=50 if variant.quick else 150))
        fits = {"px p95": variant.fitted(clip), "none held": variant.fitted(clip, variant.free)}
        rows[f"carried: {name}"] = {
            column: float(np.percentile(pixel_errors(variant.body, params, clip), 95))
            for column, (params, _) in fits.items()
        } | {"s": fits["px p95"][1]}
    return rows


def signer(variant: Variant, name: str) -> Rows:
    """A signer who sits upright: the trunk's lean, pelvis to neck."""
    clip = read(name).clip
    params, seconds = variant.fitted(clip)
    trunk = float(metrics.torso_lean(joints_in_space(variant.body, params)).mean())
    return {f"signer, {name}": {"trunk °": trunk} | _smooth(variant, params) | {"s": seconds}}


SETS: dict[str, Callable[[Variant], Rows]] = {
    **{name: partial(phone, name=name) for name in PHONES},
    **{name: partial(balancing, camera=name) for name in ("cam03", "cam04")},
    **{f"suite-{half}": partial(suite, half=half) for half in ("tuning", "untouched")},
    "standing": standing,
    "carried": carried,
    **{name: partial(signer, name=name) for name in ("gebaerden", "psychologie")},
}
"""By name: what fits and judges it."""
KEPT_APART = ("suite-untouched",)
"""Not looked at while something is being tuned."""
