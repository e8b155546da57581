"""One shape for all clips of a person: how far from the truth, against a shape for each clip.

People of the synthetic suite wave, sit down cross-legged and sign, before another camera each time; the third
clip shows no feet. They are fitted with the free body of their gender: each clip by itself, and with the shape that is
found from frames of all three.
"""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float
from tyro.conf import OmitArgPrefixes

from benchmarks.report import Common, progress, report, start
from evaluation.synthetic.studio.view import View
from evaluation.synthetic.suite import SUBJECTS, Subject, SuiteClip, SuiteSequence, make_sequence, subject_body
from fitting_core.body.model import BodyModel
from fitting_core.body.points.positions import joints_in_space
from fitting_core.config.schema import PRESETS
from fitting_core.fit.events import drained
from fitting_core.fit.fitting import fit_clip, shape_events
from fitting_core.fit.fused import ready
from fitting_core.fit.subject_shape import subject_shape
from fitting_core.measure.mesh.volume import Enclosed
from fitting_core.metrics import mpjpe, pa_mpjpe
from fitting_core.results.fit_result import FitResult
from fitting_core.results.known_shape import KnownShape

_VIEWS = {
    "simple": (View(azimuth=22, height=1.35, distance=3.4, looking_at=(0.0, 0.86, -0.05)), 1330.0),
    "complex": (View(azimuth=-24, height=1.45, distance=4.4, looking_at=(0.0, 0.80, -0.05)), 1700.0),
    "signing": (View(azimuth=8, height=1.30, distance=2.6, looking_at=(0.0, 1.15, 0.0)), 1500.0),
}
"""Camera and focal length in pixels of each motion."""
_WAYS = ("each clip its own", "one for all")
_FRAMES = {"simple": 50, "complex": 180, "signing": 75}


@dataclass(frozen=True, kw_only=True)
class Subjects:
    """How many people."""

    people: int = 6
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


def run(options: Subjects) -> None:
    """Fit them all, and report by person and over all."""
    ready.use(threads=options.common.threads)
    found: dict[str, dict[str, dict[str, float]]] = {}
    for number, subject in enumerate(SUBJECTS[: options.people], 1):
        name = f"{number} ({subject.gender})"
        found[name] = person(subject)
        progress(f"{name}: {found[name]}")
    rows = [{"person": name, "shape": how} | own for name, ways in found.items() for how, own in ways.items()]
    report(options, {"By person": rows, "Mean": [{"shape": how} | _mean(found, how) for how in _WAYS]})


def _mean(found: dict[str, dict[str, dict[str, float]]], how: str) -> dict[str, float]:
    own = [ways[how] for ways in found.values()]
    return {name: float(np.mean([figures[name] for figures in own])) for name in own[0]}


def person(subject: Subject) -> dict[str, dict[str, float]]:
    """Figures of one person's clips, each by itself and with one shape."""
    body, config = subject_body(subject), PRESETS["tcfit"]
    made = [_clip(subject, motion) for motion in _VIEWS]
    alone = [fit_clip(m.clip, body, config) for m in made]
    found = subject_shape([(m.clip, fit) for m, fit in zip(made, alone, strict=True)], body, config)
    shape = KnownShape(betas=found.betas)
    together = [
        drained(shape_events(m.clip, body, config, fit, shape=shape)) for m, fit in zip(made, alone, strict=True)
    ]
    return {how: figures(made, fits, body, subject) for how, fits in zip(_WAYS, (alone, together), strict=True)}


def figures(made: list[SuiteClip], fits: list[FitResult], body: BodyModel, subject: Subject) -> dict[str, float]:
    """Errors of the shapes, and of the poses with them; means over the clips."""
    betas, truth = np.stack([fit.last.params.betas[0].numpy() for fit in fits]), np.array(subject.betas)
    volume, height = (np.array([measure(body, b) for b in betas]) for measure in (_volume, _height))
    errors = []
    for m, fit in zip(made, fits, strict=True):
        found, true = (joints_in_space(body, params)[:, :22] for params in (fit.last.params, m.truth.params))
        errors.append((pa_mpjpe(found, true).mean(), mpjpe(found, true, [0]).mean()))
    pa, by_root = np.mean(errors, 0)
    return {
        "spread of betas": round(float(betas.std(0).mean()), 9),
        "error of betas": float(np.abs(betas - truth).mean()),
        "spread of volume dm³": float(np.ptp(volume)),
        "volume error dm³": float(np.abs(volume - _volume(body, truth)).mean()),
        "worst": float(np.abs(volume - _volume(body, truth)).max()),
        "height error cm": float(100 * np.abs(height - _height(body, truth)).mean()),
        "PA-MPJPE mm": float(pa),
        "MPJPE mm": float(by_root),
    }


def _clip(subject: Subject, motion: str) -> SuiteClip:
    view, focal = _VIEWS[motion]
    number = SUBJECTS.index(subject)
    return make_sequence(
        SuiteSequence(
            name=f"subject_{number + 1}_{motion}",
            motion=motion,
            subject=subject,
            frames=_FRAMES[motion],
            view=view,
            focal=focal,
            seed=900 + number,
        )
    )


def _rest(body: BodyModel, betas: Float[np.ndarray, "10"]) -> Float[np.ndarray, "V 3"]:
    return body.with_shape(betas).template


def _volume(body: BodyModel, betas: Float[np.ndarray, "10"]) -> float:
    return float(Enclosed.of(body.faces)(_rest(body, betas)[None])[0])


def _height(body: BodyModel, betas: Float[np.ndarray, "10"]) -> float:
    return float(np.ptp(_rest(body, betas)[:, 1]))


if __name__ == "__main__":
    start(Subjects, run)
