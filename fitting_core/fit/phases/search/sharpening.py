"""How sharp a clip's keypoints are, as a fit's residual tells.

The weights of the priors belong to what a detector sees: keypoints some pixels off. The data term of keypoints with a
smaller noise weighs more, by the ratio of the variances. That noise is not known, but a fit that comes within a pixel
of all keypoints, held by priors as strong as that, says that it is smaller: a higher weight then says how small. Real
detections end at the first step; keypoints of a synthetic clip, or of markers, do not.
"""

from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.body.params import BodyParams
from fitting_core.config.schema import SolverSettings
from fitting_core.fit.stages import IMAGE_SCALE, N_STAGES, Stages
from fitting_core.fit.variables.estimate import Estimate
from fitting_core.fit.variables.state import State

NOISE = 5.0
"""Pixels of an image 1000 high: noise that the weights as they are belong to. Detections on real clips: 2 to 6."""
LEVELS = (10.0, 100.0, 1e3, 1e4, 1e5)
"""Factors of the data term, tried in turn: noise of 0.95 px, 0.3, 0.09, 0.03, 0.009."""

PARTS = tuple(kp.GROUPS.values())
_REDUNDANT = 1.8
_JOINT_ANGLES = 63
_ASTRAY, _TOO_FAR = 3.0, 0.4
"""Times the clip's median misfit, and share of the noise of a level, over which a frame is astray: of 61 poses at a
level of 10^4 the right ones were at 0.3 to 3.3 times the median, the wrong ones at 8 to 330."""
_NARROW = 1e3


def residuals(stages: Stages, state: State) -> Float[Tensor, "T"]:
    """Pixels by which a typical keypoint of each frame is missed, in an image 1000 high; nan where none is seen.

    The median over body, hands and face, each on its own, and the largest of them: a face alone is soon reproduced.
    """
    medians = [off.nanmedian(1).values for off in _missed(stages, state, (kp.BODY, kp.HANDS, kp.FACE))]
    return _largest(medians)


def misfits(stages: Stages, state: State, groups: tuple[slice, ...] = PARTS) -> Float[Tensor, "T"]:
    """Root mean square error of the worst of some groups of keypoints; as `residuals` otherwise.

    Where a part is wrong, such as one hand, a typical keypoint does not tell.
    """
    return _largest([off.square().nanmean(1).sqrt() for off in _missed(stages, state, groups)])


def _missed(stages: Stages, state: State, groups: tuple[slice, ...]) -> list[Float[Tensor, "T n"]]:
    """Errors of the keypoints of each group that the clip has, nan where they are not seen."""
    objective = stages.objective(N_STAGES, state, stages.free(N_STAGES, betas=True))
    data, points = objective.terms[0], stages.data_keypoints(N_STAGES)
    off = data.errors(Estimate(objective.view, state, stages.all_frames)).norm(dim=-1)  # pyright: ignore
    off = off * (IMAGE_SCALE / stages.camera.size[1])
    off = torch.where(stages.seen[:, points], off, torch.nan)
    members = [(points >= g.start) & (points < g.stop) for g in groups]
    return [off[:, m] for m in members if bool(m.any())]


def _largest(of_groups: list[Float[Tensor, "T"]]) -> Float[Tensor, "T"]:
    values = torch.stack(of_groups)
    return values.nan_to_num(-1).amax(0).where(~values.isnan().all(0), torch.nan)


def tells_noise(stages: Stages) -> bool:
    """Whether a typical frame shows so many keypoints that a residual tells their noise.

    Two coordinates for each; few of them, such as a body's alone, are reproduced whatever their noise (4 px came out as
    1).
    """
    columns = stages.parametrisation.columns
    unknowns = columns.total - max(0, columns.pose - _JOINT_ANGLES)
    seen = stages.seen[:, stages.data_keypoints(N_STAGES)].sum(1)
    return bool(2 * seen[seen > 0].float().median() >= _REDUNDANT * unknowns) if bool(seen.any()) else False


def warrants(residual: Float[Tensor, "T"], level: float) -> bool:
    """Whether a typical frame comes so close to its keypoints that the data term may weigh `level` times as much."""
    return bool(residual.nanmedian() < NOISE / level**0.5)


def astray(misfit: Float[Tensor, "T"], level: float) -> Bool[Tensor, "T"]:
    """Frames that stay away from their keypoints, where most of the clip comes close."""
    limit = torch.minimum(_ASTRAY * misfit.nanmedian(), misfit.new_tensor(_TOO_FAR * NOISE / level**0.5))
    return misfit > limit


def sharpness(stages: Stages, state: State) -> float:
    """The highest factor that a solution's residual warrants; 1 where it is a detector's."""
    if not tells_noise(stages):
        return 1.0
    residual = residuals(stages, state)
    return max((level for level in LEVELS if warrants(residual, level)), default=1.0)


def sharpened_for(stages: Stages, params: BodyParams, sharpness_of_fit: float | None = None) -> Stages:
    """The stages that a finished result belongs to: sharpened as its residual warrants, if the configuration asks.

    Args:
        stages: Not sharpened.
        params: The result, all frames.
        sharpness_of_fit: `FitResult.sharpness`; None finds it, which takes 6 ms a frame.
    """
    if not stages.config.sharper_keypoints:
        return stages
    if sharpness_of_fit is not None:
        return stages.sharpened(sharpness_of_fit) if sharpness_of_fit > 1 else stages
    # Sharpened first: a latent prior alone would not bring `params` back as they are.
    exact = stages.sharpened(LEVELS[0])
    factor = sharpness(exact, exact.parametrisation.from_params(params)) if tells_noise(exact) else 1.0
    return stages.sharpened(factor) if factor > 1 else stages


def sharp_settings(settings: SolverSettings, level: float) -> SolverSettings:
    """Settings for sharp keypoints: the way to the minimum leads along a narrow valley.

    Mean vertex error of 29 poses at a factor of 1000: 20.2 mm with 60 steps to 1e-6, 12.2 mm with 300 to 1e-9.
    """
    if level < _NARROW:
        return settings
    return replace(settings, iterations=300, final_tolerance=1e-9, sequence_tolerance=1e-8)
