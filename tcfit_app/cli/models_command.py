"""`tcfit models`: show the body models, pose priors and detectors on this computer, and add to them."""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from tqdm import tqdm

from fitting_core.body.files.forms import KINDS
from fitting_core.body.files.registry import BodyFile, list_bodies, register, search_folders, user_folder
from fitting_core.detect import download
from fitting_core.detect.detectors import DETECTORS
from fitting_core.detect.known_models import KNOWN_MODELS, KnownModel, is_here
from fitting_core.detect.mediapipe import fetching, networks
from fitting_core.detect.mediapipe.fetching import Fetched, FetchProgress
from fitting_core.detect.mediapipe.packages import holds_networks
from fitting_core.errors import InputError, printable
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
    print(f"\n{_table(_networks_table())}\n\n{_table(_detectors_table())}")
    print("`tcfit models add DETECTOR` downloads what it lacks, after you agree to the licence.")
    print("\nThe first file of a model and gender is used. Add your own SMPL-X, SMPL-H, SMPL or VPoser with")
    print("  tcfit models add PATH   (a model file, a folder, or the archive as downloaded)")
    print(f"They are copied to {user_folder()}")


def register_models(paths: Sequence[Path], *, agreed: bool = False) -> None:
    """Add models and networks where tcfit finds them, and print what was added. Raises InputError if a path holds
    nothing of use; those before it stay registered.

    Args:
        paths: Model files, folders or downloaded archives, one after the other; or the name of a detector or model that
            is to be downloaded. What nothing else recognises is taken for body models, whose reader says what is wrong
            with it.
        agreed: Whether the user has agreed to a download.
    """
    for path in paths:
        if (name := str(path)) in (*DETECTORS, *KNOWN_MODELS):
            _fetch(name, agreed=agreed)
            continue
        if holds_networks(path):
            added = _fetched(fetching.add(path))
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


# --- detectors ---


def _networks_table() -> list[tuple[str, ...]]:
    """A row for each network of mediapipe: name, what it finds, whether it is here; under the names of the columns."""
    rows = [("NETWORK", "FINDS", "STATE")]
    return rows + [(name, known.title, _state(name)) for name, known in networks.NETWORKS.items()]


def _state(name: str) -> str:
    if networks.is_sound(name):
        return "installed"
    if networks.is_installed(name):
        return "damaged"
    return "missing (optional)" if networks.NETWORKS[name].optional else "missing"


def _detectors_table() -> list[tuple[str, ...]]:
    """A row for each detector, and each model for --boxes or another detector."""
    rows: list[tuple[str, ...]] = [("DETECTOR", "LICENCE", "STATE", "WHAT")]
    for name, known in DETECTORS.items():
        licence = KNOWN_MODELS[name].licence if name in KNOWN_MODELS else networks.LICENCE
        rows.append((name, licence, "installed" if known.is_here() else "missing", known.title))
    for name, model in KNOWN_MODELS.items():
        if name not in DETECTORS:
            what = f"{model.title}, for --boxes" if model.finds == "boxes" else model.title
            rows.append((name, model.licence, "installed" if is_here(name) else f"missing ({model.size})", what))
    return rows


def _fetch(name: str, *, agreed: bool) -> None:
    """Download what a detector needs, or a known model, after the user has seen what it is and agreed. Raises
    InputError if the user did not agree, or it cannot be downloaded."""
    known = DETECTORS.get(name)
    if known is not None and not known.models:  # mediapipe's networks
        if all(networks.is_sound(network) for network in networks.NETWORKS):
            print(f"The networks are already in {networks.folder()}.")
            return
        print(fetching.fetch_notice(), flush=True)
        _check_agreed(agreed, "Download them?")
        print(_fetched(fetching.fetch()))
        return
    for model in (KNOWN_MODELS[model] for model in (known.models if known is not None else (name,))):
        print(download.download_notice(model), flush=True)
        _check_agreed(agreed, "Download it?")
        got = _downloaded(model)
        checksum = "as expected" if got.checked else "unknown until now; stored for the next download"
        print(f"{model.name} is in {got.path}\n  SHA-256   {got.sha256} ({checksum})")


def _check_agreed(agreed: bool, question: str) -> None:
    """Ask the user to agree to a download, unless they have agreed. Raises InputError if they do not."""
    if agreed:
        return
    if not sys.stdin.isatty():
        raise InputError("Nothing was downloaded. Give --yes to agree without being asked.")
    if input(f"{question} [y/N] ").strip().lower() not in ("y", "yes"):
        raise InputError("Nothing was downloaded.")


def _fetched(events: Iterator[FetchProgress | Fetched]) -> str:
    """Show the progress of mediapipe's networks. Returns what was added."""
    step, form = "", "{desc} {percentage:3.0f}%|{bar}|"
    with tqdm(total=1.0, bar_format=form, dynamic_ncols=True, disable=not sys.stderr.isatty()) as bar:
        for event in events:
            if isinstance(event, Fetched):
                bar.update(1.0 - bar.n)
                added = f"In {event.folder}: {', '.join(event.added) if event.added else 'nothing new'}."
                return f"{added}\nNote: {event.note}" if event.note else added
            if event.step != step:
                step = event.step
                bar.set_description_str(step)
                if bar.disable:
                    print(f"{step} ...", file=sys.stderr, flush=True)
            bar.update(event.share - bar.n)
    raise AssertionError("fetching ends with what it got")


def _downloaded(model: KnownModel) -> download.Downloaded:
    with tqdm(unit="B", unit_scale=True, dynamic_ncols=True, disable=not sys.stderr.isatty()) as bar:
        for event in download.download(model):
            if isinstance(event, download.Downloaded):
                return event
            bar.total = event.total
            bar.update(event.done - bar.n)
    raise AssertionError("a download ends with what it got")
