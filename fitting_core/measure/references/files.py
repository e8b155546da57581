"""Reading a reference of any form, recognised by content."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path

import numpy as np

from fitting_core.body.markers.marker_set import MarkerSet
from fitting_core.camera import Camera, World
from fitting_core.errors import InputError, some_of
from fitting_core.files.npz import npz_names, read_npz
from fitting_core.files.regular import StrPath
from fitting_core.io.result_files import FIT_NAME
from fitting_core.measure.references import bodies as reference_bodies
from fitting_core.measure.references import points as reference_points
from fitting_core.measure.references import reference
from fitting_core.measure.references.reference import Reference
from fitting_core.world_camera import WorldCamera, read_world_camera

TRUTH_NAME = "truth.npz"


@dataclass(frozen=True, kw_only=True)
class ReferenceSource:
    """Arguments of a reader."""

    path: Path
    camera: WorldCamera | None
    search: Path | None

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """All arrays of the file. Raises InputError if one is not a plain array."""
        try:
            return read_npz(self.path)
        except (OSError, ValueError) as error:
            raise InputError(
                f"{self.path}: {error}. Expected an npz archive of plain arrays: save it again with numpy.savez, "
                "without objects in it."
            ) from error


@dataclass(frozen=True, kw_only=True)
class ReferenceForm:
    """One form of npz."""

    keys: tuple[str, ...]
    """Arrays by which it is known."""
    title: str
    read: Callable[[ReferenceSource], Reference]


REFERENCE_FORMS = (
    ReferenceForm(
        keys=("format", "name", "points", "in_camera"),
        title="a reference stored by tcfit",
        read=lambda s: reference.read_stored(s.path, s.arrays),
    ),
    ReferenceForm(
        keys=("joints", "keypoints", "visible", "body_hash"),
        title="a truth of a generated clip (keypoints, visible, body_hash)",
        read=lambda s: reference_bodies.read_generated(s.path, search=s.search),
    ),
    ReferenceForm(
        keys=("format", "phase1_body_pose"),
        title="a fit.npz",
        read=lambda s: reference_bodies.read_other_fit(s.path, search=s.search),
    ),
    ReferenceForm(
        keys=("points", "names"),
        title="3D points (points, names)",
        read=lambda s: reference_points.read_points(s.path, s.arrays, s.camera),
    ),
    *(
        ReferenceForm(
            keys=keys,
            title=f"an AMASS-style npz ({', '.join(keys)})",
            read=lambda s: reference_bodies.read_amass(s.path, s.camera, s.search),
        )
        for keys in (("poses", "trans"), ("root_orient", "pose_body", "trans"))
    ),
)
"""Of npz, tried in this order."""
POINT_FILES = {".trc": ("OpenSim TRC", "trc:read_trc"), ".c3d": ("C3D", "c3d_file:read_c3d")}
"""Title of the format, and module and function that read its points, by suffix."""


def read_reference(
    path: StrPath,
    *,
    camera: StrPath | None = None,
    seen_by: Camera | None = None,
    search: StrPath | None = None,
    markers: MarkerSet | None = None,
) -> Reference:
    """Read a reference for a fit.

    Args:
        path: A file of one of FORMS, a .trc or .c3d file, or a folder with a truth.npz or fit.npz.
        camera: npz with R and t of the clip's camera in the reference's world, where that is not the camera's space.
        seen_by: The clip's camera. Where its calibration says where it stands, a reference that stands nowhere else is,
            without `camera`, taken to stand in that world too, and a note says so; unless it is not before the camera.
            No world puts a reference before a camera that moves: of such a one only the form is compared.
        search: A body model file or a folder that alone is searched for the reference's body.
        markers: What the points of a .trc or .c3d file are, where their names do not tell.

    Raises:
        InputError: It cannot be read as any of these, or its body model is not there; or a camera is given that stands
            still, where the clip's moves.
    """
    path = Path(path)
    camera = None if camera is None else Path(camera)
    search = None if search is None else Path(search)
    moves = seen_by is not None and seen_by.path is not None
    if camera is not None and moves:
        raise InputError(
            f"{camera}: is a camera that stands still, and the clip's moves; expected a reference in the space of the "
            "clip's camera, frame by frame, or one whose form alone is compared. Leave the camera out."
        )
    file = _file(path)
    form = _form(file, markers)

    def read(camera: WorldCamera | None) -> Reference:
        return form(ReferenceSource(path=file, camera=camera, search=search))

    found = read(None if camera is None else read_world_camera(camera))
    world = None if seen_by is None or moves else seen_by.world
    return found if found.in_camera or world is None else _in_world(found, read, world)


def _in_world(found: Reference, read: Callable[[WorldCamera], Reference], world: World) -> Reference:
    """The same before the clip's camera, where the world of the camera's calibration puts it there."""
    camera = WorldCamera.of(world)
    depth = camera(found.all_points)[..., 2]
    if not 0 < np.nanmedian(depth) <= reference_points.FARTHEST:
        where = "It is not before the clip's camera in the world of the camera's calibration"
        return replace(found, notes=(*found.notes, f"{where}: only form is compared."))
    up, trunk = world.up_in_world, reference_points.trunk_axis(found)
    if up is not None and trunk is not None and up @ trunk <= 0:
        axis = int(np.abs(trunk).argmax())
        along = ("-" if trunk[axis] < 0 else "") + "xyz"[axis]
        return replace(found, notes=(*found.notes, _TURNED.format(trunk=along, up=world.up)))
    placed = read(camera)
    return replace(placed, notes=(*placed.notes, "It is taken to stand in the world of the camera's calibration."))


_TURNED = (
    "The person's trunk points along {trunk} in it, but {up} is up in the world of the camera's calibration: only "
    "form is compared. Turn one of them, or say with --camera (in a project: --reference-camera) where the camera "
    "stands in the reference's world. Pose2Sim, for one, makes TRC files with y up from calibrations with z up: their "
    "x, y, z are the calibration's y, z, x."
)


def _form(file: Path, markers: MarkerSet | None) -> Callable[[ReferenceSource], Reference]:
    """The reader of a file, by its suffix or its content."""
    if read := POINT_FILES.get(file.suffix.lower()):
        return lambda source: _of_points(source, markers, *read)
    if markers is not None:
        raise InputError(f"{file}: --markers says what points of TRC and C3D are. Leave it out, or give such a file.")
    names = _names(file)
    for form in REFERENCE_FORMS:
        if all(key in names for key in form.keys):
            return lambda source: _of_arrays(source, form)
    found = some_of(names)
    known = "; ".join(form.title for form in REFERENCE_FORMS)
    raise InputError(f"{file}: holds {found}; expected {known}; or a .trc or .c3d file.")


def _of_points(source: ReferenceSource, markers: MarkerSet | None, kind: str, reader: str) -> Reference:
    module, name = reader.split(":")
    points = getattr(import_module(f"fitting_core.io.points.{module}"), name)(source.path)
    return reference_points.reference_of_points(source.path, kind, points, source.camera, markers)


def _of_arrays(source: ReferenceSource, form: ReferenceForm) -> Reference:
    try:
        return form.read(source)
    except InputError:
        raise
    except (KeyError, IndexError, TypeError, ValueError) as error:
        said = error if isinstance(error, ValueError) else repr(error)
        raise InputError(f"{source.path}: is {form.title}, but damaged ({said}). Take it from a backup.") from error


def _file(path: Path) -> Path:
    if not path.exists():
        raise InputError(f"{path}: does not exist; expected a reference. Correct --reference.")
    if not path.is_dir():
        return path
    for name in (TRUTH_NAME, FIT_NAME):
        if (path / name).is_file():
            return path / name
    raise InputError(f"{path}: is a folder without {TRUTH_NAME} and {FIT_NAME}; name a file in it.")


def _names(file: Path) -> tuple[str, ...]:
    try:
        return npz_names(file)
    except (OSError, ValueError) as error:
        raise InputError(f"{file}: is not an npz archive ({error}); expected one, or a .trc or .c3d file.") from error
