"""Phase 1: every frame on its own, as SMPLify-X does it; then, if wanted, the relay."""

from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fitting_core import rotations
from fitting_core.fit.initialize import guess_depth, seen_from_side, starting_state, thighs_foreshortened, turned
from fitting_core.fit.objective import FrameObjective
from fitting_core.fit.phases.progress import Step, reported
from fitting_core.fit.phases.search.limb_flips import LimbFlips
from fitting_core.fit.solvers import Solver, make_solver
from fitting_core.fit.solvers.problem import IndependentFrames
from fitting_core.fit.stages import N_STAGES, Stages
from fitting_core.fit.variables.state import State
from fitting_core.video.frame_names import spans

YAWS = {"four": (0.0, 90.0, 180.0, 270.0), "side_view": (0.0,)}
_LOWER = 1e-4
"""A relayed start must lower a frame's cost by this share to be taken."""
_FLIP_ROUNDS = 2
"""Limbs are mirrored again where that helped: another one may be right now."""
_FLIP_ITERATIONS = 8
_FLIPS_KEPT = 3
_HOPEFUL = 1.5
"""Mirrored limbs get 8 iterations, and of each frame the best 3 go on that cost at most 1.5 times as much as what is
there: among 12 trials of each of 91 poses that finds the best one on 97 % (after 4 iterations the best 3: 72 %)."""


@dataclass(frozen=True)
class FrameFits:
    """Every frame's state and cost; frames that could not be fitted were filled from their neighbours."""

    state: State
    cost: Float[Tensor, "T"]
    notes: tuple[str, ...]


def fit_frames(stages: Stages, solver: Solver, *, first_frame: int = 0) -> Generator[Step, None, FrameFits]:
    """Camera step, five stages from the neutral pose, relay.

    Args:
        stages: builds the objectives.
        solver: minimises them.
        first_frame: the number of the clip's first frame, from which the notes count.

    Returns:
        Fits of all frames. Frames with under four confident body keypoints, and frames whose cost is not finite, are
        interpolated from their neighbours and named in the notes.
    """
    usable = stages.usable()
    guess = guess_depth(stages)
    state = starting_state(stages, guess.depth, 0.0)
    if not bool(usable.any()):
        return FrameFits(state, torch.full_like(guess.depth, torch.inf), ("no frame shows four body keypoints",))
    run = _Frames(stages, solver, usable.nonzero()[:, 0])
    camera = yield from run.camera_step(state, guess.depth)
    state, cost = yield from run.both_sides(camera) if stages.config.yaws == "side_view" else run.five_stages(camera)
    if _restarts(stages):
        state, cost = yield from run.relay(state, camera)
    good = usable & cost.isfinite()
    notes = (guess.note(), *_notes(usable, cost, first_frame))
    return FrameFits(filled(state, good), cost, notes)


def _restarts(stages: Stages) -> bool:
    """Whether frames start again from elsewhere once they were fitted."""
    return bool(stages.config.relay_rounds) or stages.config.limb_flips


def _notes(usable: Tensor, cost: Tensor, first_frame: int) -> Iterator[str]:
    empty = (first_frame + (~usable).nonzero()[:, 0]).tolist()
    failed = (first_frame + (usable & ~cost.isfinite()).nonzero()[:, 0]).tolist()
    if empty:
        yield f"frames with fewer than 4 confident body keypoints, filled from their neighbours: {spans(empty)}"
    if failed:
        yield f"frames whose fit failed (no finite cost), filled from their neighbours: {spans(failed)}"


