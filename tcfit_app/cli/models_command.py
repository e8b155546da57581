"""`tcfit models`: show the body models, pose priors and networks on this computer, and add to them.

Networks are imported where they are needed: onnxruntime would take its time of every list of bodies.
"""

from collections.abc import Sequence
from pathlib import Path

from fitting_core.body.files.forms import KINDS
from fitting_core.body.files.registry import BodyFile, list_bodies, register, search_folders, user_folder
from fitting_core.errors import printable
from fitting_core.priors.files.registry import PriorFile, holds_vposer, list_priors, register_vposer

_ORIGINS = {"free": "comes with tcfit", "user": "yours"}
_HEADER = ("MODEL", "GENDER", "VERTICES", "FROM", "FILE")
_PRIOR_HEADER = ("POSE PRIOR", "KIND", "FROM", "FILE")


def list_models() -> None:
    """Print tables of the body models and pose priors found, those first that are preferred, and of the detector's
    networks, and how to add more. Raises InputError if the folders' environment variable names no folder."""
    bodies, priors = list_bodies(), list_priors()
    if bodies:
        print(_body_table(bodies))
    else:
        print("No body model found in\n" + "\n".join(f"  {folder}" for folder in search_folders()))
    if priors:
        print(f"\n{_prior_table(priors)}")
    for found in (*bodies, *priors):
        if found.problem:
            print(printable(f"\nCannot be read: {found.problem}"))
    from tcfit_app.cli.detector_networks import NAME, networks_table

    print(f"\n{_table(networks_table())}")
    print(f"The networks are those of the detector {NAME}; `tcfit models add {NAME}` downloads missing ones.")
    print("\nThe first file of a model and gender is used. Add your own SMPL-X, SMPL-H, SMPL or VPoser with")
    print("  tcfit models add PATH   (a model file, a folder, or the archive as downloaded)")
    print(f"They are copied to {user_folder()}")


def register_models(paths: Sequence[Path], *, agreed: bool = False) -> None:
    """Add models and networks where tcfit finds them, and print what was added. Raises InputError if a path holds
    nothing of use; those before it stay registered.

    Args:
        paths: Model files, folders or downloaded archives, one after the other; or the name of networks that are to be
            fetched. What nothing else recognises is taken for body models, whose reader says what is wrong with it.
        agreed: Whether the user has agreed to a download.
    """
    from fitting_core.detect.mediapipe.packages import holds_networks
    from tcfit_app.cli.detector_networks import NAME, add_networks, fetch_networks

    for path in paths:
        if str(path) == NAME:
            fetch_networks(agreed=agreed)
            continue
        if holds_networks(path):
            added = add_networks(path)
        elif holds_vposer(path):
            added = _prior_table([register_vposer(path)])
        else:
            added = _body_table(register(path))
        print(f"From {path}\n{added}")


def _body_table(bodies: list[BodyFile]) -> str:
    rows = []
    for body in bodies:
        vertices = "damaged" if body.problem else f"{body.vertices:,}"
        rows.append((KINDS[body.kind].title, body.gender, vertices, _ORIGINS[body.origin], str(body.path)))
    return _table([_HEADER, *rows])


def _prior_table(priors: list[PriorFile]) -> str:
    rows = [(p.name, "damaged" if p.problem else p.title, _ORIGINS[p.origin], str(p.path)) for p in priors]
    return _table([_PRIOR_HEADER, *rows])


def _table(rows: list[tuple[str, ...]]) -> str:
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]) - 1)]
    lines = ("  ".join([*(c.ljust(w) for c, w in zip(row, widths, strict=False)), row[-1]]) for row in rows)
    return printable("\n".join(lines))
