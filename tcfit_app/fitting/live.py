"""Live correction: while keypoints of a frame are dragged, the temporal fit of the frames around it follows.

Everything a drag does not change is computed once at its start: the stages and their compiled points, the last stage's
objective with its face contour held, and the joints of the frames around the window, to which E_T couples it. A move
then changes a few numbers of the data term, or of the depths, and a Levenberg-Marquardt step continues from the
window's current state.

Milliseconds of CPU time of a move on one thread, window of 7 frames, medians:

    keypoints               with the kernels   in torch
    body                    9                  20

A drag in depth takes 1 ms more, in which the kernels reload the term of relative positions.
"""

from collections.abc import Callable, Generator
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, Int

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.clip import Clip
from fitting_core.config.schema import FitConfig, without_collisions
from fitting_core.fit.events import FitEvent
from fitting_core.fit.evidence.sides import unswapped_keypoint
from fitting_core.fit.fitting import Refit, rerun_events
from fitting_core.fit.objective import FrameObjective
from fitting_core.fit.phases.consistency import coupled
from fitting_core.fit.solvers.sequence import Sequence
from fitting_core.fit.stages import N_STAGES, Stages
from fitting_core.fit.terms.data import Data
from fitting_core.fit.variables.state import State
from fitting_core.image_border import cut_off
from fitting_core.keypoints import Keypoints
from fitting_core.results.given_start import GivenStart

LIVE_REACH = 3
"""Frames that follow on each side of the dragged one: a window of seven."""
Target = Float[np.ndarray, "n 2"] | Float[np.ndarray, "n"]
"""Positions of dragged keypoints: pixels, or for a drag in depth metres behind the pelvis (`Keypoints.depth`)."""
ATTEMPTS = 3
"""Damping values tried per re-solve; the next one continues from the last."""
SETTLED = 1e-5
"""Relative decrease below which the window of a resting pointer is left alone; the release converges it."""
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-3, 1e-6, 1e6
_EASING, _STIFFENING = 3.0, 8.0
_ONLY_GROUP = torch.zeros(1, dtype=torch.long)


@dataclass(frozen=True, kw_only=True)
class Correction:
    """What is dragged, and from which fit."""

    clip: Clip
    body: BodyModel
    config: FitConfig
    params: BodyParams
    """The current result, all frames."""
    frame: int
    keypoints: tuple[int, ...]
    """Indices of the dragged keypoints."""
    start: GivenStart | None = None
    """The start of the result's fit, which applies to the window too."""
    size: float | None = None
    """Of its person, `FitResult.size`."""
    in_depth: bool = False
    """Whether they are dragged in depth instead of in the image."""
    reach: int = LIVE_REACH
    edits_seen: int = 0
    """Id of the last log entry included in `clip`, for storing the correction."""
    renewed: "Callable[[], Correction] | None" = None
    """The same with the result and keypoints current when called: other corrections may come in between."""

    @property
    def frames(self) -> range:
        """The window that follows."""
        return range(max(0, self.frame - self.reach), min(len(self.clip), self.frame + self.reach + 1))

    @property
    def converging(self) -> FitConfig:
        """The configuration for the fit at release: the last stage, warm-started. Feet stay where they are dragged."""
        weights = replace(self.config.weights, held_position=(0.0,) * N_STAGES)
        temporal = replace(self.config.temporal, stages=(N_STAGES,))
        return replace(self.config, solver="lm", temporal=temporal, weights=weights)

    @property
    def following(self) -> FitConfig:
        """The configuration while the pointer moves: without collisions, which need the whole mesh."""
        return without_collisions(self.converging)

    @property
    def yielding(self) -> GivenStart | None:
        """The start while the pointer moves: without keypoints dragged in the image. How far they are from it is known
        only once they are released."""
        if self.start is None or self.in_depth:
            return self.start
        points = self.start.points.copy()
        points[self.frame, [k for k in self.keypoints if k < kp.BODY.stop]] = np.nan
        return replace(self.start, points=points)

    @property
    def now(self) -> "Correction":
        """The same, renewed."""
        return self if self.renewed is None else self.renewed()

    def edited(self, target: Target) -> Clip:
        """The clip with the dragged keypoints at `target`: in the image with confidence 1, like any edit."""
        keypoints, cells = self.clip.keypoints, (self.frame, list(self.keypoints))
        if self.in_depth:
            depth = keypoints.told_depth.copy()
            depth[cells] = target
            return replace(self.clip, keypoints=replace(keypoints, depth=depth))
        moved, confidence, by_hand = keypoints.xy.copy(), keypoints.confidence.copy(), keypoints.placed.copy()
        moved[cells], confidence[cells], by_hand[cells] = target, 1, True
        return replace(self.clip, keypoints=replace(keypoints, xy=moved, confidence=confidence, by_hand=by_hand))


