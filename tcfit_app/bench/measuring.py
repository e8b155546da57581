"""What is measured, as functions that a measuring process runs."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from jaxtyping import Float
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core.body.files.reading import load_body
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.clip import Clip
from fitting_core.config.schema import FitConfig
from fitting_core.fit.events import PhaseFinished, PhaseStarted, drained
from fitting_core.fit.fitting import fit_clip, fit_events, shape_events
from fitting_core.fit.objective import FrameObjective
from fitting_core.fit.phases.initialize import guess_depth, starting_state
from fitting_core.fit.solvers import Solver, make_solver
from fitting_core.fit.solvers.problem import IndependentFrames
from fitting_core.fit.solvers.solution import Solution
from fitting_core.fit.stages import N_STAGES, Stages
from fitting_core.fit.variables.state import State
from fitting_core.io.summary import CONFIDENT
from fitting_core.results.fit_result import FitResult
from fitting_core.synthetic.excerpts import picked
from tcfit_app.bench.figures import Figure
from tcfit_app.bench.machine import peak_memory
from tcfit_app.bench.subject import Measured
from tcfit_app.fitting.live import Correction, LiveCorrection
from tcfit_app.options.bench import Clock

CLOCKS: dict[Clock, Callable[[], float]] = {"wall": time.perf_counter, "cpu": time.process_time}
_DRAG_PIXELS = np.array([[40.0, 20.0]])
"""How far a keypoint is dragged, at an image height of 1000 pixels."""


@dataclass(frozen=True, kw_only=True)
class Setup:
    """What is fitted, and how it is timed."""

    clip: Clip
    body: Path
    config: FitConfig
    clock: Clock

    def load_body(self) -> BodyModel:
        """The body model, read once in a process."""
        return _body(self.body)


@cache
def _body(path: Path) -> BodyModel:
    return load_body(path)


def warm_up(setup: Setup) -> Measured:
    """What only the first fit of a process has to do, done; measures nothing."""
    config = replace(setup.config, last_phase=1, relay_rounds=0, yaws="side_view", solver="lm")
    config = replace(config, settings=replace(config.settings, iterations=2))
    fit_clip(picked(setup.clip, range(min(3, len(setup.clip)))), setup.load_body(), config)
    return {}


def fit_measures(setup: Setup) -> Measured:
    """Milliseconds per frame of each phase of a fit, and the memory that the process has ever held."""
    clock, found, total = CLOCKS[setup.clock], {}, 0.0
    body, begin = setup.load_body(), CLOCKS[setup.clock]()
    objective = 0.0
    for event in fit_events(setup.clip, body, setup.config):
        if isinstance(event, PhaseFinished):
            each = 1e3 * (clock() - begin) / len(setup.clip)
            found[f"phase {event.phase}"] = (each, "ms/frame")
            total += each
            objective = event.result.objective["total"]
            begin = clock()
    found["all phases"] = (total, "ms/frame")
    found["objective"] = (objective, "cost/frame")
    if (peak := peak_memory()) is not None:
        found["peak memory"] = (peak, "MiB")
    return found


def solver_measures(setup: Setup) -> Measured:
    """The five stages of phase 1, all frames together, from the camera step on."""
    stages = Stages.of_clip(setup.clip, setup.load_body(), setup.config)
    solver = make_solver(setup.config.solver, setup.config.settings)
    found = five_stages(stages, solver, camera_start(stages), [stages.all_frames], clock=CLOCKS[setup.clock])
    cost = stage_objective(stages, N_STAGES, found.state).cost(found.state, stages.all_frames)
    frames = len(setup.clip)
    return {
        "five stages": (1e3 * found.seconds / frames, "ms/frame"),
        "evaluations": (found.evaluations / frames, "per frame"),
        "objective": (float(cost.mean()), "cost/frame"),
    }


def window_measures(setup: Setup) -> Measured:
    """Phase 3 alone, from poses of a quick first phase on."""
    start = _started(setup)
    clock, begin = CLOCKS[setup.clock], 0.0
    events = shape_events(setup.clip, setup.load_body(), setup.config, start)
    for event in events:
        if isinstance(event, PhaseStarted) and event.phase == 3:
            begin = clock()
    return {"phase 3": (1e3 * (clock() - begin) / len(setup.clip), "ms/frame")}


def live_measures(setup: Setup, moves: int) -> Measured:
    """A drag of the elbow that was seen best, in the middle of the clip."""
    clip, frame = setup.clip, len(setup.clip) // 2
    keypoint = max(kp.INDEX["right_elbow"], kp.INDEX["left_elbow"], key=lambda k: clip.keypoints.confidence[frame, k])
    result = _started(setup)
    correction = Correction(
        clip=clip,
        body=setup.load_body(),
        config=setup.config,
        params=result.last.params,
        frame=frame,
        keypoints=(keypoint,),
    )
    origin = clip.keypoints.xy[frame, [keypoint]]
    if clip.keypoints.confidence[frame, keypoint] < CONFIDENT:
        origin = np.array([clip.camera.center])
    way = _DRAG_PIXELS * clip.camera.size[1] / 1000
    targets = [origin + share * way for share in np.linspace(0, 1, moves)]
    times = dragged(correction, targets).times
    column = 0 if setup.clock == "wall" else 1
    taken = [
        Figure(name=what, unit="ms", values=tuple(pair[column] for pair in pairs)) for what, pairs in times.items()
    ]
    (move,) = (figure for figure in taken if figure.name == "move")
    return {figure.name: (figure.median, figure.unit) for figure in taken} | {"move, 95 %": (move.high, move.unit)}


_STARTS: dict[tuple[int, str], FitResult] = {}


def _started(setup: Setup) -> FitResult:
    """A fit to start from, made once in a process: phase 3 and drags need not start from the best."""
    config = quick(replace(setup.config, solver="lm"))
    config = replace(config, temporal=replace(config.temporal, mode="global"))
    key = (len(setup.clip), repr(config))
    if key not in _STARTS:
        _STARTS[key] = fit_clip(setup.clip, setup.load_body(), config)
    return _STARTS[key]


Times = list[tuple[float, float]]
"""Milliseconds on the wall's clock and of the processor."""
_BEGINS = 3
"""Times that a drag is begun: that happens once for each."""


