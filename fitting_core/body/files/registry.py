"""Where body models lie, and how a user's own get there.

Searched in this order: what the caller gives; the folders in the environment variable TCFIT_BODY_MODELS; the user's
data folder, where `register` puts models; the free bodies that come with tcfit.
"""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Literal, TypeVar

import platformdirs

from fitting_core.body.files.forms import KINDS
from fitting_core.body.files.raw_file import BODY_READERS, vertex_count
from fitting_core.body.files.reading import gender_of_name, load_body
from fitting_core.errors import InputError
from fitting_core.files.archives import Member, files_below, open_members
from fitting_core.files.atomic import drafting, sync
from fitting_core.files.regular import StrPath, at_home, regular_file
from fitting_core.shipped import FREE_FOLDER

ENVIRONMENT = "TCFIT_BODY_MODELS"
"""Environment variable with folders of body models, separated as in PATH."""
GENDERS = ("neutral", "male", "female", "child")
"""Includes the child, because files are distinguished by gender; only the free bodies have one."""

_NAMED = re.compile(r"(smplx|smplh|smpl)_(?:neutral|male|female|child)", re.IGNORECASE)
_SMPL_NAMED = re.compile(r"basicmodel_(?:neutral|m|f)_lbs_.*", re.IGNORECASE)
AnyPath = TypeVar("AnyPath", bound=PurePath)


@dataclass(frozen=True, kw_only=True)
class BodyFile:
    """A body model on this computer."""

    kind: str
    """"smplx", "smplh" or "smpl"."""
    gender: str
    """"neutral", "male", "female" or "child"."""
    path: Path
    origin: Literal["free", "user"]
    """Whether it came with tcfit or is the user's own."""
    vertices: int = 0
    problem: str = ""
    """Why it cannot be read, empty if it can."""


def user_folder() -> Path:
    """Where `register` puts models; it may not exist yet."""
    return platformdirs.user_data_path("tcfit", appauthor=False) / "bodies"


def search_folders() -> list[Path]:
    """Folders that are searched when none is given, first to last. Raises InputError if the environment variable names
    something that is not a folder."""
    given = [at_home(part) for part in os.environ.get(ENVIRONMENT, "").split(os.pathsep) if part]
    for folder in given:
        if not folder.is_dir():
            raise InputError(f"{folder}: is not a folder, but {ENVIRONMENT} names it. Correct or unset that variable.")
    return [*given, user_folder(), FREE_FOLDER]


def find_body(*, model: str = "smplx", gender: str = "neutral", search: StrPath | None = None) -> Path:
    """File of a body model.

    Args:
        model: "smplx", "smplh" or "smpl".
        gender: "neutral", "male", "female" or "child".
        search: A model file, which is taken as it is, or a folder, which alone is searched then. A body that was asked
            for by its place is never replaced by another. None: `search_folders`.

    Raises:
        InputError: Not found; the message names the file, the folders searched and what to do.
    """
    search = None if search is None else Path(search)
    _check_choice("body model", model, tuple(KINDS))
    _check_choice("gender", gender, GENDERS)
    if search is not None and not search.is_dir():
        return _model_file(search)
    folders = [search] if search is not None else search_folders()
    for folder in folders:
        if (model, gender) in (found := _bodies_in(folder)):
            return found[model, gender]
    raise InputError(_not_found(model, gender, folders))


def list_bodies(search: StrPath | None = None) -> list[BodyFile]:
    """All body models found, those first that `find_body` prefers; broken ones with their problem.

    Args:
        search: A folder that alone is searched. None: `search_folders`.

    Raises:
        InputError: The environment variable names something that is not a folder.
    """
    search = None if search is None else Path(search)
    folders = [search] if search is not None else search_folders()
    return [_record(kind, gender, path) for folder in folders for (kind, gender), path in _bodies_in(folder).items()]


def register(path: Path) -> list[BodyFile]:
    """Copy body models into the user's folder, where `find_body` finds them from then on. Raises InputError if there is
    no model in it, or one is damaged; nothing is registered then.

    All models of the path are copied and read first; only if all are sound they take their places, each in one step.
    A model of the same kind and gender that was registered before is replaced.

    Args:
        path: A model file, a folder, or an archive as downloaded (zip, tar).
    """
    folder = user_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with drafting(folder / "incoming") as incoming:
            incoming.mkdir()
            with open_members(path) as members:
                chosen = _models_among(path, members)
                copies = [_copy(member, incoming / str(i)) for i, member in enumerate(chosen)]
            checked = [(copy, *_kind_and_gender(copy, member)) for copy, member in zip(copies, chosen, strict=True)]
            return [_place(copy, kind, gender, folder) for copy, kind, gender in checked]
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be written ({error.strerror or error}). Free space or correct it."
        ) from error


def file_name(kind: str, gender: str, suffix: str = ".npz") -> str:
    """Name under which a model is registered, which is also that of the official files: SMPLX_NEUTRAL.npz."""
    return f"{kind.upper()}_{gender.upper()}{suffix}"


