"""The networks of the detector mediapipe on the command line: listed, and downloaded after the user agrees."""

import sys
from collections.abc import Iterator
from pathlib import Path

from tqdm import tqdm

from fitting_core.detect.mediapipe import networks
from fitting_core.detect.mediapipe.fetching import Fetched, FetchProgress, add, announced, fetch
from fitting_core.errors import InputError

NAME = "mediapipe"
"""Their name in `tcfit models add`."""


def fetch_networks(*, agreed: bool) -> None:
    """Download missing networks, after the user has seen their licence and agreed.

    Raises:
        InputError: The user did not agree, or the download failed.
        KeyboardInterrupt: Cancelled. Nothing has changed.
    """
    if all(networks.is_sound(name) for name in networks.NETWORKS):
        print(f"The networks are already in {networks.folder()}.")
        return
    print(announced(), flush=True)
    check_agreed(agreed, "Download them?")
    print(_summary(_shown(fetch())))


def add_networks(archive: Path) -> str:
    """Take networks out of a package that the user has.

    Returns:
        What was added.

    Raises:
        InputError: It has none of the networks, or they cannot be kept.
    """
    return _summary(_shown(add(archive)))


def networks_table() -> list[tuple[str, ...]]:
    """A row for each network: name, what it finds, whether it is here; under the names of the columns."""
    rows = [("NETWORK", "FINDS", "STATE")]
    return rows + [(name, known.title, _state(name)) for name, known in networks.NETWORKS.items()]


def _state(name: str) -> str:
    if networks.is_sound(name):
        return "installed"
    if networks.is_installed(name):
        return "damaged"
    return "missing (optional)" if networks.NETWORKS[name].optional else "missing"


def check_agreed(agreed: bool, question: str) -> None:
    """Ask the user to agree to a download, unless they have agreed. Raises InputError if they do not."""
    if agreed:
        return
    if not sys.stdin.isatty():
        raise InputError("Nothing was downloaded. Give --yes to agree without being asked.")
    if input(f"{question} [y/N] ").strip().lower() not in ("y", "yes"):
        raise InputError("Nothing was downloaded.")


def _shown(events: Iterator[FetchProgress | Fetched]) -> Fetched:
    step, form = "", "{desc} {percentage:3.0f}%|{bar}|"
    with tqdm(total=1.0, bar_format=form, dynamic_ncols=True, disable=not sys.stderr.isatty()) as bar:
        for event in events:
            if isinstance(event, Fetched):
                bar.update(1.0 - bar.n)
                return event
            if event.step != step:
                step = event.step
                bar.set_description_str(step)
                if bar.disable:
                    print(f"{step} ...", file=sys.stderr, flush=True)
            bar.update(event.share - bar.n)
    raise AssertionError("fetching ends with what it got")


def _summary(got: Fetched) -> str:
    added = f"In {got.folder}: {', '.join(got.added) if got.added else 'nothing new'}."
    return f"{added}\nNote: {got.note}" if got.note else added
