"""Where latent pose priors lie, and how a user's VPoser gets there. Imports no torch."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import platformdirs

from fitting_core.errors import InputError
from fitting_core.files.archives import open_members
from fitting_core.priors.files.network import PriorNetwork, read_prior_network, write_prior_network
from fitting_core.priors.files.vposer import read_vposer, snapshots_among
from fitting_core.shipped import POSE_PRIOR


@dataclass(frozen=True, kw_only=True)
class PriorFile:
    """A latent pose prior on this computer."""

    name: str
    """How a configuration names it."""
    path: Path
    origin: Literal["free", "user"]
    """Whether it came with tcfit or is the user's own."""
    title: str = ""
    problem: str = ""
    """Why it cannot be read, empty if it can."""


def user_file() -> Path:
    """Where `register_vposer` puts it; it may not exist yet."""
    return platformdirs.user_data_path("tcfit", appauthor=False) / "pose_priors" / "vposer.npz"


def read_prior(path: Path) -> PriorNetwork:
    """A latent pose prior from an npz of our own form, or else from VPoser's files. Raises InputError if it is missing,
    damaged or neither."""
    return read_prior_network(path) if path.suffix.lower() == ".npz" else read_vposer(path)


def registered_vposer() -> Path:
    """The file of the registered VPoser. Raises InputError if none was registered."""
    if not user_file().is_file():
        raise InputError(
            "The pose prior is to be vposer, but no VPoser was added yet. Get it from its official site and run "
            "`tcfit models add` with the download, or give its path as the pose prior."
        )
    return user_file()


def holds_vposer(path: Path) -> bool:
    """Whether a folder, archive or file has snapshots of networks in it."""
    with open_members(path) as members:
        return bool(snapshots_among(members))


def register_vposer(path: Path) -> PriorFile:
    """Put VPoser where the name "vposer" finds it; one that was registered before is replaced.

    Kept are its weights in our own form: the download's snapshot has the state of its training in it, too.

    Raises:
        InputError: There is no sound VPoser at the path, or the user's folder cannot be written.
    """
    network, target = read_vposer(path), user_file()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        write_prior_network(target, network, notes=f"read from {path.name}")
    except OSError as error:
        raise InputError(
            f"{target.parent}: cannot be written ({error.strerror or error}). Free space or correct it."
        ) from error
    return _record("vposer", target, "user")


def list_priors() -> list[PriorFile]:
    """The installed latent pose priors, broken ones with their problem."""
    places: list[tuple[str, Path, Literal["free", "user"]]] = [
        ("vposer", user_file(), "user"),
        ("tcfit", POSE_PRIOR, "free"),
    ]
    return [_record(name, path, origin) for name, path, origin in places if path.exists()]


def _record(name: str, path: Path, origin: Literal["free", "user"]) -> PriorFile:
    try:
        return PriorFile(name=name, path=path, origin=origin, title=read_prior_network(path).title)
    except InputError as error:
        return PriorFile(name=name, path=path, origin=origin, problem=str(error))
