"""Descriptions of runs, as HTML."""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime

from fitting_core.camera import Camera
from fitting_core.config.settings import value_of
from fitting_core.errors import InputError
from fitting_core.results.fit_result import FitResult, PhaseResult
from tcfit_app.fitting.fits import own_phases, phase_title
from tcfit_app.fitting.job_progress import RunningJob
from tcfit_app.project.frame_words import in_words
from tcfit_app.project.storage.run_record import Run, RunState
from tcfit_app.review.drawing.status import duration
from tcfit_app.review.panels.elements.html import Html, facts, joined, line, opener, paragraph, tag, text, words
from tcfit_app.review.panels.fit.fit_settings import CHOICE_WORDS, differences, nearest_preset
from tcfit_app.review.panels.fit.fit_settings import words as setting_words
from tcfit_app.review.scene.layers import RUN_COLORS, css
from tcfit_app.review.session.session import Session

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
    name: tag("b", name, class_="tcfit-badge", style=f"background:{css(color)}")
    for name, color in zip("AB", RUN_COLORS, strict=True)
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


def details(listed: Listed, session: Session, fit: FitResult | None) -> list[Html]:
    """Everything known about a run except its result."""
    run, clip = listed.run, session.project.footage
    known = {
        "Fitted": _kind(run, clip.first_frame),
        "From": _origin(run, session),
        "Edits": f"{listed.edits} made since" if listed.edits else "none made since",
        "Body": f"{run.body.kind}, {run.body.gender}",
        "Imported" if run.kind == "imported" else "Started": f"{run.started.astimezone():%Y-%m-%d %H:%M:%S}",
        **_told(run, session, fit),
        "Took": "" if (taken := seconds_of(run)) is None else duration(taken),
        **({} if fit is None else _found(run, fit, clip.camera)),
    }
    problem = [paragraph(run.message, "bad")] if run.message else []
    return [
        facts((name, value) for name, value in known.items() if value),
        *problem,
        *_differences(run, len(session.project.footage)),
        *_notes(fit),
    ]


def _origin(run: Run, session: Session) -> str:
    """The run it started from, or the file it was read from; empty without either."""
    if run.parent is None:
        return str(run.summary.get("source", ""))
    known = (*session.fits.runs, *session.project.runs.all(deleted=True))
    parent = next((one for one in known if one.id == run.parent), None)
    if parent is None:
        return "a run that was removed"
    return f"{parent.name}{' (deleted)' if parent.deleted else ''}"


def _told(run: Run, session: Session, fit: FitResult | None) -> dict[str, str]:
    """What the run was given besides the clip."""
    given = (run.given.start, run.given.shape)
    start, shape = ("" if source is None else session.fits.named(source) for source in given)
    if fit is not None and fit.start is not None:
        about = fit.start.about
        start = f"{about.source}, read as {about.format}, in {about.frames} of {about.clip_frames} frames"
    return {"Started from": start, "Shape": f"given by {shape}" if shape else ""}


def _found(run: Run, fit: FitResult, clip: Camera) -> dict[str, str]:
    own = "" if fit.camera.focal == clip.focal else f", the clip's own is {clip.focal[0]:.2f}"
    if run.kind == "imported":
        return {"Read as": fit.pose_prior, "Focal length": f"{fit.camera.focal[0]:.2f} px ({fit.camera.source}{own})"}
    return {
        "Phases": ", ".join(_phase(run, p, own=p.phase in own_phases(run)) for p in fit.phases),
        "Cost": ", ".join(map(_cost, fit.phases)),
        "Focal length": f"{fit.camera.focal[0]:.2f} px ({fit.camera.source}{own})",
        "Pose prior": fit.pose_prior,
        "Ground": "" if fit.grounding is None else fit.grounding.text.removeprefix("Ground: "),
    }


def _phase(run: Run, phase: PhaseResult, *, own: bool) -> str:
    """A phase, with its time if this run computed it."""
    title = phase_title(run, phase.phase)
    return f"{title} {duration(phase.seconds)}" if own else title


def _cost(phase: PhaseResult) -> str:
    """Mean per frame; for a patched phase without the coupling between frames, which is known of whole fits only."""
    if "total" in phase.objective:
        return f"{phase.objective['total']:.4g}"
    return f"{phase.frame_cost.mean():.4g} without the temporal term"


def _differences(run: Run, frames: int) -> list[Html]:
    if run.kind == "imported":
        return []
    preset = nearest_preset(run.config)
    names = differences(run.config, preset, frames)
    if not names:
        return [paragraph(f"Settings: preset {preset}", "dim")]
    changed = facts((setting_words(name), short(value_of(run.config, name))) for name in names)
    return [paragraph(f"Settings: preset {preset}, but", "dim"), changed]


def _notes(fit: FitResult | None) -> list[Html]:
    if fit is None:
        return []
    notes = dict.fromkeys([*fit.warnings, *(note for phase in fit.phases for note in phase.notes)])
    return [tag("ul", joined(*(tag("li", text(note)) for note in notes)), class_="tcfit-dim")] if notes else []


def result_of(session: Session, run: Run) -> FitResult | None:
    """What a run has found so far; None if nothing, nothing yet, or unreadable."""
    try:
        return session.stored.fit(run) if run.stored or run.state == "running" else None
    except InputError:
        return None
