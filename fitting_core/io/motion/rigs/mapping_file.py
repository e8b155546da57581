"""The user's own rig: a small TOML file beside a BVH, GLB or glTF, which maps its joints.

    skeleton = "hero.glb"            # in the folder of this file

    [joints]
    pelvis = "Hips"
    spine = ["Spine", "Spine1"]      # any number, from below to above; neck too
    left_hip = "LeftUpLeg"           # SMPL-X's names: the thigh begins at the hip
    jaw = ""                         # the rig has none

Joints that the table leaves out are guessed by name, and "" says that the rig has no such joint. If the rig itself is
given instead of this file, everything is guessed.
"""

from dataclasses import dataclass
from pathlib import Path

from fitting_core.animation.rigs.mapping import Joints, check_joints, guess_joints
from fitting_core.animation.rigs.parts import CHAINS, PARTS, meant
from fitting_core.animation.rigs.skeleton import Skeleton
from fitting_core.errors import InputError, some_of
from fitting_core.files.atomic import replacing
from fitting_core.files.regular import regular_file
from fitting_core.files.toml_text import parsed_toml
from fitting_core.io.motion.rigs.bvh_skeleton import read_bvh_skeleton
from fitting_core.io.motion.rigs.gltf_file import read_gltf
from fitting_core.io.motion.rigs.gltf_skeleton import gltf_skeleton

_MOST = 2**20
"""Limit for a mapping file, in bytes."""
_GLTF = (".glb", ".gltf", ".vrm")
_TO_CONVERT = (".fbx", ".blend", ".dae", ".usd")
"""Rig formats that are not read."""


@dataclass(frozen=True, kw_only=True)
class RigMapping:
    """A mapping file."""

    skeleton: Path
    """The rig's file."""
    joints: Joints


def read_skeleton(path: Path, *, whole: bool = False) -> Skeleton:
    """The skeleton of a .bvh, .glb, .gltf or .vrm file, with the names to choose from. Raises InputError if it is not
    one of these, or cannot be read.

    Args:
        path: The file.
        whole: Require everything that the file refers to, surface and images included.
    """
    ending = path.suffix.lower()
    if ending == ".bvh":
        return read_bvh_skeleton(path)
    if ending in _GLTF:
        return gltf_skeleton(read_gltf(path, with_data=whole))[0]
    hint = " Convert it to GLB, for example with Blender." if ending in _TO_CONVERT else ""
    raise InputError(f"{path}: {ending or 'no ending'} is not read as a rig; expected .glb, .gltf, .vrm or .bvh.{hint}")


def read_mapping(path: Path, *, checked: bool = True) -> RigMapping:
    """Read a mapping file, fill it in by joint names, and check it unless it is still being edited. Raises InputError
    if the mapping cannot be read or used, or the rig cannot be read.

    Args:
        path: The mapping file, or the rig itself, for which everything is guessed.
        checked: Refuse a mapping that cannot be used.
    """
    is_rig = path.suffix.lower() in (*_GLTF, ".bvh", *_TO_CONVERT)
    table = {} if is_rig else _table(path)
    skeleton = path if is_rig else _skeleton_path(path, table)
    stated = table.get("joints", {})
    if not isinstance(stated, dict):
        raise InputError(f"{path}: joints is {stated!r}, expected a table: [joints], and a line for each part.")
    rig = read_skeleton(skeleton)
    given = {part: _names(path, part, value) for part, value in stated.items()}
    taken = {name for names in given.values() for name in names}
    rest = {part: names for part, names in guess_joints(rig).items() if part not in given}
    kept = {part: tuple(name for name in names if name not in taken) for part, names in rest.items()}
    both = given | kept
    joints = {part: both[part] for part in (*PARTS, *(set(both) - set(PARTS))) if both.get(part)}
    try:
        if checked:
            check_joints(joints, rig)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return RigMapping(skeleton=skeleton, joints=joints)


def _table(path: Path) -> dict:
    try:
        content = regular_file(path, most=_MOST).read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}).") from error
    try:
        table = parsed_toml(content.decode("utf-8-sig"))
    except ValueError as error:
        raise InputError(
            f'{path}: is not a TOML file ({error}). Expected a line like skeleton = "hero.glb", and a table [joints].'
        ) from None
    if unknown := sorted(set(table) - {"skeleton", "joints"}):
        raise InputError(f"{path}: {some_of(unknown)} is unknown; expected skeleton and [joints].")
    return table


def _skeleton_path(path: Path, table: dict) -> Path:
    name = table.get("skeleton")
    if not isinstance(name, str) or not name:
        raise InputError(f'{path}: skeleton is {name!r}, expected the name of the rig\'s file: skeleton = "hero.glb".')
    skeleton = path.parent / name
    if not _is_there(skeleton):
        raise InputError(
            f"{path}: names the rig {name!r}, which is not in its folder. Put it there, or correct the name."
        )
    return skeleton


def _is_there(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # the name is too long
        return False


def _names(path: Path, part: str, value: object) -> tuple[str, ...]:
    names = [value] if isinstance(value, str) else value
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise InputError(f"{path}: {part} is {value!r}, expected a name, or a list of names for spine and neck.")
    return tuple(name for name in names if name)


def write_mapping(path: Path, mapping: RigMapping) -> None:
    """Write a mapping file. Parts that the rig lacks are written as "", so that they are not guessed.

    Raises:
        InputError: The rig is not in the file's folder or below it.
        OSError: It cannot be written; nothing is left of it.
    """
    folder, rig = path.parent.resolve(), mapping.skeleton.resolve()
    if not rig.is_relative_to(folder):
        raise InputError(f"{path}: the rig {mapping.skeleton} is not in its folder. Copy one to the other.")
    lines = [f"skeleton = {_quoted(rig.relative_to(folder).as_posix())}", "", "[joints]"]
    for part in PARTS:
        names = mapping.joints.get(part, ())
        value = f"[{', '.join(map(_quoted, names))}]" if part in CHAINS else _quoted("".join(names[:1]))
        lines.append(f"{part} = {value}" + (f"  # {meant(part)}" if meant(part) != part else ""))
    with replacing(path) as draft:
        draft.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in escaped) + '"'
