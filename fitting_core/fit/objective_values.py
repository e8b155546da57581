"""The objective at given parameters, by term: for tests and notebooks."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera
from fitting_core.config.schema import PRESETS, FitConfig
from fitting_core.errors import InputError
from fitting_core.fit.stages import N_STAGES, Stages
from fitting_core.keypoints import Keypoints


@dataclass(frozen=True, kw_only=True)
class ObjectiveValues:
    """The components of the objective at one point. Every value includes its weight: they add up to the objective."""

    frames: dict[str, Float[Tensor, "T"]]
    """E_o of each frame by term ("data", "body_pose", "hand_pose", "jaw", "expression", "shape", ...; some
    only where the weight is not 0: "bending", "collision"). Float64, on the CPU."""
    over_time: dict[str, float]
    """Terms that couple frames, summed over the clip: E_T as "temporal"."""

    @property
    def temporal(self) -> float:
        """E_T, summed over the clip; 0 if its weight is."""
        return self.over_time.get("temporal", 0.0)

    @property
    def terms(self) -> dict[str, float]:
        """Every term summed over the clip."""
        return {**{name: float(cost.sum()) for name, cost in self.frames.items()}, **self.over_time}

    @property
    def total(self) -> float:
        """What phase 3 minimises over the whole clip: E_o + E_T."""
        return sum(self.terms.values())


def evaluate_objective(
    body: BodyModel,
    params: BodyParams,
    camera: Camera,
    keypoints: Keypoints,
    preset: FitConfig | str = "paper",
    *,
    stage: int = N_STAGES,
    frame_rate: float | None = None,
    detector: str = "",
) -> ObjectiveValues:
    """Evaluates the objective without minimising anything. Held feet are left out: only a fit finds where they are.

    >>> result = fit_clip(clip, body, PRESETS["tcfit"])
    >>> values = evaluate_objective(
    ...     body, result.last.params, clip.camera, clip.keypoints, "tcfit", stage=5, frame_rate=clip.frame_rate
    ... )
    >>> values.frames["data"]            # (T,): where the reprojection is bad
    >>> values.terms                     # {"data": 8123.4, ..., "temporal": 310.2}

    Args:
        body: the body model.
        params: one row for each frame; poses as axis-angle, as a fit returns them.
        camera: of the clip.
        keypoints: of the clip, as many frames as `params`.
        preset: name of a preset, or any configuration. Its `temporal.mode` makes no difference: E_T is summed once over
            every frame that has two neighbours.
        stage: whose weights are used, 1 to 5.
        frame_rate: of the clip, frames per second; needed if the configuration sets `temporal.reference_rate`.
        detector: who found the keypoints, `Clip.detector`; used if the configuration weights them by its noise.

    Raises:
        InputError: no such preset or stage, parameters that do not match the keypoints or the configuration, or no
            frame rate where one is needed.
    """
    config = _config(preset)
    if stage not in range(1, N_STAGES + 1):
        raise InputError(f"There is no stage {stage}: stages are numbered from 1 to {N_STAGES}.")
    _check(params, keypoints, config)
    rate = _frame_rate(frame_rate, config)
    stages = Stages.of(keypoints, camera, body, config, frame_rate=rate, detector=detector)
    state = stages.parametrisation.from_params(params)
    objective = stages.objective(stage, state, stages.free(stage, betas=True))
    with torch.no_grad():
        costs = objective.costs(state, stages.all_frames)
        over_time = objective.costs_over_time(state)
    return ObjectiveValues(frames={name: cost.double().cpu() for name, cost in costs.items()}, over_time=over_time)


def _config(preset: FitConfig | str) -> FitConfig:
    if isinstance(preset, FitConfig):
        return preset
    if preset not in PRESETS:
        raise InputError(f"There is no preset {preset!r}; there are {', '.join(PRESETS)}.")
    return PRESETS[preset]


def _frame_rate(frame_rate: float | None, config: FitConfig) -> float:
    """The given frame rate; any will do if E_T does not depend on it."""
    reference = config.temporal.reference_rate
    if frame_rate is None and reference:
        raise InputError(
            f"No frame rate is given, and the weight of E_T is for {reference:g} frames per second. Give `frame_rate`, "
            "the clip's."
        )
    return 25.0 if frame_rate is None else frame_rate


def _check(params: BodyParams, keypoints: Keypoints, config: FitConfig) -> None:
    if len(params) != len(keypoints):
        raise InputError(
            f"The parameters have {len(params)} frames and the keypoints {len(keypoints)}; both must have the same "
            "number. Cut one of them: params[first:last], keypoints[first:last]."
        )
    found = params.left_hand_pose.shape[1]
    if found != config.hand_components:
        raise InputError(
            f"The parameters have {found} numbers for each hand and the configuration asks for "
            f"{config.hand_components}. Use dataclasses.replace(config, hand_components={found})."
        )
