"""Whether left and right limbs are exchanged where a detector swapped them, and nowhere else.

The truth is known: standing people who turn, motion capture, the demo clip and the suite. Detections are exact, or as
the suite's simulated detector makes them; whatever sides are swapped was swapped here.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation
from tyro.conf import OmitArgPrefixes

from benchmarks.clips import data_folder
from benchmarks.figures import figure_of
from benchmarks.hard_poses import HARD_POSES
from benchmarks.report import Common, Row, progress, report, start
from build_assets.motion_capture.retarget import MotionClip, load
from evaluation.synthetic.acting.script import Build, Failure, failures
from evaluation.synthetic.motions import demo_script
from evaluation.synthetic.simulated_detector import Detector, detect, visible
from evaluation.synthetic.studio.view import View
from evaluation.synthetic.suite import LEVELS, MOTIONS, SEQUENCES, make_sequence, subject_body
from fitting_core.body.mesh import shared_mesh
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.camera import Camera
from fitting_core.clips.demo import demo_clip
from fitting_core.clips.reading import read_clip
from fitting_core.fit.evidence.sides import PAIRED, unswapped
from fitting_core.io.truth import read_truth
from fitting_core.keypoints import INDEX, Keypoints
from fitting_core.render.rasterize import rasterize
from fitting_core.world_camera import in_camera

CAMERA = Camera(focal=(900.0, 900.0), center=(480.0, 360.0), size=(960, 720), source="given")
STEPS = (1, 2, 4, 8, 12, 20, 30)
"""Degrees between frames."""
POSES = (
    "standing, arms hanging", "walking", "arms straight up", "arms forward", "hands on hips",
    "arms crossed",
)  # fmt: skip
"""Of HARD_POSES: standing people."""
CAMERA_HEIGHTS = (0.3, 1.4, 3.2)
RATES = {"24 to 60": 1, "8 to 20": 3, "4 to 10": 6}
"""Frames per second of motion capture, and which part of its frames that takes."""
SWAPPED_FRAMES: Mapping[str, Callable[[int], int]] = {
    "1": lambda _: 1,
    "2 to 4": lambda total: 2 + total % 3,
    "5 to 10": lambda total: 5 + total % 6,
    "20 % of the clip": lambda total: total // 5,
    "40 % of the clip": lambda total: 2 * total // 5,
}
LONGEST = 150
"""Frames taken of one clip of motion capture."""
_DEPTH_SCALE = 0.25
_LOOKED_AT = 5
"""What is hidden is told in every fifth frame, and stays so until the next."""
_APART = 0.2
"""Of the trunk's length in the image: where the two sides are nearer to each other, a swap hardly changes anything."""
_LIMBS = {name: np.array([left[:2], right[:2]]) for name, (left, right, _) in PAIRED.items()}
Detection = Literal["exact", "normal", "hard"]


@dataclass(frozen=True, kw_only=True)
class SwappedSides:
    """What to measure."""

    mocap: int = 40
    """How many clips of motion capture; 0: none."""
    mocap_data: Path | None = None
    """Folder with the motion capture; by default the development data's."""
    detections: tuple[Detection, ...] = ("exact", "normal", "hard")
    seed: int = 0
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """What a camera sees of a person, and how often."""

    name: str
    group: str
    xy: Float[np.ndarray, "T 137 2"]
    visible: Bool[np.ndarray, "T 137"]
    exists: Bool[np.ndarray, "137"]
    frame_rate: float

    def __len__(self) -> int:
        return len(self.xy)

    def taking(self, frames: np.ndarray, group: str, frame_rate: float) -> "Seen":
        """Some of the frames."""
        return replace(self, group=group, xy=self.xy[frames], visible=self.visible[frames], frame_rate=frame_rate)


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """Detections, and where they are swapped."""

    name: str
    group: str
    keypoints: Keypoints
    truth: Float[np.ndarray, "T 137 2"]
    """Where the keypoints really are, pixels."""
    swapped: Mapping[str, Bool[np.ndarray, "T"]] = field(default_factory=dict)
    """By pair of limbs."""


@dataclass(frozen=True, kw_only=True)
class Score:
    """Counts of frames, each pair of limbs on its own."""

    frames: int = 0
    false: int = 0
    """Exchanged although they were right."""
    swapped: int = 0
    """Swapped by the detector, with the two sides apart."""
    found: int = 0
    """Exchanged of these."""

    def __add__(self, other: "Score") -> "Score":
        return Score(**{name: value + getattr(other, name) for name, value in vars(self).items()})

    @property
    def row(self) -> Row:
        """Of a table."""
        return {
            "frames": str(self.frames),
            "exchanged wrongly, of 1000": 1000 * self.false / max(self.frames, 1),
            "swapped": str(self.swapped) if self.swapped else None,
            "of them found, %": 100 * self.found / self.swapped if self.swapped else None,
        }


