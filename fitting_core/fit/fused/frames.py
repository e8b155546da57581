"""The kernels as operations on tensors: costs, normal equations and descents of frames, in several threads."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core.fit.compiled.layout import N_JOINTS
from fitting_core.fit.fused import constants as k
from fitting_core.fit.fused import descent, known
from fitting_core.fit.fused.scratch import Scratch, scratch_for
from fitting_core.fit.terms.data import Data
from fitting_core.fit.terms.term import Term
from fitting_core.fit.variables.estimate import SolverView
from fitting_core.fit.variables.state import Free, State
from fitting_core.least_squares import Ending

_PIECE = 8
"""Frames per thread at a time: some tens of milliseconds of a descent."""
ENDINGS: tuple[Ending, ...] = ("converged", "iterations", "stalled", "failed")
"""By the codes of `descent`."""


@dataclass(frozen=True)
class Descents:
    """The results of descents of some frames."""

    rows: Int[Tensor, "n"]
    """The indices among the requested frames."""
    state: State
    cost: Float[Tensor, "n"]
    ending: list[Ending]
    evaluations: int


@dataclass(frozen=True)
class Evaluated:
    """Of frames; empty where it was not asked for."""

    cost: Float[Tensor, "B"]
    """Infinite where a point is behind the camera."""
    gradient: Float[Tensor, "B d"]
    """Half of it, in the free columns."""
    matrix: Float[Tensor, "B d d"]
    """Half the Gauss-Newton matrix."""
    joints: Float[Tensor, "B 55 3"]
    """Without camera translation."""
    rows: Float[Tensor, "B 165 d"]
    """Their derivatives by the free columns with the translation fixed."""


class FusedFrames:
    """E_o of a clip's frames, as far as kernels exist for its terms.

    Args:
        terms: of an objective.
        view: points and camera.
        free: the free groups.
        index: their columns.
        threads: how many threads share the frames.
    """

    def __init__(self, terms: list[Term], view: SolverView, free: Free, index: Tensor, *, threads: int) -> None:
        mine, self.others = known.divided(terms)
        """Those without kernels."""
        self.threads = threads
        self._made_from = mine, view, free, index
        self._scratch: list[Scratch] = []

    @cached_property
    def _constants(self) -> k.Constants:
        """Made when they are first wanted: they take 30 kB a frame, and not every objective is minimised."""
        return known.constants_of(*self._made_from)

    def with_data(self, data: Data) -> "FusedFrames":
        """With other keypoints: a drag changes them at every move."""
        other = copy(self)
        other._constants = known.with_data(self._constants, data)
        return other

    def evaluated(
        self, state: State, frames: Int[Tensor, "B"], *, normal: bool = False, joints: bool = False, rows: bool = False
    ) -> "Evaluated":
        """Costs, and what else is asked for; the derivatives of joints are those of held betas."""
        assert not (rows and self._constants.clip["free_betas"]), "the betas of frames fitted together are held"
        count, width, result = len(frames), int(self._constants.clip["free"]), _Results.of(len(frames))
        slopes, posed = count if normal else 0, count if joints or rows else 0
        gradient, matrix = np.zeros((slopes, width)), np.zeros((slopes, width, width))
        places = np.zeros((posed, N_JOINTS, 3))
        by_columns = np.zeros((posed, 3 * N_JOINTS, width) if rows else (posed, 0, 0))
        orient, vector = state.orient.numpy().copy(), state.vector.numpy().copy()

        def work(piece: slice, scratch: Scratch) -> None:
            start = frames[piece].numpy(), orient[piece], vector[piece]
            derived = gradient[piece], matrix[piece], places[piece], by_columns[piece]
            descent.descend(self._constants, *start, scratch, 0, 0.0, *result[piece], *derived)

        for _ in self._shared_out(count, work):
            pass
        return Evaluated(*map(torch.from_numpy, (result.cost, gradient, matrix, places, by_columns)))

    def descend(
        self, state: State, frames: Int[Tensor, "B"], *, iterations: int, tolerance: float
    ) -> Iterator[Descents]:
        """Levenberg-Marquardt of each frame on its own; yields groups of frames as they finish."""
        assert not self.others, "the kernels do not know all terms"
        orient, vector = state.orient.numpy().copy(), state.vector.numpy().copy()
        result = _Results.of(len(frames))

        def work(piece: slice, scratch: Scratch) -> None:
            start = frames[piece].numpy(), orient[piece], vector[piece]
            descent.descend(self._constants, *start, scratch, iterations, tolerance, *result[piece], *_NOTHING)

        for piece in self._shared_out(len(frames), work):
            yield Descents(
                rows=torch.arange(piece.start, piece.stop),
                state=State(torch.from_numpy(orient[piece]), torch.from_numpy(vector[piece])),
                cost=torch.from_numpy(result.cost[piece]),
                ending=[ENDINGS[n] for n in result.ending[piece]],
                evaluations=int(result.evaluations[piece].sum()),
            )

    def _shared_out(self, count: int, work: Callable[[slice, Scratch], None]) -> Iterator[slice]:
        """Do the work in pieces on several threads; yields the pieces as they finish."""
        pieces = [slice(start, min(start + _PIECE, count)) for start in range(0, count, _PIECE)]

        def do(piece: slice) -> slice:
            try:
                scratch = self._scratch.pop()
            except IndexError:
                scratch = scratch_for(self._constants)
            work(piece, scratch)
            self._scratch.append(scratch)
            return piece

        if self.threads == 1 or len(pieces) == 1:
            yield from map(do, pieces)
            return
        with ThreadPoolExecutor(self.threads) as pool:
            futures = [pool.submit(do, piece) for piece in pieces]
            try:
                for future in as_completed(futures):
                    yield future.result()
            finally:  # if the consumer stops, wait only for what is being computed
                for future in futures:
                    future.cancel()


@dataclass(frozen=True)
class _Results:
    cost: np.ndarray
    ending: np.ndarray
    evaluations: np.ndarray

    @staticmethod
    def of(count: int) -> "_Results":
        return _Results(np.empty(count), np.zeros(count, np.int64), np.zeros(count, np.int64))

    def __getitem__(self, piece: slice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self.cost[piece], self.ending[piece], self.evaluations[piece]


_NOTHING = np.zeros((0, 0)), np.zeros((0, 0, 0)), np.zeros((0, 0, 0)), np.zeros((0, 0, 0))
"""No gradients, matrices, joints and derivatives of joints."""


def compile_all() -> None:
    """Compile every kernel by calling it with zero frames."""
    pairs = k.Pairs(np.zeros((1, 0), k.PAIR), np.zeros(0, np.int64), np.zeros((1, 0, 0)))
    constants = k.Constants(
        clip=np.zeros(1, k.CLIP).view(np.recarray)[0],
        layers=np.zeros(0, k.LAYER),
        weights=np.zeros(0),
        weights32=np.zeros(0, np.float32),
        biases=np.zeros(0),
        tables=(pairs, pairs),
        points=np.zeros(0, k.POINT),
        entries=np.zeros(0, k.ENTRY),
        arms=np.zeros(0, np.int64),
        order=np.zeros(0, np.int64),
        groups=np.zeros(0, k.GROUP),
        keypoints=np.zeros((0, 0), k.KEYPOINT),
        frames=np.zeros(0, k.FRAME),
    )
    start = np.zeros(0, np.int64), np.zeros((0, 3, 3)), np.zeros((0, 1))
    descent.descend(constants, *start, scratch_for(constants), 1, 0.0, *_Results.of(0)[:], *_NOTHING)
