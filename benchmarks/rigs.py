"""A fit on rigs: how far joints, feet and hands are from the fit's, and a picture of all from the side.

python -m benchmarks.rigs RESULT [--picture docs/images/rigs.jpg] [--frame N]

The rig of other proportions is the person's own skeleton with legs, trunk and arms of other lengths, as a BVH that is
read by its names.
"""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import trimesh
import tyro
from jaxtyping import Float, UInt8
from tyro.conf import Positional

from fitting_core.animation.retargeting.retarget import Posed, RigMotion, turned
from fitting_core.animation.retargeting.target import Target
from fitting_core.animation.retargeting.touch import gaps, touches
from fitting_core.animation.rigs.animated import on_standard, surface_deviation, surface_on
from fitting_core.animation.rigs.known_rigs import MIXAMO, UNREAL, VRM
from fitting_core.animation.rigs.own_rig import on_own
from fitting_core.body.files.reading import load_body
from fitting_core.body.files.registry import find_body
from fitting_core.body.geometry import SIDES
from fitting_core.body.model import JOINT
from fitting_core.io.motion.rigs.mapping_file import read_mapping, read_skeleton
from fitting_core.io.motion.rigs.rig_bvh import write_rig_bvh
from fitting_core.io.motion_files import stored_motion
from fitting_core.io.result_files import read_fit
from fitting_core.motion import Motion
from fitting_core.render.renderer import DrawnMesh, Renderer
from fitting_core.render.sheets import View, beside