def score(case: Case) -> Score:
    """How `unswapped` does on a case."""
    swaps, total = unswapped(case.keypoints)[1], Score()
    trunk = case.truth[:, INDEX["neck"]] - case.truth[:, INDEX["mid_hip"]]
    far = _APART * np.percentile(np.linalg.norm(trunk, axis=1), 90)
    for name, limbs in _LIMBS.items():
        found = np.zeros(len(case.keypoints), bool)
        found[swaps.get(name, [])] = True
        truth = case.swapped.get(name, np.zeros(len(found), bool))
        left, right = np.moveaxis(case.truth[:, limbs], 1, 0)
        apart = truth & (np.linalg.norm(left - right, axis=-1).mean(1) > far)
        total += Score(
            frames=len(found),
            false=int((found & ~truth).sum()),
            swapped=int(apart.sum()),
            found=int((found & apart).sum()),
        )
    return total


def seen(body: BodyModel, world: BodyParams, view: View, name: str, group: str, frame_rate: float) -> Seen | None:
    """People in the world before the camera; None if one comes too near to it."""
    params = in_camera(world, body.rest_joints[0], view.pose())
    points, exists = keypoints_in_space(body, params)
    if points[:, exists, 2].min() < 0.5:
        return None
    small = Camera(
        focal=(_DEPTH_SCALE * CAMERA.focal[0], _DEPTH_SCALE * CAMERA.focal[1]),
        center=(_DEPTH_SCALE * CAMERA.center[0], _DEPTH_SCALE * CAMERA.center[1]),
        size=(round(_DEPTH_SCALE * CAMERA.size[0]), round(_DEPTH_SCALE * CAMERA.size[1])),
        source=CAMERA.source,
    )
    mesh, unhidden = shared_mesh(body), np.zeros(points.shape[:2], bool)
    for i in range(0, len(points), _LOOKED_AT):
        depth = np.full(small.size[::-1], np.inf)
        rasterize(mesh(params[i : i + 1])[0].numpy().astype(np.float64), body.faces, small, depth)
        unhidden[i : i + _LOOKED_AT] = exists & visible(points[i], depth, small)
    xy = np.zeros((*points.shape[:2], 2))
    xy[:, exists] = points[:, exists, :2] / points[:, exists, 2:] * CAMERA.focal + CAMERA.center
    return Seen(name=name, group=group, xy=xy, visible=unhidden, exists=exists, frame_rate=frame_rate)


def turning(body: BodyModel) -> Iterator[Seen]:
    """Standing people who turn on the spot: once if slowly, else twice."""
    poses = {pose.name: pose for pose in HARD_POSES}
    for name in POSES:
        figure = figure_of(body, poses[name])
        yaw = Rotation.from_euler("y", np.arange(360.0)[:, None], degrees=True)
        orient = (yaw * Rotation.from_rotvec(figure.global_orient.numpy())).as_rotvec()
        place = np.array([0.0, 0.95, 0.0]) - body.rest_joints[0]
        people = replace(
            figure[[0] * 360],
            global_orient=torch.as_tensor(orient),
            camera_translation=torch.as_tensor(np.tile(place, (360, 1))),
        )
        for height in CAMERA_HEIGHTS:
            view = View(azimuth=0.0, height=height, distance=3.6, looking_at=(0.0, 0.95, 0.0))
            whole = seen(body, people, view, f"{name} from {height} m", "", 25.0)
            assert whole is not None
            for step in STEPS:
                frames = np.arange(0, 360 if step < 8 else 720, step) % 360
                yield whole.taking(frames, f"turning by {step} degrees a frame", 25.0)


