"""Quality of the presets on real footage: phase 1 (every frame on its own) against the last phase."""

from dataclasses import dataclass, field, replace

from tyro.conf import OmitArgPrefixes

from benchmarks.clips import CLIPS, Sample, read
from benchmarks.measures import measure
from benchmarks.report import Common, Row, progress, report, start
from fitting_core.body.model import BodyModel
from fitting_core.config.schema import PRESETS, FitConfig, Weights, without_collisions
from fitting_core.errors import InputError
from fitting_core.fit.fitting import fit_clip
from fitting_core.results.fit_result import FitResult

BASELINE = "smplifyx"
"""Only its phase 1 is SMPLify-X, which fits single images; the later phases would be ours."""


@dataclass(frozen=True, kw_only=True)
class RealClips:
    """What to fit, and how."""

    clips: tuple[str, ...] = tuple(CLIPS)
    """Which clips."""
    presets: tuple[str, ...] = (BASELINE, "paper", "tcfit")
    """Which presets; `smplifyx` stops after phase 1, which is all that SMPLify-X does."""
    pose_priors: tuple[str, ...] = ()
    """Fit each preset with each of these pose priors (names or files), all else equal; by default with its own."""
    body_pose_weight: float | None = None
    """Weight of the pose prior in stages 4 and 5, for `pose_priors`; by default the preset's."""
    collisions: bool = True
    """The term of self-collision, in the presets that have it: most of their time, with hands above all."""
    default_focal: bool = False
    """Take the default focal length, even where the calibrated one is known."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


def config_of(preset: str) -> FitConfig:
    """The preset's configuration, as it is compared here.

    Raises:
        InputError: there is no such preset.
    """
    if preset not in PRESETS:
        raise InputError(f"There is no preset {preset}; expected one of {', '.join(PRESETS)}.")
    return replace(PRESETS[preset], last_phase=1) if preset == BASELINE else PRESETS[preset]


def configs(options: RealClips) -> dict[str, FitConfig]:
    """What is compared, by the name of its rows."""
    presets = {preset: config_of(preset) for preset in options.presets}
    if not options.collisions:
        presets = {preset: without_collisions(config) for preset, config in presets.items()}
    if not options.pose_priors:
        return presets
    return {
        f"{preset}, {prior}": replace(config, pose_prior=prior, weights=_weights(config, options.body_pose_weight))
        for preset, config in presets.items()
        for prior in options.pose_priors
    }


def _weights(config: FitConfig, body_pose: float | None) -> Weights:
    row = config.weights.body_pose
    return replace(config.weights, body_pose=row if body_pose is None else (*row[:3], body_pose, body_pose))


def quality_rows(name: str, preset: str, sample: Sample, body: BodyModel, result: FitResult) -> list[Row]:
    """A row for phase 1 and one for the last phase, if that is another one."""
    seconds = {f"phase {p.phase} s": round(p.seconds, 2) for p in result.phases}
    return [
        {"clip": name, "preset": preset, "phase": str(p.phase)}
        | measure(sample, body, p.params)
        | {"objective": p.objective["total"]}
        | (seconds if p is result.last else {})
        for p in result.phases
        if p.phase != 2
    ]


def shape_row(name: str, preset: str, result: FitResult) -> Row:
    """The betas: their mean over the frames, and how far single frames lie from it."""
    betas = result.last.params.betas
    spread = float(betas.std(0, correction=0).mean())
    return {"clip": name, "preset": preset} | {f"β{i}": float(b) for i, b in enumerate(betas.mean(0))} | {"std": spread}


def run(options: RealClips) -> None:
    """Fits every clip with every preset, and reports."""
    body = options.common.load_body()
    quality: list[Row] = []
    shapes: list[Row] = []
    for name in options.clips:
        sample = read(name, focal="diagonal" if options.default_focal else "true")
        for preset, config in configs(options).items():
            progress(f"{name}, {preset}: {len(sample)} frames")
            result = fit_clip(sample.clip, body, config)
            quality += quality_rows(name, preset, sample, body, result)
            shapes.append(shape_row(name, preset, result))
    tables = {
        "Balancing, against the triangulated reference": [row for row in quality if "PA-MPJPE mm" in row],
        "Signing, upper body only": [row for row in quality if "lean °" in row],
        "Betas of the last phase, mean over frames": shapes,
    }
    report(options, {title: rows for title, rows in tables.items() if rows})


if __name__ == "__main__":
    start(RealClips, run)
