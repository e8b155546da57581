"""Phase 1: every frame on its own, as in SMPLify-X; then, if configured, the relay."""

from collections.abc import Generator, Iterator
from dataclasses import replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fitting_core.body.params import BodyParams
from fitting_core.fit.events import mapped
from fitting_core.fit.evidence.given_start import state_of
from fitting_core.fit.objective import FrameObjective
from fitting_core.fit.phases.frame_fits import FrameFits
from fitting_core.fit.phases.initialize import (
    guess_depth,
    half_turned,
    seen_from_side,
    starting_state,
)
from fitting_core.fit.phases.limb_flips import LimbFlips
from fitting_core.fit.phases.progress import PhaseStep, mirrored_label, reported, stage_label
from fitting_core.fit.solvers import Solver, make_solver
from fitting_core.fit.solvers.problem import IndependentFrames
from fitting_core.fit.solvers.solution import Solution, joined_solutions
from fitting_core.fit.stages import N_STAGES, Stages
from fitting_core.fit.terms.temporal import JointPositions
from fitting_core.fit.variables.state import State
from fitting_core.results.provenance import TURNED, Start
from fitting_core.video.frame_names import spans

YAWS = {"four": (0.0, 90.0, 180.0, 270.0), "side_view": (0.0,)}
_AT_ONCE = 16
"""Frames fitted before the next ones start, so that bodies can be shown early. It costs nothing: signing, 149 frames,
5.8 s of CPU time with 16, 32, 64 or all at once, the first bodies after 0.4, 0.6, 0.7 and 0.7 s."""
_MOST_HELD = 1024
"""Frames whose last objective, 45 kB each, or joints are in memory at once. An objective takes 4 ms to create, and
65 us a frame."""
_FIRST, _FLIPPED, _KEYS_SETTLED, _ALL_FITTED, _SETTLED = 0.2, 0.55, 0.63, 0.7, 0.9
"""Progress of the phase after the first fits, the mirrored limbs, the relay among key frames, the frames between
these, and the relay among all frames. Processor time of the demo clip, preset tcfit.
"""
_LOWER = 1e-4
"""A relayed start must lower a frame's cost by this fraction to be accepted."""
_ELSEWHERE = 0.03
"""Metres that a joint of a neighbour is away at least where a frame restarts from it. Frames that follow each other
agree within less where both are in one minimum."""
_FLIPPED_EVERY = 2
"""Of how many key frames one has its limbs mirrored; the relay carries what that found to the others."""
_FLIP_ROUNDS = 2
"""Limbs are mirrored again where that helped: another one may now be better."""
_FLIP_ITERATIONS = 8
_FLIPS_KEPT = 3
_HOPEFUL = 1.5
"""Mirrored limbs get 8 iterations; per frame, the best 3 that cost at most 1.5 times the current fit continue: among 12
trials of each of 91 poses that finds the best one in 97 % (after 4 iterations the best 3: 72 %)."""


def fit_frames(
    stages: Stages, solver: Solver, *, first_frame: int = 0, known: FrameFits | None = None
) -> Generator[PhaseStep, None, FrameFits]:
    """Camera step, five stages from the neutral pose, frames between key frames, relay.

    Frames with a given start begin with the last stage from there; all of them count as key frames.

    Args:
        stages: builds the objectives.
        solver: minimises them.
        first_frame: the clip's first frame number, used in the notes.
        known: first fits that an interrupted phase has found; frames with a finite cost keep theirs until the relay.

    Returns:
        Fits of all frames. Frames with fewer than four confident body keypoints, and frames whose cost is not finite,
        are interpolated and listed in the notes.
    """
    usable = stages.observations.usable | stages.given
    guess = guess_depth(stages)
    if not bool(usable.any()):
        nobody = FrameFits.at(starting_state(stages, guess.depth, 0.0), Start.TURNED_0)
        return replace(nobody, notes=("no frame shows four body keypoints",))
    run = _Frames(stages, solver, usable.nonzero()[:, 0])
    # Frames with a given start need no neighbours, so all are fitted first; of the others only the key frames are.
    given, searched = run.divided()
    keys = run.only(torch.cat([given, _key_frames(searched, stages.config.key_frames_every)]).sort().values)
    # The camera step cannot determine the depth, which is held near its guess.
    fits = yield from keys.from_the_camera(guess.depth, known)
    if _restarts(stages):
        fits = yield from run.relay(fits, keys)
    notes = (*((guess.note(),) if len(searched) else ()), *_notes(usable, fits.cost, first_frame))
    return replace(fits.filled(usable & fits.cost.isfinite()), notes=notes)