def walking(body: BodyModel, folder: Path, count: int) -> Iterator[Seen]:
    """Motion capture from all around, the camera going along: those clips that turn most, and others."""
    clips = [clip for clip in load(folder) if len(clip.body_pose) >= 30]
    clips.sort(key=lambda clip: -np.ptp(np.unwrap(np.arctan2(clip.orient[:, 0, 2], clip.orient[:, 2, 2]))))
    chosen = [*clips[: count // 2], *clips[count // 2 :: max(1, (len(clips) - count // 2) // (count - count // 2))]]
    for i, clip in enumerate(chosen[:count]):
        view = View(azimuth=77.0 * i, height=(0.8, 1.5, 2.6)[i % 3], distance=3.6, looking_at=(0.0, 0.95, 0.0))
        whole = seen(body, _on_the_spot(body, clip), view, clip.name, "", clip.fps)
        if whole is None:
            continue
        for rate, every in RATES.items():
            if len(whole) >= 8 * every:
                frames = np.arange(0, len(whole), every)
                yield whole.taking(frames, f"motion capture, {rate} frames a second", clip.fps / every)


def _on_the_spot(body: BodyModel, clip: MotionClip) -> BodyParams:
    """The longest stretch without a gap, in the world, without its way over the floor."""
    runs = np.split(np.arange(len(clip.frames)), np.flatnonzero(np.diff(clip.frames) > 1) + 1)
    run = max(runs, key=len)[:LONGEST]
    pelvis = clip.pelvis[run] * [0.0, 1.0, 0.0]
    lowest = np.percentile(clip.feet[run][..., 1].min(1), 5)
    pelvis[:, 1] += 0.08 - lowest
    return replace(
        BodyParams.neutral(len(run)),
        global_orient=torch.as_tensor(Rotation.from_matrix(clip.orient[run]).as_rotvec()),
        body_pose=torch.as_tensor(clip.body_pose[run]),
        camera_translation=torch.as_tensor(pelvis - body.rest_joints[0]),
    )


def detected(what: Seen, detection: Detection, rng: np.random.Generator, swaps: tuple[Failure, ...] = ()) -> Keypoints:
    """The detections, with some failures."""
    detector = Detector(noise=0.0) if detection == "exact" else LEVELS[detection].detector
    found = detect(
        what.xy, what.visible, what.exists,
        frame_rate=what.frame_rate, height=CAMERA.size[1], failures=swaps, rng=rng, detector=detector,
    )  # fmt: skip
    if detection != "exact":
        return found
    return replace(found, confidence=np.tile(what.exists.astype(float), (len(what), 1)))


def right_cases(options: SwappedSides, people: list[Seen]) -> Iterator[Case]:
    """Without any swap."""
    for detection in options.detections:
        for i, what in enumerate(people):
            keypoints = detected(what, detection, np.random.default_rng([options.seed, i]))
            yield Case(name=what.name, group=f"{what.group}, {detection}", keypoints=keypoints, truth=what.xy)


def swapped_cases(options: SwappedSides, people: list[Seen]) -> Iterator[Case]:
    """With one stretch of one pair of limbs swapped."""
    for detection in options.detections:
        for i, what in enumerate(people):
            for j, (length, frames_of) in enumerate(SWAPPED_FRAMES.items()):
                rng = np.random.default_rng([options.seed, i, j])
                pair, frames = ("arms", "legs")[(i + j) % 2], frames_of(len(what))
                first = int(rng.integers(0, len(what) - frames + 1))
                swap = Failure("swapped", first / what.frame_rate, (first + frames) / what.frame_rate, (pair,))
                yield Case(
                    name=what.name,
                    group=f"{pair}, {length}, {detection}",
                    keypoints=detected(what, detection, rng, (swap,)),
                    truth=what.xy,
                    swapped=_truth((swap,), len(what), what.frame_rate),
                )


def _truth(happened: tuple[Failure, ...], frames: int, frame_rate: float) -> dict[str, np.ndarray]:
    """Where the detector swapped sides, by pair, as `detect` counts time."""
    times, swapped = np.arange(frames) / frame_rate, {name: np.zeros(frames, bool) for name in PAIRED}
    for failure in happened:
        if failure.kind == "swapped":
            for pair in failure.groups:
                swapped[pair] |= (times >= failure.start - 1e-9) & (times < failure.stop - 1e-9)
    return swapped


def own_cases() -> Iterator[Case]:
    """The demo clip and the suite, as they come."""
    demo = demo_clip()
    keypoints, truth = read_clip(demo.video, demo.keypoints).keypoints, read_truth(demo.truth)
    yield Case(
        name="demo",
        group="demo clip",
        keypoints=keypoints,
        truth=truth.keypoints,
        swapped=_truth(demo_script.FAILURES, len(keypoints), truth.frame_rate),
    )
    for sequence in SEQUENCES.values():
        progress(sequence.name)
        build = Build.of(subject_body(sequence.subject), sequence.subject.betas)
        _, hazards = MOTIONS[sequence.motion](build, sequence.seconds, np.random.default_rng([sequence.seed, 1]))
        for level in LEVELS:
            made = make_sequence(sequence, level)
            happened = failures(hazards, LEVELS[level].mishaps, np.random.default_rng([sequence.seed, 2]))
            yield Case(
                name=f"{sequence.name} {level}",
                group=f"suite, {level}",
                keypoints=made.clip.keypoints,
                truth=made.truth.keypoints,
                swapped=_truth(tuple(happened), sequence.frames, sequence.frame_rate),
            )


def table(cases: Iterator[Case]) -> list[Row]:
    """A row for each group, in the order in which they come."""
    scores: dict[str, Score] = {}
    for case in cases:
        scores[case.group] = scores.get(case.group, Score()) + score(case)
    return [{"data": group, **total.row} for group, total in scores.items()]


def run(options: SwappedSides) -> None:
    """Makes the data, and reports."""
    body = options.common.load_body()
    progress("people who turn")
    people = list(turning(body))
    if options.mocap:
        progress("motion capture")
        people += walking(body, options.mocap_data or data_folder() / "mocap", options.mocap)
    slow = [what for what in people if what.group.split(" by ")[-1][:2] in ("2 ", "4 ") or "24 to 60" in what.group]
    report(
        options,
        {
            "Sides that are right": table(right_cases(options, people)),
            "Sides swapped for some frames": table(swapped_cases(options, slow)),
            "Demo clip and suite": table(own_cases()),
        },
    )


if __name__ == "__main__":
    start(SwappedSides, run)
