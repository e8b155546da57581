"""`tcfit models`: show the body models on this computer, and add the user's own."""

from pathlib import Path

from fitting_core.body.forms import KINDS
from fitting_core.body.registry import BodyFile, list_bodies, register, search_folders, user_folder

_ORIGINS = {"free": "comes with tcfit", "user": "yours"}
_HEADER = ("MODEL", "GENDER", "VERTICES", "FROM", "FILE")


def list_models() -> None:
    """Print a table of the body models found, in the order in which they are preferred, and how to add more.

    Raises:
        InputError: The environment variable of the folders names something that is no folder.
    """
    bodies = list_bodies()
    if bodies:
        print(_table(bodies))
    else:
        print("No body model found in\n" + "\n".join(f"  {folder}" for folder in search_folders()))
    for body in bodies:
        if body.problem:
            print(f"\nCannot be read: {body.problem}")
    print("\nOf the same model and gender the first one is used. Add your own SMPL-X, SMPL-H or SMPL with")
    print("  tcfit models add PATH   (a model file, a folder, or the archive as downloaded)")
    print(f"They are copied to {user_folder()}")


def register_models(paths: list[Path]) -> None:
    """Copy body models into the user's folder and print what was added.

    Args:
        paths: Model files, folders or downloaded archives, one after the other.

    Raises:
        InputError: A path holds no sound body model; those before it stay registered.
    """
    for path in paths:
        added = register(path)
        print(f"From {path}")
        print(_table(added))


def _table(bodies: list[BodyFile]) -> str:
    rows = [_HEADER, *(_row(body) for body in bodies)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(_HEADER) - 1)]
    return "\n".join("  ".join([*(c.ljust(w) for c, w in zip(row, widths, strict=False)), row[-1]]) for row in rows)


def _row(body: BodyFile) -> tuple[str, ...]:
    vertices = "damaged" if body.problem else f"{body.vertices:,}"
    return KINDS[body.kind].title, body.gender, vertices, _ORIGINS[body.origin], str(body.path)
