"""The user's own rig in a project: its file, and the mapping file for its joints."""

from dataclasses import dataclass, replace
from pathlib import Path

from fitting_core.animation.rigs.mapping import Joints, guess_joints
from fitting_core.animation.rigs.skeleton import Skeleton
from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing, scratch_folder
from fitting_core.io.motion.rigs.mapping_file import RigMapping, read_mapping, read_skeleton, write_mapping
from tcfit_app.project.storage.names import name_of_file, portable

FOLDER, MAPPING = "rig", "mapping.toml"


@dataclass(frozen=True, kw_only=True, eq=False)
class KeptRig:
    """A project's rig."""

    mapping: Path
    """The mapping file's content; possibly incomplete."""
    rig: Path
    skeleton: Skeleton
    joints: Joints


def keep_rig(project: Path, name: str, content: bytes) -> KeptRig:
    """Store a rig in the project, replacing the previous one, with a mapping guessed from its joint names.

    Args:
        project: Its folder.
        name: The rig file's name.
        content: Its content.

    Raises:
        InputError: It is not a readable rig, or a .gltf that refers to other files, which were not included.
        OSError: It cannot be written.
    """
    shown = name_of_file(name)
    with scratch_folder() as scratch:
        read = scratch / f"rig{Path(shown).suffix.lower()}"
        read.write_bytes(content)
        try:
            skeleton = read_skeleton(read, whole=True)
        except InputError as error:
            raise InputError(str(error).replace(str(read), shown)) from error
    folder = project / FOLDER
    folder.mkdir(exist_ok=True)
    rig, mapping = folder / portable(shown), folder / MAPPING
    with replacing(rig) as draft:
        draft.write_bytes(content)
    kept = KeptRig(mapping=mapping, rig=rig, skeleton=replace(skeleton, source=shown), joints=guess_joints(skeleton))
    write_mapping(mapping, RigMapping(skeleton=rig, joints=kept.joints))
    for file in folder.iterdir():
        if file not in (rig, mapping) and file.is_file():
            file.unlink()
    return kept


def keep_joints(kept: KeptRig, joints: Joints) -> KeptRig:
    """Store another mapping for the rig. Raises OSError."""
    write_mapping(kept.mapping, RigMapping(skeleton=kept.rig, joints=joints))
    return replace(kept, joints=joints)


def kept_rig(project: Path) -> KeptRig | None:
    """The project's rig, if any. Raises InputError if its files can no longer be read."""
    path = project / FOLDER / MAPPING
    if not path.exists():
        return None
    mapping = read_mapping(path, checked=False)
    skeleton = replace(read_skeleton(mapping.skeleton), source=mapping.skeleton.name)
    return KeptRig(mapping=path, rig=mapping.skeleton, skeleton=skeleton, joints=mapping.joints)