def _restarts(stages: Stages) -> bool:
    """Whether frames are restarted from elsewhere once all frames or the key frames are fitted."""
    return bool(stages.config.relay_rounds) or stages.config.limb_flips or stages.config.key_frames_every > 1


def _key_frames(frames: Tensor, every: int) -> Tensor:
    """Every n-th frame, and the last."""
    return torch.cat([frames[:-1:every], frames[-1:]])


def _notes(usable: Tensor, cost: Tensor, first_frame: int) -> Iterator[str]:
    empty = (first_frame + (~usable).nonzero()[:, 0]).tolist()
    failed = (first_frame + (usable & ~cost.isfinite()).nonzero()[:, 0]).tolist()
    if empty:
        yield f"frames with fewer than 4 confident body keypoints, filled from their neighbours: {spans(empty)}"
    if failed:
        yield f"frames that could not be fitted, filled from their neighbours: {spans(failed)}"


class _LastStage:
    """E_o of the last stage; that of a long clip is made for some frames whenever they are wanted.

    Args:
        stages: of the whole clip.
        state: all frames; it determines the face contour's tables, which then stay.
    """

    def __init__(self, stages: Stages, state: State) -> None:
        self._stages, self._state, self._free = stages, state, stages.free(N_STAGES, betas=True)
        self._whole = stages.objective(N_STAGES, state, self._free) if len(stages) <= _MOST_HELD else None

    def of(self, frames: Int[Tensor, "n"]) -> Iterator[tuple[Tensor, FrameObjective, Tensor]]:
        """These frames in parts, with an objective of each and their numbers in that."""
        if self._whole is not None:
            yield frames, self._whole, frames
            return
        for part in frames.split(_MOST_HELD):
            stages = self._stages.picked(part.cpu().numpy())
            yield part, stages.objective(N_STAGES, self._state[part], self._free), stages.all_frames

    def cost(self, state: State, frames: Int[Tensor, "n"]) -> Float[Tensor, "n"]:
        """Of these frames; `state` is that of the whole clip."""
        return torch.cat([objective.cost(state[part], own) for part, objective, own in self.of(frames)])


