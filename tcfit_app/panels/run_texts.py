"""What is said about runs, as HTML."""

from dataclasses import dataclass
from datetime import datetime

import tcfit_app.panels.markup as markup
from fitting_core.camera import Camera
from fitting_core.errors import InputError
from fitting_core.result import FitResult
from fitting_core.settings import value_of
from tcfit_app.panels.fit_settings import differences, nearest_preset, words
from tcfit_app.session import RunningJob, Session
from tcfit_app.status import PHASES, duration
from tcfit_app.storage.runs import Run

KINDS = {"fit": "everything", "frames": "frames", "shape": "shape", "corrections": "corrections"}
"""What a run fitted, in a word."""
STATES = {
    "running": ("running", "#4dabf7"),
    "finished": ("finished", markup.GOOD),
    "interrupted": ("interrupted", "#ffa94d"),
    "cancelled": ("cancelled", markup.MUTED),
    "failed": ("failed", markup.BAD),
}
"""Word and colour of each state."""
BADGES = {"A": "#5aa0ff", "B": "#ff963c"}
"""Colours of what is on show."""


@dataclass(frozen=True, kw_only=True)
class Listed:
    """A run in the list."""

    run: Run
    shown_as: tuple[str, ...]
    """ "A", "B": where it is on show."""
    edits: int
    """Edits since."""
    job: RunningJob | None
    first_frame: int = 0
    """The number that users see for frame 0."""


_OWN = {"frames": ("phase3",), "shape": ("phase2", "phase3"), "corrections": ("phase3",)}
"""Phases that a run does itself; those before are its parent's. All, where nothing is said."""


def seconds_of(run: Run) -> float | None:
    """Of the phases that it did itself, or from its start to its end; None while it is running."""
    phases = run.summary.get("seconds", {})
    if phases:
        return sum(seconds for phase, seconds in phases.items() if phase in _OWN.get(run.kind, phases))
    return None if run.ended is None else (run.ended - run.started).total_seconds()


def when(time: datetime) -> str:
    """In the time of this computer; the day only if it is not today."""
    local = time.astimezone()
    return f"{local:%H:%M}" if local.date() == datetime.now().astimezone().date() else f"{local:%Y-%m-%d %H:%M}"


def row(listed: Listed) -> tuple[str, str]:
    """The two cells of a run's line."""
    run = listed.run
    badges = "".join(
        f' <span style="background:{BADGES[x]};color:#111;border-radius:3px;padding:0 4px;font-size:10.5px">{x}</span>'
        for x in listed.shown_as
    )
    word, color = STATES[run.state]
    if run.state == "running" and listed.job is not None and not listed.job.started:
        word = "waiting"
    elif run.state == "running" and listed.job is not None and listed.job.progress is not None:
        word = f"{100 * listed.job.progress.share:.0f} %"
    facts = [_kind(listed), *_since(listed.edits), *_settings(run)]
    taken = seconds_of(run)
    time = when(run.started) + ("" if taken is None else f", {duration(taken)}")
    left = f"{markup.bold(run.name)}{badges}<br>{markup.muted(' · '.join(facts))}"
    return left, f"{markup.colored(markup.text(word), color)}<br>{markup.muted(time)}"


def _kind(listed: Listed) -> str:
    run, first = listed.run, listed.first_frame
    return f"frames {first + run.frames[0]}–{first + run.frames[-1]}" if run.frames else KINDS[run.kind]


def _since(edits: int) -> list[str]:
    return [f"{edits} edit{'s' if edits != 1 else ''} since"] if edits else []


def _settings(run: Run) -> list[str]:
    preset = nearest_preset(run.config)
    names = differences(run.config, preset)
    if not names:
        return [preset]
    if len(names) > 3:
        return [f"{preset}, {len(names)} settings changed"]
    return [f"{preset}, {', '.join(f'{words(n)} {short(value_of(run.config, n))}' for n in names)}"]


def short(value: object) -> str:
    """A setting's value."""
    if isinstance(value, tuple):
        return ", ".join(map(short, value))
    return f"{value:g}" if isinstance(value, float) else "none" if value is None else str(value)


def details(listed: Listed, session: Session, fit: FitResult | None) -> str:
    """All that is known of a run but its result."""
    run = listed.run
    parent = None if run.parent is None else session.project.runs.get(run.parent)
    facts = {
        "Fitted": _kind(listed),
        "From": f"{parent.name}{' (deleted)' if parent.deleted else ''}" if parent else "",
        "Edits": f"{listed.edits} made since" if listed.edits else "none made since",
        "Body": f"{run.body.kind}, {run.body.gender}",
        "Started": f"{run.started.astimezone():%Y-%m-%d %H:%M:%S}",
        "Took": "" if (taken := seconds_of(run)) is None else duration(taken),
        **({} if fit is None else _found(fit, session.project.clip.camera)),
    }
    rows = [(markup.label(name), markup.text(value)) for name, value in facts.items() if value]
    return markup.table(rows) + (markup.problem(run.message) if run.message else "") + _differences(run) + _notes(fit)


def _found(fit: FitResult, clip: Camera) -> dict[str, str]:
    own = "" if fit.camera == clip else f", the clip's is {clip.focal[0]:.2f}"
    return {
        "Phases": ", ".join(f"{PHASES[p.phase]} {duration(p.seconds)}" for p in fit.phases),
        "Cost": ", ".join(f"{p.objective['total']:.4g}" for p in fit.phases if "total" in p.objective),
        "Focal length": f"{fit.camera.focal[0]:.2f} px ({fit.camera.source}{own})",
        "Pose prior": fit.pose_prior,
    }


def _differences(run: Run) -> str:
    preset = nearest_preset(run.config)
    names = differences(run.config, preset)
    if not names:
        return markup.muted(f"Settings: preset {preset}")
    rows = [(markup.text(words(name)), markup.text(short(value_of(run.config, name)))) for name in names]
    return markup.muted(f"Settings: preset {preset}, but") + markup.table(rows)


def _notes(fit: FitResult | None) -> str:
    if fit is None:
        return ""
    notes = [note for phase in fit.phases for note in phase.notes]
    notes = list(dict.fromkeys([*fit.warnings, *notes]))
    return "".join(f"<div>{markup.muted('• ' + note)}</div>" for note in notes)


def result_of(session: Session, run: Run) -> FitResult | None:
    """What a run has found so far; None if nothing, or if it cannot be read."""
    try:
        return session.fits.fit(run) if run.stored or run.state == "running" else None
    except InputError:
        return None
