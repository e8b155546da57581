"""Shows what retargeting does: a sheet of source skeletons beside the bodies that they became, and figures.

    python -m benchmarks.retargeting DATA SHEET.png
        [--poses 30] [--clips 13_18 13_26:200]

Figures: by how many degrees bones point elsewhere than in the source, how much of the elbows' and knees' rotation is
not about their hinge, and how many frames were dropped.
"""

import argparse
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from build_assets.motion_capture.mocap import read_motions
from build_assets.motion_capture.plausible import plausible
from build_assets.motion_capture.retarget import retarget
from build_assets.motion_capture.rigs import RIGS, SIDES, Rig
from build_assets.motion_capture.skeleton import SourceMotion
from fitting_core.body.files.reading import load_body
from fitting_core.body.files.registry import find_body
from fitting_core.body.geometry import twist
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import JOINT
from fitting_core.body.params import BodyParams
from fitting_core.errors import InputError
from fitting_core.render.sheets import Cell, beside, write_sheet
from fitting_core.shipped import FREE_FOLDER
from tests.samples.body_pictures import body_picture, fitted_views, skeleton_picture

VIEWS = (0.0, 70.0)
"""Degrees from which each pose is shown: in front, and from its left a little from the front."""
SIZE = (220, 260)
COLUMNS = 2
COLORS = {"l": (60, 80, 200), "r": (200, 60, 60)}
"""sRGB of a skeleton's sides, by the first letter of their joints' names."""
_MIDDLE = (90, 90, 90)


@dataclass(frozen=True, kw_only=True, eq=False)
class Retargeted:
    """A clip, and the poses that became of it."""

    motion: SourceMotion
    pose: Float[np.ndarray, "T 63"]
    kept: Bool[np.ndarray, "T"]
    """Frames that are plausible."""

    @property
    def rig(self) -> Rig:
        """The source's joints."""
        return RIGS[self.motion.source]

    def params(self, frames: Sequence[int] | np.ndarray) -> BodyParams:
        """The body in the source's world, without its way through it."""
        root = Rotation.from_matrix(self.motion.world(self.rig.pelvis)[frames]).as_rotvec()
        neutral = BodyParams.neutral(len(frames))
        orient, pose = torch.as_tensor(root), torch.as_tensor(self.pose[frames])
        return BodyParams(**{**vars(neutral), "global_orient": orient, "body_pose": pose})


def read_retargeted(folder: Path, clips: Iterable[str] = ()) -> list[Retargeted]:
    """All clips of a folder, or those that are named.

    Raises:
        InputError: As for `mocap.read_motions`, or a named clip is not there.
    """
    motions, names = list(read_motions(folder)), set(clips)
    if missing := names - {motion.name for motion in motions}:
        raise InputError(f"{folder}: has no clip {', '.join(sorted(missing))}. Name clips such as {motions[0].name}.")
    chosen = [motion for motion in motions if not names or motion.name in names]
    poses = [retarget(motion) for motion in chosen]
    return [Retargeted(motion=m, pose=p, kept=plausible(p, m.fps)) for m, p in zip(chosen, poses, strict=True)]


def chosen_frames(
    clips: Sequence[Retargeted], wanted: Sequence[str], count: int, seed: int
) -> list[tuple[Retargeted, int]]:
    """The frames named as CLIP:FRAME; if none is, random plausible ones."""
    by_name = {clip.motion.name: clip for clip in clips}
    named = [(by_name[name], int(frame)) for name, _, frame in (w.partition(":") for w in wanted) if frame]
    if named:
        return [(clip, min(frame, len(clip.pose) - 1)) for clip, frame in named]
    every = [(clip, int(frame)) for clip in clips for frame in np.flatnonzero(clip.kept)]
    picked = np.random.default_rng(seed).permutation(len(every))[:count]
    return [every[i] for i in picked]


def comparison(clip: Retargeted, frame: int, mesh: Mesh) -> Cell:
    """The source's skeleton and the body from the same places, turned to face the first of them."""
    params = clip.params([frame])
    facing = _unyaw(Rotation.from_rotvec(params.global_orient[0].numpy()))
    vertices, hips = (facing.apply(a[0].double().numpy()) for a in (mesh(params), mesh.joints(params)[:, 1:3]))
    motion, rig = clip.motion, clip.rig
    skeleton = facing.apply(motion.positions[frame])
    thighs = [motion.skeleton.index(rig.name_of(side, rig.leg.upper)) for side in SIDES]
    skeleton += hips.mean(axis=0) - skeleton[thighs].mean(axis=0)
    colors = [COLORS.get(name[0], _MIDDLE) if name != "root" else _MIDDLE for name in motion.skeleton.joints]
    pictures = []
    for view in fitted_views(np.concatenate([vertices, skeleton]), VIEWS, size=SIZE):
        pictures.append(skeleton_picture(skeleton, motion.skeleton.parents, view, colors=colors))
        pictures.append(body_picture(vertices, mesh.body.faces, view))
    return Cell(picture=beside(pictures), caption=f"{motion.name}:{frame}  {motion.description}")