class LiveCorrection:
    """One drag from start to release.

    Args:
        correction: what is dragged.
        target: positions, in the order of `correction.keypoints`.
    """

    def __init__(self, correction: Correction, target: Target) -> None:
        self.correction = correction
        clip, config = correction.edited(target), correction.following
        stages = Stages.of_clip(clip, correction.body, config, start=correction.yielding, size=correction.size)
        window, near = correction.frames, coupled(correction.frames, len(clip))
        self._stages = stages.within(near)
        self._frame = correction.frame - near.start
        """Index of the corrected frame in `_stages`, which hold the window and the frames coupled to it."""
        self._row = self._stages.keypoints[self._frame : self._frame + 1]
        self._places = self._in_fit(target)
        around = self._stages.parametrisation.from_params(correction.params[slice(near.start, near.stop)])
        self._problem = self._coupled(around, range(window.start - near.start, window.stop - near.start))
        self._looked_at = self._stages.looked_at(N_STAGES)
        self._state = around[self._problem.frames]
        self.move(target)

    def _in_fit(self, target: Target) -> list[int]:
        """Which keypoints of the fit are dragged: the fit may have unswapped left and right."""
        dragged = self.correction.keypoints
        if self.correction.in_depth:
            swapped = self._stages.observations[self._frame : self._frame + 1].swaps
            return [unswapped_keypoint(keypoint, swapped) for keypoint in dragged]
        return [_place(self._row, keypoint, xy) for keypoint, xy in zip(dragged, target, strict=True)]

    def _coupled(self, around: State, window: range) -> Sequence:
        """The window's problem, with its surroundings fixed as in a re-run."""
        stages = self._stages
        objective = stages.objective(N_STAGES, around, stages.free(N_STAGES, betas=False))
        return Sequence(objective, around, window)

    def move(self, target: Target) -> None:
        """Set the keypoints' positions, in the order of the correction's."""
        self.target = target
        self._damping = self._state.vector.new_full((1,), _FIRST_DAMPING)
        self.settled = False
        """Whether another `resolve` would hardly change anything."""
        objective = self._problem.objective
        self._problem = copy(self._problem)
        self._problem.objective = self._at_depth(objective) if self.correction.in_depth else self._in_image(objective)

    def _at_depth(self, objective: FrameObjective) -> FrameObjective:
        """With the dragged keypoints at their current depth, but for those that the fit leaves out."""
        term, looked_at = objective.relative_position, self._looked_at.tolist()
        if term is None:  # it leaves out all of them, and nothing else is known
            return objective
        target = term.target.clone()
        for place, depth in zip(self._places, self.target, strict=True):
            if place in looked_at:
                target[self._frame, looked_at.index(place), 2] = float(depth)
        return objective.with_relative_position(replace(term, target=target))

    def _in_image(self, objective: FrameObjective) -> FrameObjective:
        """With the dragged keypoints at their current position."""
        row = self._row.xy.copy()
        row[0, self._places] = self.target
        keypoints = replace(self._row, xy=row)
        config, camera = self._stages.config, self.correction.clip.camera
        side = cut_off(keypoints, camera) if config.one_sided_cut_off else np.zeros(row.shape, np.int8)
        return objective.with_data(self._aimed(objective.data, row, side))

    def _aimed(self, data: Data, row: Float[np.ndarray, "1 137 2"], side: Int[np.ndarray, "1 137 2"]) -> Data:
        """The data term with this frame's keypoints at their current position."""
        frame, which = self._frame, self._looked_at
        moved, sides = data.xy.clone(), data.side.clone()
        moved[frame], sides[frame] = (torch.as_tensor(a[0]).to(data.xy)[which] for a in (row, side))
        return replace(data, xy=moved, side=sides)

    def resolve(self) -> BodyParams:
        """One damped step towards the pointer; returns the window's frames.

        Not `LevenbergMarquardt`, which forms the normal equations again at the end, for another step towards the same
        target: here the target has moved by then, and they take two thirds of the time. If no step lowers the cost, the
        window stays, and the next call tries shorter steps.
        """
        cost, *system = self._problem.normal(self._state, _ONLY_GROUP)
        for _ in range(ATTEMPTS):
            step = self._problem.solve((cost, *system), self._damping)
            trial = self._state.moved(step.move)
            lower = self._problem.cost(trial, _ONLY_GROUP)
            if bool(step.solved & (lower < cost)):
                self._state, self._damping = trial, (self._damping / _EASING).clamp_min(_LEAST_DAMPING)
                self.settled = bool(cost - lower < SETTLED * cost)
                break
            self._damping = self._damping * _STIFFENING
            self.settled = bool(self._damping > _MOST_DAMPING)
        return self.window

    @property
    def window(self) -> BodyParams:
        """The current state of the window's frames."""
        return self._stages.parametrisation.to_params(self._state)

    @property
    def params(self) -> BodyParams:
        """All frames: the result being corrected, with the window inserted."""
        return self.correction.params.to(dtype=torch.float64).with_frames(self.correction.frames, self.window)

    def release(self) -> Generator[FitEvent, None, Refit]:
        """Converge the window: a re-run on the corrected keypoints, from where the drag left it; returns all frames.

        Frames around it, and all other keypoints, are those of the current result.
        """
        self.correction = c = self.correction.now
        clip = c.edited(self.target)
        found = rerun_events(clip, c.body, c.converging, self.params, c.frames, start=c.start, size=c.size)
        return (yield from found)


def _place(row: Keypoints, keypoint: int, position: Float[np.ndarray, "2"]) -> int:
    """The fit's keypoint whose detection is at a position in the image."""
    there = (row.xy[0] == position).all(-1) & (row.confidence[0] == 1)
    group = next(g for g in (kp.BODY, kp.HANDS, kp.FACE) if g.start <= keypoint < g.stop)
    found = group.start + np.flatnonzero(there[group])
    return keypoint if there[keypoint] or not len(found) else int(found[0])