Image = UInt8[np.ndarray, "H W 3"]
_OTHER = {"Leg": 0.75, "Foot": 1.05, "Spine": 1.15, "ForeArm": 1.2, "Hand": 1.15, "LeftUpLeg": 1.3, "RightUpLeg": 1.3}
"""By the end of a Mixamo joint's name: what its offset is multiplied with."""
_SIDE = 65.0
"""Degrees from which the picture looks."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """What is measured."""

    result: Positional[Path]
    """A folder that tcfit fit wrote."""
    picture: Path | None = None
    """Where the picture goes."""
    frame: int | None = None
    """Which frame it shows; by default that in which a hand touches most, or the middle."""
    first: int = 0
    last: int | None = None
    """Frames of the result that are taken, from 0."""


def main(options: Options) -> None:
    """Measure, print, and draw."""
    stored = read_fit(options.result)
    body = load_body(find_body(gender=stored.gender))
    motion = stored_motion(stored, body, name=options.result.resolve().name).in_axes("y-up")
    motion = motion[options.first : options.last]
    posed, own = Posed.of(motion), _own(motion)
    found = touches(motion)
    print(f"{len(motion)} frames, {0 if motion.contacts is None else motion.contacts.share:.0%} with a foot standing")
    for standard in (MIXAMO, UNREAL, VRM):
        moving = on_standard(motion, standard)
        of = moving.target.of_joint
        off = max(np.abs(moving.places[:, k] - posed.places[:, JOINT[name]]).max() for name, k in of.items())
        skin = surface_deviation(motion, moving, surface_on(motion, moving))
        said = f"joints {1e3 * off:.4f} mm, skin at most {1e3 * skin.largest:.2f} mm, mean {1e3 * skin.mean:.3f}"
        print(f"{standard.title}: {said}")
    plain = turned(posed, own.target)
    print("own rig: slide of standing toes, mm per second in the person's size: fit, rest to rest alone, rig")
    for f, side in enumerate(SIDES):
        print(f"  {side}", *(f"{value:.1f}" for value in _slides(motion, posed, f, side, [plain, own])))
    for side in SIDES:
        touch = found[side]
        together = touch.share == 1.0
        if together.any():
            before, after = (_apart(m, motion, posed, side, found)[together] for m in (plain, own))
            print(
                f"  {side} hand touches in {together.sum()} frames: off by {1e3 * before.mean():.1f} mm before, "
                f"{1e3 * np.median(after):.2f} (median), {1e3 * after.max():.1f} (most) after"
            )
    if options.picture is not None:
        frame = options.frame
        if frame is None:
            shares = sum(touch.share for touch in found.values())
            frame = int(np.argmax(shares)) if np.max(shares) else len(motion) // 2
        _draw(options.picture, motion, own, frame)


def _own(motion: Motion) -> RigMotion:
    """On a rig of other proportions."""
    moving = on_standard(motion, MIXAMO)
    target, places = moving.target, moving.target.places.copy()
    for k, (name, p) in enumerate(zip(target.names, target.parents, strict=True)):
        if p >= 0:
            by = next((factor for end, factor in _OTHER.items() if name.endswith(end)), 1.0)
            places[k] = places[p] + by * (target.places[k] - target.places[p])
    with tempfile.TemporaryDirectory() as folder:
        still = RigMotion(
            target=Target(**{**vars_of(target), "places": places}),
            moved=moving.moved[:1],
            root=places[target.root][None],
            base=np.zeros(3),
        )
        write_rig_bvh(Path(folder) / "other.bvh", still, 30.0, unit=100.0)
        (Path(folder) / "rig.toml").write_text('skeleton = "other.bvh"\n')
        mapping = read_mapping(Path(folder) / "rig.toml")
        return on_own(motion, read_skeleton(mapping.skeleton), mapping.joints)


def vars_of(target: Target) -> dict:
    """The fields of a target."""
    return {name: getattr(target, name) for name in Target.__dataclass_fields__}


def _slides(motion: Motion, posed: Posed, f: int, side: str, movings: list[RigMotion]) -> list[float]:
    """How far standing toes go on the floor, millimetres a second: in the fit, and on rigs scaled back."""
    standing = np.ones(len(motion), bool) if motion.contacts is None else motion.contacts.standing[:, f]
    both = standing[1:] & standing[:-1]
    ways = [posed.places[:, JOINT[f"{side}_foot"]]]
    ways += [m.places[:, m.target.of_joint[f"{side}_foot"]] @ m.target.upright / m.target.scale for m in movings]
    speeds = [np.linalg.norm(np.diff(way[:, [0, 2]], axis=0), axis=1)[both] for way in ways]
    return [1e3 * float(speed.mean()) * motion.frame_rate if both.any() else float("nan") for speed in speeds]


def _apart(moving: RigMotion, motion: Motion, posed: Posed, side: str, found: dict) -> Float[np.ndarray, "T"]:
    touch = found[side]
    way = (gaps(moving, posed, side, touch, motion.body.parents) * touch.counts[..., None]).sum(1)
    return np.linalg.norm(way, axis=1) / moving.target.scale


# --- the picture ---


def _draw(path: Path, motion: Motion, own: RigMotion, frame: int) -> None:
    """The fit, Mixamo, the mannequin and the other rig, in one frame from the side."""
    fit = motion.mesh(motion.params[frame : frame + 1]).numpy()[0]
    middle = (fit.min(0) + fit.max(0)) / 2
    tall = float(np.ptp(fit[:, 1]))
    view = View(center=tuple(middle), extent=0.76 * tall, degrees=_SIDE, size=(330, 560))  # pyright: ignore[reportArgumentType]
    pictures = [_labelled(_surface(fit, motion.body.faces, view), "fit")]
    for standard in (MIXAMO, UNREAL):
        moving = on_standard(motion, standard)
        shown = surface_on(motion, moving).at(moving, slice(frame, frame + 1))[0]
        pictures.append(
            _labelled(_bones(_surface(shown, motion.body.faces, view), moving, frame, view), standard.title)
        )
    scaled = own.places[frame] @ own.target.upright / own.target.scale
    scaled += fit[:, 1].min() * np.array([0.0, 1.0, 0.0])
    blank = _surface(_balls(scaled, own.target), _ball_faces(scaled, own.target), view)
    pictures.append(_labelled(blank, "a rig of other proportions"))
    cv2.imwrite(str(path), cv2.cvtColor(beside(pictures), cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 85])


def _surface(vertices: np.ndarray, faces: np.ndarray, view: View) -> Image:
    drawn = Renderer(view.camera).draw([DrawnMesh(vertices=view.camera_space(vertices), faces=faces)])
    return np.ascontiguousarray(drawn.over())


def _rig_mesh(places: np.ndarray, target: Target) -> trimesh.Trimesh:
    parts = []
    for k in target.order_below_root:
        p = target.parents[k]
        radius = 0.007 if "Hand" in target.names[k] else 0.018
        parts.append(trimesh.creation.icosphere(subdivisions=1, radius=1.3 * radius).apply_translation(places[k]))
        if p >= 0 and np.linalg.norm(places[k] - places[p]) > 1e-4:
            parts.append(trimesh.creation.cylinder(radius=0.7 * radius, segment=[places[p], places[k]], sections=8))
    return trimesh.util.concatenate(parts)  # pyright: ignore[reportReturnType]


def _balls(places: np.ndarray, target: Target) -> np.ndarray:
    return np.asarray(_rig_mesh(places, target).vertices)


def _ball_faces(places: np.ndarray, target: Target) -> np.ndarray:
    return np.asarray(_rig_mesh(places, target).faces)


def _bones(image: Image, moving: RigMotion, frame: int, view: View) -> Image:
    """The rig's bones over its surface."""
    target, pixels = moving.target, view.pixels(moving.places[frame])
    for k in target.order_below_root:
        p = target.parents[k]
        if p >= 0 and k != target.root:
            ends = [tuple(int(v) for v in np.round(pixels[j])) for j in (p, k)]
            cv2.line(image, ends[0], ends[1], (196, 60, 40), 1, cv2.LINE_AA)
    return image


def _labelled(image: Image, text: str) -> Image:
    cv2.putText(image, text, (8, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (30, 30, 30), 1, cv2.LINE_AA)
    return image


if __name__ == "__main__":
    main(tyro.cli(Options))