@dataclass(frozen=True, kw_only=True)
class Drag:
    """What a drag took and where it ended; parameters of all frames."""

    times: dict[str, Times]
    on_the_way: BodyParams
    """After the last move."""
    released: BodyParams


def quick(config: FitConfig) -> FitConfig:
    """The same without the restarts of phase 1: what the drag starts from need not be the best."""
    return replace(config, relay_rounds=0, limb_flips=False, yaws="side_view")


def timed(work: Callable[[], object]) -> tuple[float, float]:
    """Milliseconds that it takes, on the wall's clock and of the processor."""
    wall, cpu = time.perf_counter(), time.thread_time()
    work()
    return 1e3 * (time.perf_counter() - wall), 1e3 * (time.thread_time() - cpu)


def dragged(correction: Correction, targets: list[Float[np.ndarray, "n 2"]]) -> Drag:
    """Drag keypoints along a way.

    Args:
        correction: What is dragged.
        targets: Where the keypoints are at each move, pixels.
    """
    live: list[LiveCorrection] = []
    ends: list[BodyParams] = []
    begins = [timed(lambda: live.append(LiveCorrection(correction, targets[0]))) for _ in range(_BEGINS)]
    drag = live[-1]

    def follow(xy: np.ndarray) -> None:
        drag.move(xy)
        drag.resolve()

    moves = [timed(lambda xy=xy: follow(xy)) for xy in targets]
    on_the_way = drag.params
    release = [timed(lambda: ends.append(drained(drag.release()).params))]
    times = {"begin": begins, "move": moves, "release": release}
    return Drag(times=times, on_the_way=on_the_way, released=ends[0])


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Five stages over some frames."""

    state: State
    seconds: float
    evaluations: int


def solved(solver: Solver, problem: IndependentFrames, state: State, *, final: bool) -> Solution:
    """The solution of a minimisation, without its progress."""
    return drained(solver.minimise(problem, state, final=final))


def camera_start(stages: Stages) -> State:
    """What all solvers start from: the camera step, facing the camera, solved by lm."""
    depth = guess_depth(stages).depth
    problem = IndependentFrames(stages.camera_objective(depth), stages.all_frames)
    solver = make_solver("lm", stages.config.settings)
    return solved(solver, problem, starting_state(stages, depth, 0.0), final=True).state


def five_stages(
    stages: Stages,
    solver: Solver,
    state: State,
    groups: list[Tensor],
    *,
    clock: Callable[[], float] = time.perf_counter,
) -> Outcome:
    """All stages in a row; frames of one group are solved together. Only the solver's own time counts."""
    evaluations, seconds = 0, 0.0
    for frames in groups:
        for stage in range(1, N_STAGES + 1):
            problem = IndependentFrames(stage_objective(stages, stage, state), frames)
            begin = clock()
            solution = solved(solver, problem, state[frames], final=stage == N_STAGES)
            seconds += clock() - begin
            state = state.put(frames, solution.state)
            evaluations += solution.evaluations
    return Outcome(state=state, seconds=seconds, evaluations=evaluations)


def stage_objective(stages: Stages, stage: int, state: State) -> FrameObjective:
    """The objective of a stage with everything free that phase 1 frees in it."""
    free = stages.free(stage, betas=True, resting=True, translation=not stages.config.camera_frozen)
    return stages.objective(stage, state, free)
