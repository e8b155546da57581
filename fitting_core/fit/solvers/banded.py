"""Symmetric positive definite systems of n blocks that couple only with the next few: block-banded.

These are the normal equations of a clip: unknowns of one frame form a block, and a term with a reach in time couples
frames up to twice as far apart. Time and memory are linear in n.

Milliseconds per solve with blocks that couple with the next two, float64, best of up to five in one script run, on one
/ two threads of a shared 2-core machine:

    size D, blocks n   this file     blocks in numpy   solveh_banded   dense Cholesky
    63, 7              1.3 / 1.3     0.9 / 0.6         2.0 / 1.5       2.8 / 1.7
    63, 100            22 / 27       12 / 13           19 / 25         3190 / 2830
    63, 400            69 / 591      70 / 50           64 / 58         not run
    106, 7             2.3 / 7.3     2.7 / 52          2.3 / 1.9       6.7 / 3.1
    106, 100           44 / 44       37 / 865          44 / 40         11600 / 5960
    106, 400           177 / 174     148 / 13700       185 / 178       not run

On one thread all three are within a factor of two, so torch is used: one code for CPU and GPU, one thread pool. With
two threads under load the others lose more: six solves of (106, 7) took 2-18 ms here, 2-519 with solveh_banded, 73-546
in numpy; six of (63, 400) took 93-263, 57-399 and 48-120. A second thread never paid off. Inverted pivots (products
instead of triangular solves) and in-place updates of panels were no faster on one thread.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor


@torch.no_grad()
def solve_block_banded(bands: Sequence[Float[Tensor, "_ d d"]], g: Float[Tensor, "n d"]) -> Float[Tensor, "n d"] | None:
    """Solve H x = g by block Cholesky (Golub and Van Loan, Matrix Computations, 4th ed., 4.2 and 4.3).

    Not differentiable; no argument is changed.

    Args:
        bands: Band k has the blocks H[i + k, i], max(n - k, 0) of them. Only the lower triangles of the diagonal
            blocks, band 0, are read.
        g: Right side. All are of one dtype (float32 or float64) and on one device.

    Returns:
        x, or None if H is not numerically positive definite or the solution is not finite: damp H and try again.
    """
    n, size = g.shape
    for k, band in enumerate(bands):
        assert band.shape == (max(n - k, 0), size, size), (k, band.shape, g.shape)
    if n == 0:
        return torch.zeros_like(g)
    factor = _factor(bands)
    if factor is None:
        return None
    x = _back_substitute(*factor, _forward_substitute(*factor, g))
    return x if bool(x.isfinite().all()) else None


@torch.no_grad()
def diagonal_of_inverse(bands: Sequence[Float[Tensor, "_ d d"]]) -> Float[Tensor, "n d d"] | None:
    """The diagonal blocks of H^-1 without the rest: for normal equations, each frame's covariance.

    With H = L L^T, Z = H^-1 solves L^T Z = L^-1, whose right side is lower triangular. So from the last frame to the
    first, with i's coupled frames N and G = L[N, i] L[i, i]^-1,

        Z[N, i] = -Z[N, N] G,    Z[i, i] = (L[i, i] L[i, i]^T)^-1 - G^T Z[N, i],

    which needs only the part of Z within the band (Takahashi, Fagan and Chin, 1973; Erisman and Tinney, Comm. ACM 18
    (1975) 177).

    Args:
        bands: As in `solve_block_banded`.

    Returns:
        None if H is not numerically positive definite.
    """
    factor = _factor(bands)
    if factor is None:
        return None
    inverse, size = torch.empty_like(bands[0]), bands[0].shape[-1]
    most = (len(bands) - 1) * size
    known = inverse.new_zeros(0, 0)  # Z of the frames after this one that it couples with
    for i, (lower, panel) in reversed([*enumerate(zip(*factor, strict=True))]):
        lever = torch.linalg.solve_triangular(lower, panel, upper=False, left=False)
        beside = -known @ lever
        own = torch.cholesky_inverse(lower) - lever.mT @ beside
        own = inverse[i] = (own + own.mT) / 2  # otherwise asymmetry from rounding doubles with every frame
        known = torch.cat([torch.cat([own, beside.mT], 1), torch.cat([beside, known], 1)])[:most, :most]
    return inverse


def _factor(bands: Sequence[Tensor]) -> tuple[list[Tensor], list[Tensor]] | None:
    """The Cholesky factor by block columns: L[i, i], (d, d), and L[i + 1, i] over L[i + 2, i] and so on, (k d, d)."""
    diagonal, *below = bands
    size = diagonal.shape[-1]
    pivots: list[Tensor] = []
    panels: list[Tensor] = []
    infos: list[Tensor] = []
    for i, pivot in enumerate(diagonal):
        panel = torch.cat([band[i : i + 1] for band in below] or [pivot[None, :0]]).flatten(0, 1)
        # H[i, i] - sum_k L[i, i-k] L[i, i-k]^T = L[i, i] L[i, i]^T, and the same for the blocks below it.
        # The panel of frame i - k begins with L[i-k+1, i-k]: `near` is L[i, i-k], `far` the blocks below that.
        for k in range(1, min(len(below), i) + 1):
            near, far = panels[i - k][(k - 1) * size : k * size], panels[i - k][k * size :]
            pivot = torch.addmm(pivot, near, near.mT, alpha=-1)
            panel[: len(far)] -= far @ near.mT
        lower, info = torch.linalg.cholesky_ex(pivot)
        # Reading info makes a GPU wait, so it is read once there, at the end.
        if info.device.type == "cpu" and info:
            return None
        pivots.append(lower)
        # L[i+k, i] = H'[i+k, i] L[i, i]^-T, H' being H minus the products above.
        panels.append(torch.linalg.solve_triangular(lower.mT, panel, upper=True, left=False))
        infos.append(info)
    return None if bool(torch.stack(infos).any()) else (pivots, panels)


def _forward_substitute(pivots: list[Tensor], panels: list[Tensor], g: Tensor) -> Tensor:
    """y with L y = g, (n, d)."""
    size = g.shape[1]
    y = g.flatten().clone()
    for i, (lower, panel) in enumerate(zip(pivots, panels, strict=True)):
        block = y[i * size : (i + 1) * size]
        block.copy_(torch.linalg.solve_triangular(lower, block[:, None], upper=False)[:, 0])
        y[(i + 1) * size : (i + 1) * size + len(panel)] -= panel @ block
    return y.view_as(g)


def _back_substitute(pivots: list[Tensor], panels: list[Tensor], y: Tensor) -> Tensor:
    """x with L^T x = y, (n, d)."""
    size = y.shape[1]
    x = y.flatten().clone()
    for i in reversed(range(len(pivots))):
        below = x[(i + 1) * size : (i + 1) * size + len(panels[i])]
        right = x[i * size : (i + 1) * size] - panels[i].mT @ below
        x[i * size : (i + 1) * size] = torch.linalg.solve_triangular(pivots[i].mT, right[:, None], upper=True)[:, 0]
    return x.view_as(y)
