"""Descriptions of fits, as HTML."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from fitting_core.body.files.former import is_former
from fitting_core.config.schema import DEFAULT_PRESET
from fitting_core.errors import InputError
from fitting_core.results.fit_result import FitResult
from tcfit_app.analysis.run_metrics import Metric
from tcfit_app.fitting.fit_progress import duration, time_left
from tcfit_app.fitting.fits import own_phases
from tcfit_app.fitting.reports import RunningJob
from tcfit_app.project.storage.run_record import Run
from tcfit_app.review.panels.elements.html import Html, joined, paragraph, tag, text, words
from tcfit_app.review.panels.fit.fit_settings import differences, nearest_preset
from tcfit_app.review.session.session import Session

_ERRORS = {"body": "reprojection_body_median", "hands": "reprojection_hands_median"}
_LOOKS = {"finished": "dim", "interrupted": "warn", "cancelled": "dim", "failed": "bad", "running": "strong"}
"""The mark of each state."""


@dataclass(frozen=True, kw_only=True)
class Listed:
    """A row of the list: a fit with its corrections."""

    run: Run
    """What it shows: the run of its corrections, if there is one."""
    base: Run
    """The run that they correct, or the same one."""
    edits: int
    """Edits since."""
    job: RunningJob | None
    unwritten: bool = False
    """Its finished fit could not be written yet."""


def rows_of(session: Session) -> list[Listed]:
    """All fits, the newest first."""
    fits, jobs = session.fits, {job.run: job for job in session.jobs.values()}
    corrections = {run.parent: run for run in fits.runs if run.kind == "corrections"}
    there, rows = {run.id for run in fits.runs}, []
    for base in reversed(fits.runs):
        run = corrections.get(base.id, base)
        if base.kind != "corrections" or base.parent not in there or corrections[base.parent] is not base:
            edits, unwritten = session.edits_since(run), base.id in fits.unwritten
            rows.append(Listed(run=run, base=base, edits=edits, job=jobs.get(base.id), unwritten=unwritten))
    return rows


def errors_in_words(metrics: tuple[Metric, ...]) -> str:
    """Of a fit's figures, its errors."""
    values = {metric.name: metric.value for metric in metrics}
    known = [f"{name} {value:.0f} px" for name, of in _ERRORS.items() if (value := values.get(of)) is not None]
    return f"Error: {', '.join(known)}" if known else ""


def when(time: datetime) -> str:
    """In this computer's time zone; with the date only if it is not today."""
    local = time.astimezone()
    return f"{local:%H:%M}" if local.date() == datetime.now().astimezone().date() else f"{local:%d %b %H:%M}"


def line_below(row: Listed, errors: str, frames: int) -> Html:
    """What a row says below the name.

    Args:
        row: the row.
        errors: Of its fit, as `errors_in_words`; empty if unknown.
        frames: Of the clip.
    """
    if row.job is not None:
        return words(progress_in_words(row.job), "strong")
    run, said = row.base, []
    if row.unwritten:
        said.append(words("not saved yet", "warn"))
    elif run.state != "finished":
        said.append(words("stopped before its end" if run.partial else run.state, _LOOKS[run.state]))
    said += [text(errors)] if errors else []
    said += [text(f"{row.edits} edit{'s' if row.edits > 1 else ''} since")] if row.edits else []
    said += [text(part) for part in (_settings(run, frames), when(run.started)) if part]
    return joined(*(part for one in said for part in (text(" · "), one)[one is said[0] :]))


def progress_in_words(job: RunningJob) -> str:
    """How far a job is: "43 %, about 2 min left"."""
    if not job.started or job.progress is None:
        return "starting" if job.started else "waiting"
    left = time_left(job.progress.remaining)
    return ", ".join(filter(None, [f"{100 * job.progress.fraction:.0f} %", left]))


def _settings(run: Run, frames: int) -> str:
    """The preset of a whole fit, unless it is the usual one as it is."""
    if run.kind != "fit":
        return ""
    preset = nearest_preset(run.config)
    count = len(differences(run.config, preset, frames))
    changed = f"{count} setting{'s' if count > 1 else ''} changed" if count else ""
    return ", ".join(filter(None, [preset if preset != DEFAULT_PRESET else "", changed]))


def details(row: Listed, fit: FitResult | None) -> list[Html]:
    """Everything else about a fit: its number, its duration, and what it says about itself."""
    facts = [f"Run {row.run.id} on the command line", *_duration(row.base)]
    if is_former(row.run.body.hash):
        facts.append("It keeps the body of an earlier tcfit, whose limbs have other joints")
    notes = {} if fit is None else dict.fromkeys([*fit.warnings, *(note for p in fit.phases for note in p.notes)])
    listed = tag("ul", joined(*(tag("li", text(note)) for note in notes)), class_="tcfit-dim") if notes else Html()
    return [paragraph(". ".join(facts), "dim"), listed]


def _duration(run: Run) -> list[str]:
    """Total of its own phases, or from start to end."""
    if run.kind == "imported" or run.ended is None:
        return []
    phases: Mapping[str, float] = run.summary.get("seconds", {})
    own = [phases[name] for phase in own_phases(run) if (name := f"phase{phase}") in phases]
    return [f"It took {duration(sum(own) if own else (run.ended - run.started).total_seconds())}"]


def result_of(session: Session, run: Run) -> FitResult | None:
    """What a run has found so far; None if nothing, nothing yet, or unreadable."""
    try:
        return session.stored.fit(run) if run.stored or run.state == "running" else None
    except InputError:
        return None