class _Frames:
    """Minimises over a set of frames of a clip, keeping the results of the whole clip."""

    def __init__(self, stages: Stages, solver: Solver, frames: Tensor) -> None:
        self.stages, self.solver, self.frames = stages, solver, frames

    def _minimise(
        self,
        objective: FrameObjective,
        start: FrameFits,
        label: str,
        share: tuple[float, float],
        *,
        final: bool = False,
        cold: bool = False,
    ) -> Generator[PhaseStep, None, FrameFits]:
        """These frames minimised; the others unchanged, with an infinite cost."""
        problem = IndependentFrames(objective, self.frames, cold=cold)
        minimisation = self.solver.minimise(problem, start.state[self.frames], final=final)
        solution = yield from reported(minimisation, label, share, self.solver.iterations)
        return start.solved(self.frames, solution)

    def _restart(
        self, last: _LastStage, start: FrameFits, label: str, share: tuple[float, float], *, final: bool = False
    ) -> Generator[PhaseStep, None, FrameFits]:
        """These frames minimised in the last stage; the others unchanged, with an infinite cost."""
        found, done = list[Solution](), 0.0
        for part, objective, own in last.of(self.frames):
            begin, done = done, done + len(part) / len(self.frames)
            steps = reported(
                self.solver.minimise(IndependentFrames(objective, own), start.state[part], final=final),
                label,
                _part(share, begin, done),
                self.solver.iterations,
            )
            found.append((yield from steps))
        return start.solved(self.frames, joined_solutions(found))

    def only(self, frames: Tensor, solver: Solver | None = None) -> "_Frames":
        """The same for other frames, or with another solver."""
        return _Frames(self.stages, solver or self.solver, frames)

    def divided(self) -> tuple[Tensor, Tensor]:
        """Frames with a given start, and those without."""
        given = self.stages.given[self.frames]
        return self.frames[given], self.frames[~given]

    def from_the_camera(self, depth: Tensor, known: FrameFits | None) -> Generator[PhaseStep, None, FrameFits]:
        """The camera step and the five stages, in blocks of frames so that results can be shown early; frames that are
        known are skipped."""
        stages, shown = self.stages, 0
        whole = _FIRST if _restarts(stages) else 1.0
        fits = FrameFits.at(starting_state(stages, depth, 0.0), Start.TURNED_0)
        parts = self.frames.split(_AT_ONCE if stages.device.type == "cpu" else len(self.frames))
        for k, frames in enumerate(parts):
            part = range(int(frames[0]), int(frames[-1]) + 1)
            left = frames if known is None else frames[~known.cost[frames].isfinite()]
            run = _Frames(stages.within(part), self.solver, left - part.start)
            begin, end = (whole * n / len(parts) for n in (k, k + 1))
            steps = run._all_stages(depth[part.start : part.stop])
            found = yield from mapped(steps, lambda step, b=begin, e=end: step.between(b, e))
            if known is not None:
                found, _ = found.lower(known[part.start : part.stop])
            fits = fits.with_frames(part, found)
            last = len(fits) if k + 1 == len(parts) else part.stop
            yield PhaseStep("first fits", end, 0.0, self._to_look_at(fits, range(shown, last)))
            shown = last
        return fits

    def _all_stages(self, depth: Tensor) -> Generator[PhaseStep, None, FrameFits]:
        """The camera step and the five stages, or the last one from a given start."""
        given, searched = self.divided()
        fits = FrameFits.at(starting_state(self.stages, depth, 0.0), Start.TURNED_0)
        if len(searched):
            run = self.only(searched)
            camera = yield from run.camera_step(depth)
            side_view = self.stages.config.yaws == "side_view"
            fits = yield from run.both_sides(camera) if side_view else run.five_stages(camera)
        if len(given):
            fits, _ = fits.lower((yield from self.only(given).from_given(fits)))
        return fits

    def from_given(self, fits: FrameFits) -> Generator[PhaseStep, None, FrameFits]:
        """The last stage, from the given start: earlier ones would pull it to the neutral pose."""
        stages, start = self.stages, self.stages.start
        assert start is not None, "frames with a given start have one"
        # Stages 1 to 4 would pull the pose to the prior's mean before the last stage sees it.
        free, state = stages.free(N_STAGES, betas=True), state_of(start, stages.parametrisation)
        if free.hands and stages.config.curled_hands and not start.tells_hands:
            state = stages.parametrisation.with_half_fists(state)
        begun = fits.restarted(self.frames, state[self.frames], Start.GIVEN)
        objective = stages.objective(N_STAGES, begun.state, free)
        share, last = ((N_STAGES + 1) / (N_STAGES + 2), 1.0), not _restarts(stages)
        return (yield from self._minimise(objective, begun, "starting from the given result", share, final=last))

    def _to_look_at(self, fits: FrameFits, frames: range) -> tuple[range, BodyParams]:
        """Frames to show, with those not fitted or failed interpolated between the others and the previous block."""
        before = min(1, frames.start)
        near = fits[frames.start - before : frames.stop]
        state = near.filled(near.cost.isfinite()).state[before:]
        return frames, self.stages.parametrisation.to_params(state)

    def camera_step(self, depth: Tensor) -> Generator[PhaseStep, None, FrameFits]:
        """Orientation and translation on the torso, from each starting yaw; the lowest cost wins."""
        objective, settings = self.stages.camera_objective(depth), self.stages.config.settings
        solver = make_solver(self.stages.config.solver, replace(settings, final_tolerance=settings.camera_tolerance))
        run = self.only(self.frames, solver)
        best = FrameFits.at(starting_state(self.stages, depth, 0.0), Start.TURNED_0)
        # A torso's keypoints are almost the same from two opposite yaws: the orientation has a local minimum near each.
        for yaw in YAWS[self.stages.config.yaws]:
            start = FrameFits.at(starting_state(self.stages, depth, yaw), TURNED[yaw])
            trial = yield from run._minimise(
                objective, start, "placing the body", (0.0, 2 / (N_STAGES + 2)), final=True
            )
            best, _ = best.lower(trial)
        return best

    def five_stages(self, fits: FrameFits) -> Generator[PhaseStep, None, FrameFits]:
        for stage in range(1, N_STAGES + 1):
            free = self.stages.free(stage, betas=True, resting=True, translation=not self.stages.config.camera_frozen)
            if stage == N_STAGES and free.hands and self.stages.config.curled_hands:
                # From open hands, curled fingers get stuck halfway, bent towards the camera: shape error 10.4 -> 6.9 mm
                # on the fits of the named handshapes.
                fits = replace(fits, state=self.stages.parametrisation.with_half_fists(fits.state))
            objective = self.stages.objective(stage, fits.state, free)
            share = ((stage + 1) / (N_STAGES + 2), (stage + 2) / (N_STAGES + 2))
            last = stage == N_STAGES and not _restarts(self.stages)
            cold = self.stages.config.widened_start and self.stages.adds_detail(stage)
            fits = yield from self._minimise(objective, fits, stage_label(stage), share, final=last, cold=cold)
        return fits

    def both_sides(self, camera: FrameFits) -> Generator[PhaseStep, None, FrameFits]:
        """The five stages; frames seen from the side also with the orientation turned by 180 degrees."""
        fits = yield from self.five_stages(camera)
        # Seen from the side, shoulders and hips lie on one line, and the camera step cannot tell left from right.
        side = self.frames[seen_from_side(self.stages)[self.frames]]
        if not len(side):
            return fits
        behind = camera.restarted(side, half_turned(camera.state[side]), Start.TURNED_180)
        trial = yield from self.only(side).five_stages(behind)
        return fits.lower(trial)[0]

    def relay(self, fits: FrameFits, keys: "_Frames") -> Generator[PhaseStep, None, FrameFits]:
        """Every frame restarts from its neighbours' solutions and keeps the lower cost, for a few rounds.

        The relay is the largest single gain on real footage: 164 -> 98, 151 -> 103 mm. After its first round only
        neighbours that changed are tried again.

        Args:
            fits: of the key frames.
            keys: the key frames; unless these are all, they settle first, and the others start interpolated.
        """
        stages = self.stages
        objective = _LastStage(stages, fits.state)
        # Costs of different stages cannot be compared: all restarts are judged by E_o of the last one.
        cost = torch.full_like(fits.cost, torch.inf)
        cost[keys.frames] = objective.cost(fits.state, keys.frames)
        fits = replace(fits, cost=cost)
        if stages.config.limb_flips:
            fits = yield from keys.flip_limbs(objective, fits)
        if len(keys.frames) < len(self.frames):
            fits = yield from keys.rounds(objective, fits, (_FLIPPED, _KEYS_SETTLED))
            fits = fits.between(self.frames)
            objective = _LastStage(stages, fits.state)
            others = self.frames[~torch.isin(self.frames, keys.frames)]
            share = _KEYS_SETTLED, _ALL_FITTED
            trial = yield from self.only(others)._restart(objective, fits, "frames between key frames", share)
            fits, _ = fits.lower(trial)
        fits = yield from self.rounds(objective, fits, (_ALL_FITTED, _SETTLED))
        if stages.config.last_phase > 1:
            return fits  # later phases go on from here
        share = _SETTLED, 1.0
        return (yield from self._restart(_LastStage(stages, fits.state), fits, "last steps", share, final=True))

    def rounds(
        self, objective: _LastStage, fits: FrameFits, share: tuple[float, float]
    ) -> Generator[PhaseStep, None, FrameFits]:
        """Frames restart from their neighbours, forwards and backwards in turn; each round takes half the time."""
        rounds, fresh = self.stages.config.relay_rounds, fits.cost.isfinite()
        for k in range(rounds):
            changed = torch.zeros_like(fresh)
            for offset, start in ((1, Start.FRAME_AFTER), (-1, Start.FRAME_BEFORE)):
                # Round k is the progress from 1 - 2^-k to 1 - 2^-(k+1), half of it for each direction.
                begin, end = (1 - 0.5 ** (k + half) for half in ((0.0, 0.5) if offset > 0 else (0.5, 1.0)))
                part = _part(share, begin, end)
                # A neighbour that has not changed since it was tried would give the same result.
                target, source = self._elsewhere(fits, *_with_fresh_neighbour(self.frames, fresh | changed, offset))
                if not len(target):
                    continue
                begun = fits.restarted(target, fits.state[source], start)
                trial = yield from self.only(target)._restart(
                    objective, begun, f"starting from neighbouring frames, round {k + 1}", part
                )
                fits, better = fits.lower(trial, _LOWER)
                changed |= better
            fresh = changed
        return fits

    def _elsewhere(self, fits: FrameFits, target: Tensor, source: Tensor) -> tuple[Tensor, Tensor]:
        """Those of the pairs whose bodies differ: from a body like its own, a frame would descend to where it is."""
        joints = JointPositions(self.stages.body, self.stages.parametrisation, in_camera=False)
        apart = ~fits.cost[target].isfinite()
        for part, own, other in zip(*(rows.split(_MOST_HELD) for rows in (apart, target, source)), strict=True):
            part |= (joints(fits.state[own]) - joints(fits.state[other])).norm(dim=2).amax(1) > _ELSEWHERE
        return target[apart], source[apart]

    def flip_limbs(self, objective: _LastStage, fits: FrameFits) -> Generator[PhaseStep, None, FrameFits]:
        """Frames restart with doubtful limbs mirrored in depth, one at a time, and keep the lowest cost."""
        stages, settings = self.stages, self.stages.config.settings
        flips = LimbFlips(stages)
        quick = make_solver(stages.config.solver, replace(settings, iterations=_FLIP_ITERATIONS, rounds=1))
        frames = self.frames[::_FLIPPED_EVERY]
        frames = frames[fits.cost[frames].isfinite()]
        for k in range(_FLIP_ROUNDS):
            # Short trials of every mirrored limb, then full ones of the few that come near the current cost.
            every, tried = list(flips.every(fits.state[frames], frames)), list[FrameFits]()
            if not every:
                break
            share = _part((_FIRST, _FLIPPED), 1 - 0.2**k, 1 - 0.2 ** (k + 1))  # the second round has a fifth of them
            for flip, rows, mirrored in every:
                part = _part(share, len(tried) / (len(every) + 1), (len(tried) + 1) / (len(every) + 1))
                start, label = fits.restarted(frames[rows], mirrored, flip), mirrored_label(flip)
                trial = yield from self.only(frames[rows], quick)._restart(objective, start, label, part)
                tried.append(trial[frames])
            before = fits.cost
            kept = torch.stack([trial.cost for trial in tried]).topk(min(_FLIPS_KEPT, len(tried)), 0, largest=False)
            # Row k has each frame's k-th cheapest trial, so a later row cannot hold hope where this one has none.
            for costs, which in zip(kept.values, kept.indices, strict=True):
                hopeful = costs < _HOPEFUL * before[frames]
                if not bool(hopeful.any()):
                    break
                start = _chosen(tried, frames, torch.where(hopeful, which, -1), fits)
                trial = yield from self.only(frames[hopeful])._restart(
                    objective, start, "trying mirrored arms and legs", _part(share, 0.93, 1.0)
                )
                fits, _ = fits.lower(trial, _LOWER)
            # Where mirroring helped, another limb may be worth mirroring now.
            frames = frames[(fits.cost < before)[frames]]
        return fits


def _part(share: tuple[float, float], begin: float, end: float) -> tuple[float, float]:
    """From `begin` to `end` of the way between two values of progress."""
    return share[0] + (share[1] - share[0]) * begin, share[0] + (share[1] - share[0]) * end


def _chosen(tried: list[FrameFits], frames: Tensor, which: Tensor, fits: FrameFits) -> FrameFits:
    """The fits with some of the frames that were tried replaced, each by one of the trials; -1: not."""
    for k, trial in enumerate(tried):
        mine = which == k
        fits = fits.restarted(frames[mine], trial.state[mine], trial.start[mine])
    return fits


def _with_fresh_neighbour(frames: Tensor, fresh: Bool[Tensor, "T"], offset: int) -> tuple[Tensor, Tensor]:
    """Frames whose next (+1) or previous (-1) neighbour changed, and that neighbour."""
    one, other = frames[:-1], frames[1:]
    target, source = (one, other) if offset > 0 else (other, one)
    return target[fresh[source]], source[fresh[source]]