def bone_errors(clips: Iterable[Retargeted], mesh: Mesh) -> dict[str, Float[np.ndarray, "N"]]:
    """Degrees between the directions of a bone in the source and in the body, of both sides, for plausible frames."""
    found: dict[str, list[np.ndarray]] = {}
    for clip in clips:
        frames = np.flatnonzero(clip.kept)
        if not len(frames):
            continue
        body = mesh.joints(clip.params(frames)).double().numpy()
        for side in SIDES:
            for bone, (source, ours) in _bones(clip.rig, side).items():
                a = _direction(clip.motion.positions[frames], [clip.motion.skeleton.index(n) for n in source])
                b = _direction(body, [JOINT[n] for n in ours])
                cosine = np.clip((a * b).sum(-1), -1, 1)
                found.setdefault(bone, []).append(np.degrees(np.arccos(cosine)))
    return {bone: np.concatenate(angles) for bone, angles in found.items()}


def off_hinge(pose: Float[np.ndarray, "T 63"]) -> dict[str, float]:
    """Share of the squared angle that is not about the hinge, of elbows (without the forearm's twist) and knees."""
    joints = pose.reshape(len(pose), -1, 3)
    shares = {}
    for name, hinge in (("elbow", 1), ("knee", 0)):
        both = Rotation.from_rotvec(np.concatenate([joints[:, JOINT[f"{side}_{name}"] - 1] for side in SIDES]))
        if name == "elbow":
            both = both * Rotation.from_euler("x", twist(both, np.array([1.0, 0.0, 0.0]))[:, None]).inv()
        squared = (both.as_rotvec() ** 2).sum(axis=0)
        shares[name] = float(1 - squared[hinge] / squared.sum())
    return shares


def report(clips: Sequence[Retargeted], mesh: Mesh) -> str:
    """The figures as text."""
    lines = []
    for source in dict.fromkeys(clip.motion.source for clip in clips):
        own = [clip for clip in clips if clip.motion.source == source]
        frames, kept = sum(len(clip.kept) for clip in own), sum(int(clip.kept.sum()) for clip in own)
        lines.append(f"{source}: {len(own)} clips, {frames} frames, {frames - kept} of them not plausible")
        for bone, angles in bone_errors(own, mesh).items():
            middle, high = np.percentile(angles, (50, 95))
            lines.append(f"  {bone:10} {middle:5.1f} degrees off (median), {high:5.1f} (95 %)")
        for name, share in off_hinge(np.concatenate([clip.pose[clip.kept] for clip in own])).items():
            lines.append(f"  {name:10} {share:6.2%} of the squared angle is not about the hinge")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.retargeting",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("data", type=Path, help="folder that holds cmu and deepmimic, or one of them")
    parser.add_argument("sheet", type=Path, help="picture to write, such as sheet.png")
    parser.add_argument("--poses", type=int, default=30, help="how many random poses to show")
    parser.add_argument("--seed", type=int, default=0, help="of their choice")
    parser.add_argument("--clips", nargs="+", default=[], help="only these: CLIP, or CLIP:FRAME for a certain frame")
    options = parser.parse_args(arguments)
    try:
        clips = read_retargeted(options.data, [name.partition(":")[0] for name in options.clips])
        mesh = Mesh(load_body(find_body(search=FREE_FOLDER)))
        frames = chosen_frames(clips, options.clips, options.poses, options.seed)
        write_sheet(options.sheet, [comparison(clip, frame, mesh) for clip, frame in frames], COLUMNS)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(report(clips, mesh))
    return 0


def _unyaw(root: Rotation) -> Rotation:
    """The turn about the vertical after which the body faces +z, or if it lies, its head points there."""
    up, forward = root.apply([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    level = forward if abs(forward[1]) < 0.9 else up
    return Rotation.from_euler("y", -np.arctan2(level[0], level[2]))


def _bones(rig: Rig, side: str) -> dict[str, tuple[list[str], list[str]]]:
    """Joints of the source and of the body: a bone leads from the middle of all but the last to the last."""

    def pair(source: Sequence[str], ours: Sequence[str]) -> tuple[list[str], list[str]]:
        return [rig.name_of(side, name) for name in source], [f"{side}_{name}" for name in ours]

    hips = [rig.name_of(s, rig.leg.upper) for s in SIDES]
    return {
        "upper arm": pair((rig.arm.upper, rig.arm.lower), ("shoulder", "elbow")),
        "forearm": pair((rig.arm.lower, rig.hand), ("elbow", "wrist")),
        "thigh": pair((rig.leg.upper, rig.leg.lower), ("hip", "knee")),
        "shank": pair((rig.leg.lower, rig.foot), ("knee", "ankle")),
        "trunk": ([*hips, "neck"], ["left_hip", "right_hip", "neck"]),
    }


def _direction(positions: Float[np.ndarray, "T J 3"], joints: Sequence[int]) -> Float[np.ndarray, "T 3"]:
    bone = positions[:, joints[-1]] - positions[:, joints[:-1]].mean(axis=1)
    return bone / np.linalg.norm(bone, axis=-1, keepdims=True)


if __name__ == "__main__":
    sys.exit(main())