def _identify(path: PurePath) -> tuple[str, str] | None:
    """Kind and gender of a model file by its name; None if it is not named as models are.

    Official names are SMPLX_NEUTRAL, SMPLH_male, basicModel_f_lbs_10_207_0_v1.0.0 and smplh/female/model.
    """
    gender = gender_of_name(path)
    if path.suffix.lower() not in BODY_READERS or gender is None:
        return None
    if named := _NAMED.fullmatch(path.stem):
        return named.group(1).lower(), gender
    if _SMPL_NAMED.fullmatch(path.stem):
        return "smpl", gender
    above = path.parent.parent.name.lower()
    return (above, gender) if path.stem.lower() == "model" and above in KINDS else None


def _preferred(paths: Sequence[AnyPath]) -> dict[tuple[str, str], AnyPath]:
    """For each kind and gender the file to take: the least deep, npz before pickle, the highest version."""
    # Stable sort: of equal ones the last name stays first.
    ordered = sorted(sorted(paths, reverse=True), key=lambda p: (len(p.parts), p.suffix.lower() != ".npz"))
    found: dict[tuple[str, str], AnyPath] = {}
    for path in ordered:
        if identity := _identify(path):
            found.setdefault(identity, path)
    return found


def _bodies_in(folder: Path) -> dict[tuple[str, str], Path]:
    found = _preferred(list(files_below(folder.absolute())))
    order = [(kind, gender) for kind in KINDS for gender in GENDERS]
    return {identity: found[identity] for identity in order if identity in found}


def _record(kind: str, gender: str, path: Path) -> BodyFile:
    origin = "free" if FREE_FOLDER in path.parents else "user"
    try:
        return BodyFile(kind=kind, gender=gender, path=path, origin=origin, vertices=vertex_count(path))
    except InputError as error:
        return BodyFile(kind=kind, gender=gender, path=path, origin=origin, problem=str(error))


def _check_choice(what: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise InputError(f"'{value}' is not a {what}, expected one of {', '.join(choices)}.")


def _model_file(path: Path) -> Path:
    if not path.exists():
        raise InputError(f"{path}: does not exist. Give a body model file or a folder of them.")
    regular_file(path)
    if path.suffix.lower() not in BODY_READERS:
        expected = " or ".join(BODY_READERS)
        raise InputError(
            f"{path}: is not a body model file, expected {expected}. For a download, run `tcfit models add {path}`."
        )
    return path


def _not_found(model: str, gender: str, folders: list[Path]) -> str:
    searched = [f"  {folder}{'' if folder.is_dir() else ' (does not exist)'}" for folder in folders]
    found = sorted({file_name(*identity, "") for folder in folders for identity in _bodies_in(folder)})
    advice = f"Get it from its official site and run `tcfit models add` with it, or name its folder in {ENVIRONMENT}"
    return "\n".join(
        [
            f"No {gender} {KINDS[model].title} body ({file_name(model, gender)} or .pkl) in",
            *searched,
            f"There is: {', '.join(found) or 'no body model at all'}.",
            f"{advice}.",
        ]
    )


def _models_among(path: Path, members: list[Member]) -> list[Member]:
    if path.is_file() and path.suffix.lower() in BODY_READERS:
        return members
    by_path = {member.path: member for member in members}
    chosen = [by_path[inside] for inside in _preferred(list(by_path)).values()]
    if not chosen:
        found = ", ".join(member.path.name for member in members[:6]) or "nothing"
        raise InputError(
            f"{path}: holds no body model (found {found}), expected files like SMPLX_NEUTRAL.npz, SMPLH_male.pkl or "
            f"basicModel_f_lbs_10_207_0_v1.0.0.pkl. Give the archive or folder with the models, or a model file."
        )
    return chosen


def _copy(member: Member, folder: Path) -> Path:
    """Copy below a folder of the same name as the member's own, for that can be what tells the gender."""
    target = folder / member.path.parent.name / member.path.name
    target.parent.mkdir(parents=True)
    member.copy_to(target)
    return target


def _kind_and_gender(copy: Path, member: Member) -> tuple[str, str]:
    """The kind of a model by its content; it is read whole, so a damaged one is refused."""
    try:
        body = load_body(copy)
    except InputError as error:
        raise InputError(str(error).replace(str(copy), str(member.path))) from error
    if body.gender == "neutral" and gender_of_name(member.path) is None:
        raise InputError(
            f"{member.path}: its name does not tell the gender. Rename it, e.g. to {file_name(body.kind, 'neutral')}."
        )
    return body.kind, body.gender


def _place(copy: Path, kind: str, gender: str, folder: Path) -> BodyFile:
    target = folder / file_name(kind, gender, copy.suffix.lower())
    sync(copy)
    os.replace(copy, target)
    sync(folder)
    for suffix in BODY_READERS:
        if suffix != target.suffix:
            # An older npz would be preferred to the pickle that was registered just now.
            (folder / file_name(kind, gender, suffix)).unlink(missing_ok=True)
    return _record(kind, gender, target)
