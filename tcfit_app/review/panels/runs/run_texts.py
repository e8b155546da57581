"""Descriptions of runs, as HTML."""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime

from fitting_core.config.settings import value_of
from fitting_core.errors import InputError
from fitting_core.results.fit_result import FitResult
from tcfit_app.fitting.fit_progress import duration
from tcfit_app.fitting.fits import own_phases
from tcfit_app.fitting.reports import RunningJob
from tcfit_app.project.frame_words import in_words
from tcfit_app.project.storage.run_record import Run, RunState
from tcfit_app.review.panels.elements.html import Html, joined, line, opener, paragraph, tag, text, words
from tcfit_app.review.panels.fit.fit_settings import CHOICE_WORDS, differences, nearest_preset
from tcfit_app.review.panels.fit.fit_settings import words as setting_words
from tcfit_app.review.session.session import Session
from tcfit_app.review.tab.on_show import SLOT_COLORS

KINDS = {
    "fit": "everything",
    "frames": "frames",
    "shape": "shape",
    "corrections": "corrections",
    "imported": "imported",
}
"""What a run fitted, in a word."""
LOOKS: dict[RunState, str] = {
    "running": "strong",
    "finished": "good",
    "interrupted": "warn",
    "cancelled": "dim",
    "failed": "bad",
}
"""The mark of each state."""
_BADGES = {
    name: tag("b", name, class_="tcfit-badge", style=f"border-color:var(--tcfit-{color})")
    for name, color in zip("AB", SLOT_COLORS.values(), strict=True)
}


@dataclass(frozen=True, kw_only=True)
class Listed:
    """A run in the list."""

    run: Run
    shown_as: tuple[str, ...]
    """ "A", "B": where it is on show."""
    edits: int
    """Edits since."""
    job: RunningJob | None
    unwritten: bool = False
    """Its finished fit could not be written yet."""


def seconds_of(run: Run) -> float | None:
    """Total of its own phases, or from start to end; None while it runs, or without phases."""
    if run.kind in ("imported", "corrections"):
        return None
    phases = run.summary.get("seconds", {})
    if phases:
        own = [f"phase{phase}" for phase in own_phases(run)]
        return sum(seconds for phase, seconds in phases.items() if phase in own)
    return None if run.ended is None else (run.ended - run.started).total_seconds()


def when(time: datetime) -> str:
    """In this computer's time zone; with the date only if it is not today."""
    local = time.astimezone()
    return f"{local:%H:%M}" if local.date() == datetime.now().astimezone().date() else f"{local:%d %b %H:%M}"


def run_line(listed: Listed, *, first_frame: int, frames: int, here: bool, choose: Callable[[], object]) -> Html:
    """A run's row in the table.

    Args:
        listed: the run.
        first_frame: the number that users see for frame 0.
        frames: of the clip.
        here: whether its details are shown.
        choose: shows its details.
    """
    run = listed.run
    badges = joined(*(_BADGES[name] for name in listed.shown_as))
    begun = ["started from another result"] if run.kind == "fit" and run.given.start else []
    said = [_kind(run, first_frame), *begun, *_since(listed.edits), *_settings(run, frames)]
    taken = seconds_of(run)
    time = [text(when(run.started))]
    if taken is not None:
        time += [text(", "), tag("span", duration(taken), class_="tcfit-whole")]
    details = opener(words(run.name, "strong"), "runs.choose", str(run.id), choose)
    return line(
        joined(details, badges, tag("div", " · ".join(said), class_="tcfit-dim")),
        joined(words(_state(listed), LOOKS[run.state]), tag("div", joined(*time), class_="tcfit-dim")),
        numbers=(1,),
        kind="here" if here else "",
        press=details,
    )


def _state(listed: Listed) -> str:
    run, job = listed.run, listed.job
    if listed.unwritten:
        return "not saved yet"
    if run.state != "running" or job is None:
        return run.state
    if not job.started:
        return "waiting"
    return "running" if job.progress is None else f"{100 * job.progress.fraction:.0f} %"


def _kind(run: Run, first_frame: int) -> str:
    return in_words(run.frames, first_frame) if run.frames else KINDS[run.kind]


def _since(edits: int) -> list[str]:
    return [f"{edits} edit{'s' if edits != 1 else ''} since"] if edits else []


def _settings(run: Run, frames: int) -> list[str]:
    if run.kind == "imported":
        return [str(run.summary.get("format", ""))]
    preset = nearest_preset(run.config)
    names = differences(run.config, preset, frames)
    if not names:
        return [preset]
    if len(names) > 3:
        return [f"{preset}, {len(names)} settings changed"]
    return [f"{preset}, {', '.join(f'{setting_words(n)} {short(value_of(run.config, n))}' for n in names)}"]


def short(value: object) -> str:
    """A setting's value, shortened."""
    if isinstance(value, tuple):
        return ", ".join(map(short, value))
    if isinstance(value, float):
        return f"{value:g}"
    return "none" if value is None else CHOICE_WORDS.get(str(value), str(value))


def remarks(run: Run, fit: FitResult | None) -> list[Html]:
    """What went wrong in a run, and what its fit says about itself."""
    problem = [paragraph(run.message, "bad")] if run.message else []
    notes = {} if fit is None else dict.fromkeys([*fit.warnings, *(note for p in fit.phases for note in p.notes)])
    listed = tag("ul", joined(*(tag("li", text(note)) for note in notes)), class_="tcfit-dim") if notes else Html()
    return [*problem, listed]


def result_of(session: Session, run: Run) -> FitResult | None:
    """What a run has found so far; None if nothing, nothing yet, or unreadable."""
    try:
        return session.stored.fit(run) if run.stored or run.state == "running" else None
    except InputError:
        return None
