"""`tcfit models`: show the body models and pose priors on this computer, and add the user's own."""

from pathlib import Path

from fitting_core.body.files.forms import KINDS
from fitting_core.body.files.registry import BodyFile, list_bodies, register, search_folders, user_folder
from fitting_core.priors.files.registry import PriorFile, holds_vposer, list_priors, register_vposer

_ORIGINS = {"free": "comes with tcfit", "user": "yours"}
_HEADER = ("MODEL", "GENDER", "VERTICES", "FROM", "FILE")
_PRIOR_HEADER = ("POSE PRIOR", "IS", "FROM", "FILE")


def list_models() -> None:
    """Print tables of the body models and pose priors found, those first that are preferred, and how to add more.

    Raises:
        InputError: The environment variable of the folders names something that is no folder.
    """
    bodies, priors = list_bodies(), list_priors()
    if bodies:
        print(_body_table(bodies))
    else:
        print("No body model found in\n" + "\n".join(f"  {folder}" for folder in search_folders()))
    if priors:
        print(f"\n{_prior_table(priors)}")
    for found in (*bodies, *priors):
        if found.problem:
            print(f"\nCannot be read: {found.problem}")
    print("\nOf the same model and gender the first one is used. Add your own SMPL-X, SMPL-H, SMPL or VPoser with")
    print("  tcfit models add PATH   (a model file, a folder, or the archive as downloaded)")
    print(f"They are copied to {user_folder()}")


def register_models(paths: list[Path]) -> None:
    """Copy body models or VPoser into the user's folder and print what was added.

    Args:
        paths: Model files, folders or downloaded archives, one after the other. One with snapshots of networks in it is
            taken for VPoser, any other for body models.

    Raises:
        InputError: A path holds neither; those before it stay registered.
    """
    for path in paths:
        added = _prior_table([register_vposer(path)]) if holds_vposer(path) else _body_table(register(path))
        print(f"From {path}")
        print(added)


def _body_table(bodies: list[BodyFile]) -> str:
    return _table([_HEADER, *(_row(body) for body in bodies)])


def _prior_table(priors: list[PriorFile]) -> str:
    rows = [(p.name, "damaged" if p.problem else p.title, _ORIGINS[p.origin], str(p.path)) for p in priors]
    return _table([_PRIOR_HEADER, *rows])


def _table(rows: list[tuple[str, ...]]) -> str:
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]) - 1)]
    return "\n".join("  ".join([*(c.ljust(w) for c, w in zip(row, widths, strict=False)), row[-1]]) for row in rows)


def _row(body: BodyFile) -> tuple[str, ...]:
    vertices = "damaged" if body.problem else f"{body.vertices:,}"
    return KINDS[body.kind].title, body.gender, vertices, _ORIGINS[body.origin], str(body.path)
