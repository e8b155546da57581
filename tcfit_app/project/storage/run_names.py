"""The names of runs: the users' own names, and for all others what was fitted, and how that differs from before."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from fitting_core.config.schema import FitConfig
from fitting_core.config.settings import settings, value_of, without_effect
from tcfit_app.project.frame_words import in_words
from tcfit_app.project.storage.run_record import Run

_REMOVED = "a removed fit"
_MOST = 2
"""Settings that a name states; if more differ, it counts them."""


def with_names(runs: Sequence[Run], first_frame: int, frames: int) -> list[Run]:
    """Runs with the names that users see.

    Args:
        runs: All of a project, deleted or not, oldest first, because fits are counted; with their stored names.
        first_frame: The number that users see for frame 0.
        frames: Of the clip.
    """
    named: dict[int, Run] = {}
    roots: dict[int, str] = {}
    """The fit or import that each run goes back to."""
    stored, repeats, fits = {run.id: run.name for run in runs}, Counter[str](), 0
    for run in runs:
        before, own = run.parent or 0, run.name
        if own in (f"Run {run.id}", f"{stored.get(before)} corrected"):  # made by earlier versions
            own = ""
        parent, root = named.get(before), roots.get(before, _REMOVED)
        if run.kind == "fit":
            fits += 1
            root = own or f"Fit {fits}"
            made = f"Fit {fits}{_start(run, named)}"
        elif run.kind == "corrections":
            made = f"{parent.name if parent else _REMOVED} with {_corrections(run)}"
        elif run.kind == "imported":
            root = made = own or "import"
        else:
            made, again = _again(run, parent, root, first_frame, frames)
            times = repeats[made] + again
            repeats[made] += not own
            made += "" if not times else " again" if times == 1 else f" again {times}"
        if parent is None or run.frames is not None:  # it does not begin with a user's name
            made = made[0].upper() + made[1:]
        roots[run.id] = root
        named[run.id] = replace(run, name=own or made, own_name=own)
    return list(named.values())


def _start(run: Run, named: dict[int, Run]) -> str:
    if (start := run.given.start) is None:
        return ""
    if start.run is None:
        return f" from {Path(start.path).name}"
    return f" from {named[start.run].name}" if start.run in named else f" from {_REMOVED}"


def _corrections(run: Run) -> str:
    count = run.corrections
    return "corrections" if not count else f"{count} correction{'s' if count > 1 else ''}"


def _again(run: Run, parent: Run | None, root: str, first_frame: int, frames: int) -> tuple[str, bool]:
    """A re-run, as "frames 60–100, smoother (w_T 1000)" or "Fit 1, new shape (30 frames)", and whether its settings are
    those of its parent."""
    names = [] if parent is None else _differences(parent.config, run.config, frames)
    if run.frames is not None:
        what = [in_words(run.frames, first_frame) + ("" if root == "Fit 1" else f" of {root}")]
        names = [name for name in names if not name.startswith("shape_sample.")]
    else:
        size = run.config.shape_sample.size
        what = [root, "a given shape" if run.given.shape else f"new shape ({size} frame{'s' if size > 1 else ''})"]
        names = [name for name in names if name != "shape_sample.size"]
    if len(names) > _MOST:
        what.append(f"{len(names)} settings changed")
    elif parent is not None:
        what += [_setting(name, value_of(parent.config, name), value_of(run.config, name)) for name in names]
    return ", ".join(what), run.frames is not None and not names


@lru_cache(256)
def _differences(config: FitConfig, other: FitConfig, frames: int) -> list[str]:
    idle = without_effect(other, frames) & without_effect(config, frames) | {"height"}
    return [n for n in settings() if n not in idle and value_of(config, n) != value_of(other, n)]


def _setting(name: str, before: object, now: object) -> str:
    """A setting's new value, in short."""
    if name == "temporal.weight":
        assert isinstance(before, float) and isinstance(now, float)
        return f"{'smoother' if now > before else 'less smooth'} (w_T {now:g})"
    group, _, last = name.rpartition(".")
    title = "window" if last == "window_size" else last.replace("_", " ")
    return f"{title}{' weight' if group == 'weights' else ''} {_value(now)}"


def _value(value: object) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, tuple):
        return ", ".join(map(_value, value))
    return f"{value:g}" if isinstance(value, float) else str(value).lower().replace("_", " ")