class _Frames:
    """Minimises over a set of frames of a clip, and keeps states of the whole clip."""

    def __init__(self, stages: Stages, solver: Solver, frames: Tensor) -> None:
        self.stages, self.solver, self.frames = stages, solver, frames

    def _minimise(
        self,
        objective: FrameObjective,
        state: State,
        label: str,
        share: tuple[float, float],
        *,
        final: bool = False,
        cold: bool = False,
    ) -> Generator[Step, None, tuple[State, Tensor]]:
        """State with these frames minimised, and the cost of all frames (infinite for the others)."""
        problem = IndependentFrames(objective, self.frames, cold=cold)
        minimisation = self.solver.minimise(problem, state[self.frames], final=final)
        solution = yield from reported(minimisation, label, share, self.solver.iterations)
        cost = torch.full((len(state),), torch.inf, dtype=solution.cost.dtype, device=solution.cost.device)
        cost[self.frames] = solution.cost
        return state.put(self.frames, solution.state), cost

    def camera_step(self, state: State, depth: Tensor) -> Generator[Step, None, State]:
        """Orientation and translation on the torso, from each starting yaw; the lowest cost stays."""
        objective = self.stages.camera_objective(depth)
        best, lowest = state, torch.full_like(depth, torch.inf)
        for yaw in YAWS[self.stages.config.yaws]:
            start = starting_state(self.stages, depth, yaw)
            trial, cost = yield from self._minimise(objective, start, "camera", (0.0, 0.1), final=True)
            better = cost < lowest
            best, lowest = best.put(better, trial[better]), torch.where(better, cost, lowest)
        return best

    def five_stages(self, state: State) -> Generator[Step, None, tuple[State, Tensor]]:
        """The five stages in a row."""
        cost = state.vector.new_full((len(state),), torch.inf)
        for stage in range(1, N_STAGES + 1):
            free = self.stages.free(stage, betas=True, resting=True, translation=not self.stages.config.camera_frozen)
            if stage == N_STAGES and free.hands and self.stages.config.curled_hands:
                # From open hands curled fingers stop halfway, bent towards the camera: shape error 10.4 -> 6.9 mm on
                # the fits of benchmarks.handshapes.
                state = self.stages.parametrisation.with_half_fists(state)
            objective = self.stages.objective(stage, state, free)
            share = (0.1 * stage, 0.1 * stage + 0.1)
            last = stage == N_STAGES and not _restarts(self.stages)
            looks_closer = self.stages.looks_closer(stage)
            state, cost = yield from self._minimise(
                objective, state, f"stage {stage}", share, final=last, cold=looks_closer
            )
        return state, cost

    def both_sides(self, state: State) -> Generator[Step, None, tuple[State, Tensor]]:
        """The five stages; frames seen from the side also from the orientation turned by 180 degrees."""
        found, cost = yield from self.five_stages(state)
        side = seen_from_side(self.stages)[self.frames]
        if not bool(side.any()):
            return found, cost
        others = _Frames(self.stages, self.solver, self.frames[side])
        trial, trial_cost = yield from others.five_stages(turned(state))
        better = trial_cost < cost
        return found.put(better, trial[better]), torch.where(better, trial_cost, cost)

    def relay(self, state: State, camera: State) -> Generator[Step, None, tuple[State, Tensor]]:
        """Every frame restarts from its neighbours' solutions and keeps the lower cost, for a few rounds.

        Before that, frames with foreshortened thighs start from a seat as well, upright as the camera step found them:
        from a standing pose thighs went backward and knees sideways (sitting, PA-MPJPE 185 -> 50 mm). The relay is the
        largest single gain on real footage: 164 -> 98, 151 -> 103 mm. After its first round only neighbours that
        changed are tried again.
        """
        stages, rounds = self.stages, self.stages.config.relay_rounds
        free = stages.free(N_STAGES, betas=True)
        objective = stages.objective(N_STAGES, state, free)
        cost = torch.full_like(state.vector[:, 0], torch.inf)
        cost[self.frames] = objective.cost(state[self.frames], self.frames)
        seated = self.frames[thighs_foreshortened(stages)[self.frames]]
        if len(seated):
            start = state.put(seated, stages.parametrisation.with_seat(camera[seated]))
            seat = _Frames(stages, self.solver, seated)
            trial, trial_cost = yield from seat._minimise(objective, start, "seat", (0.6, 0.6))
            better = trial_cost < cost * (1 - _LOWER)
            state, cost = state.put(better, trial[better]), torch.where(better, trial_cost, cost)
        if stages.config.limb_flips:
            state, cost = yield from self.flip_limbs(objective, state, cost)
        fresh = cost.isfinite()
        for k in range(rounds):
            changed = torch.zeros_like(fresh)
            for offset in (1, -1):
                share = (
                    0.6 + 0.3 * (k + 0.5 * (offset < 0)) / rounds,
                    0.6 + 0.3 * (k + 0.5 + 0.5 * (offset < 0)) / rounds,
                )
                target = _with_fresh_neighbour(self.frames, fresh | changed, offset)
                if not len(target):
                    continue
                start = state.put(target, state[target + offset])
                trial, trial_cost = yield from _Frames(stages, self.solver, target)._minimise(
                    objective, start, f"relay {k + 1}", share
                )
                better = trial_cost < cost * (1 - _LOWER)
                state, cost = state.put(better, trial[better]), torch.where(better, trial_cost, cost)
                changed |= better
            fresh = changed
        return (
            yield from self._minimise(stages.objective(N_STAGES, state, free), state, "polish", (0.9, 1.0), final=True)
        )

    def flip_limbs(
        self, objective: FrameObjective, state: State, cost: Tensor
    ) -> Generator[Step, None, tuple[State, Tensor]]:
        """Frames restart with their limbs mirrored in depth, one at a time, and keep the lowest cost."""
        stages, settings = self.stages, self.stages.config.settings
        flips = LimbFlips(stages)
        quick = make_solver(stages.config.solver, replace(settings, iterations=_FLIP_ITERATIONS, rounds=1))
        frames, share = self.frames[:: stages.config.limb_flips_every], (0.6, 0.6)
        frames = frames[cost[frames].isfinite()]
        for _ in range(_FLIP_ROUNDS):
            if not len(frames):
                break
            tried, costs = [], []
            for label, start in flips.every(state[frames]):
                run = _Frames(stages, quick, frames)
                trial, trial_cost = yield from run._minimise(objective, state.put(frames, start), label, share)
                tried.append(trial[frames])
                costs.append(trial_cost[frames])
            kept = torch.stack(costs).topk(_FLIPS_KEPT, 0, largest=False)
            everything, before = State.cat(tried), cost
            for k in range(_FLIPS_KEPT):
                hopeful = (kept.values[k] < _HOPEFUL * before[frames]).nonzero()[:, 0]
                if not len(hopeful):
                    break
                target, start = frames[hopeful], everything[kept.indices[k, hopeful] * len(frames) + hopeful]
                run = _Frames(stages, self.solver, target)
                trial, trial_cost = yield from run._minimise(objective, state.put(target, start), "limbs", share)
                better = trial_cost < cost * (1 - _LOWER)
                state, cost = state.put(better, trial[better]), torch.where(better, trial_cost, cost)
            frames = frames[(cost < before)[frames]]
        return state, cost


def _with_fresh_neighbour(frames: Tensor, fresh: Bool[Tensor, "T"], offset: int) -> Tensor:
    """Frames whose neighbour at `offset` exists and is fresh."""
    source = frames + offset
    inside = (source >= 0) & (source < len(fresh))
    return frames[inside & fresh[source.clamp(0, len(fresh) - 1)]]


def filled(state: State, good: Bool[Tensor, "T"]) -> State:
    """States of bad frames interpolated between the good ones around them; nearest good one at the ends."""
    at = good.nonzero()[:, 0]
    if not len(at) or bool(good.all()):
        return state
    bad = (~good).nonzero()[:, 0]
    after = torch.searchsorted(at, bad).clamp(max=len(at) - 1)
    before = (torch.searchsorted(at, bad) - 1).clamp(min=0)
    a, b = at[before], at[after]
    t = ((bad - a).to(state.vector) / (b - a).clamp(min=1)).clamp(0, 1)[:, None]
    t = torch.where((a == b)[:, None], 0.0, t)
    vector = (1 - t) * state.vector[a] + t * state.vector[b]
    turn = rotations.log(state.orient[b] @ state.orient[a].transpose(1, 2))
    return state.put(bad, State(rotations.exp(t * turn) @ state.orient[a], vector))
