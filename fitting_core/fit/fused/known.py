"""Builds the kernels' constants from the terms of an objective."""

from collections.abc import Mapping
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
import torch
from torch import Tensor

from fitting_core.body.points.body_points import BodyPoints
from fitting_core.body.points.pairs import PairTable
from fitting_core.fit.compiled import layout
from fitting_core.fit.fused import constants as k
from fitting_core.fit.fused.scratch import MOST_LAYERS, WIDEST
from fitting_core.fit.terms.data import Data
from fitting_core.fit.terms.quadratic import Quadratic
from fitting_core.fit.terms.term import Term
from fitting_core.fit.variables.estimate import SolverView
from fitting_core.fit.variables.state import Columns, Free
from fitting_core.priors.files.network import Activation, Layer
from fitting_core.priors.latent import LatentPrior
from fitting_core.priors.pose import AxisAnglePrior

_ACTIVATIONS: dict[Activation, tuple[int, float]] = {
    "linear": (layout.LINEAR, 1.0),
    "leaky_relu_0.01": (layout.LEAKY_RELU, 0.01),
    "leaky_relu_0.2": (layout.LEAKY_RELU, 0.2),
    "elu": (layout.ELU, 1.0),
    "silu": (layout.SILU, 1.0),
    "softplus": (layout.SOFTPLUS, 1.0),
    "tanh": (layout.TANH, 1.0),
}
"""Code, and slope below zero."""
_LIMBS = (12, 13, 14, 1, 2)
"""Neck, both collars, both hips: points beyond one of them depend on the same columns."""


def _plain(values: Any) -> np.ndarray:
    return np.asarray(values.detach() if isinstance(values, Tensor) else values)


def _floats(values: Any) -> np.ndarray:
    return np.ascontiguousarray(_plain(values), np.float64)


def _ints(values: Any) -> np.ndarray:
    return np.ascontiguousarray(values, np.int64)


def _records(kind: np.dtype, shape: tuple[int, ...], **fields: Any) -> np.ndarray:
    """An array of records with these fields set, the others zero; narrower values fill the front."""
    made = np.zeros(shape, kind)
    for name, value in fields.items():
        value = _plain(value)
        wide = value.shape[value.ndim - kind[name].ndim :] if value.ndim else ()
        made[name][(..., *(slice(n) for n in wide))] = value
    return made


def network_of(prior: object) -> tuple[Layer, ...] | None:
    """The layers of a prior's decoder, none for axis-angle; None if kernels do not support the prior."""
    if isinstance(prior, AxisAnglePrior):
        return ()
    layers = tuple(prior.network.decoder) if isinstance(prior, LatentPrior) else ()
    shapes = [layer.weight.shape for layer in layers]
    known = 1 < len(layers) <= MOST_LAYERS and max(map(max, shapes)) <= WIDEST and shapes[0][1] <= layout.MOST_LATENT
    return layers if known else None


class _Network(NamedTuple):
    layers: np.ndarray
    weights: np.ndarray
    weights32: np.ndarray
    biases: np.ndarray


_networks: WeakKeyDictionary[object, _Network] = WeakKeyDictionary()
_tables: WeakKeyDictionary[BodyPoints, dict[tuple[Columns, Free], "_Laid"]] = WeakKeyDictionary()
"""What was derived from priors and points, for as long as they exist."""


def _network(prior: object) -> _Network:
    if prior not in _networks:
        _networks[prior] = _new_network(prior)
    return _networks[prior]


def _new_network(prior: object) -> _Network:
    layers = network_of(prior)
    assert layers is not None, "see `served`"
    weights = np.concatenate([np.zeros(0), *[np.ravel(layer.weight) for layer in layers]])
    codes = [_ACTIVATIONS[layer.activation] for layer in layers]
    table = _records(
        k.LAYER,
        (len(layers),),
        inputs=[layer.weight.shape[1] for layer in layers],
        outputs=[layer.weight.shape[0] for layer in layers],
        activation=[code for code, _ in codes],
        below=[slope for _, slope in codes],
    )
    biases = np.concatenate([np.zeros(0), *[np.asarray(layer.bias) for layer in layers]])
    return _Network(table, _floats(weights), weights.astype(np.float32), _floats(biases))


def _columns(c: Columns) -> dict[str, Any]:
    jaw = layout.HANDS + 2 * c.hand
    names = ("hand", "jaw", "expression", "translation", "betas", "width", "latent", "shift")
    return dict(zip(names, (c.hand, jaw, jaw + 3, jaw + 13, jaw + 16, jaw + 26, c.pose, 63 - c.pose), strict=True))


def _pairs(table: PairTable | None) -> k.Pairs:
    if table is None:
        return k.Pairs(np.zeros((1, 0), k.PAIR), np.zeros(0, np.int64), np.zeros((1, 0, 0)))
    fields = {"bone": table.bone, "weight": table.weight, "template": table.template, "directions": table.directions}
    return k.Pairs(
        _records(k.PAIR, tuple(table.weight.shape), **fields), _ints(table.driving), _floats(table.correctives)
    )


class _Laid(NamedTuple):
    """The kernels' tables of points, independent of the clip."""

    tables: tuple[k.Pairs, k.Pairs]
    points: np.ndarray
    entries: np.ndarray
    arms: np.ndarray
    order: np.ndarray
    groups: np.ndarray


def _laid(points: BodyPoints, columns: Columns, free: Free) -> _Laid:
    """The points' tables, cached because they take a moment to build and stages use the same ones again."""
    known = _tables.setdefault(points, {})
    if (columns, free) not in known:
        known[columns, free] = _new_tables(points, columns, free)
    return known[columns, free]


def _new_tables(points: BodyPoints, columns: Columns, free: Free) -> _Laid:
    first, second = [*points.tables, None][:2]
    starts = [0, *(int(t.point.max()) + 1 if len(t.point) else 0 for t in points.tables[:-1])]
    owner = np.concatenate([t.point.numpy() + at for t, at in zip(points.tables, starts, strict=True)])
    pick = points.pick.numpy()
    surface = pick >= layout.N_JOINTS
    pairs = [np.where(surface, np.searchsorted(owner, pick - layout.N_JOINTS + end), 0) for end in (0, 1)]
    kept = np.flatnonzero(_free_joints(free)[points.entry_joint.numpy()])
    point, joint = points.entry_point.numpy()[kept], points.entry_joint.numpy()[kept]
    arms = [np.flatnonzero(row == 1) for row in points.incidence.numpy()[kept][:, layout.N_JOINTS :]]
    arm_ends = np.cumsum([0, *map(len, arms)])
    limb = _limbs(points)
    groups = np.zeros(len(set(limb)), k.GROUP)
    order: list[int] = []
    for group, number in zip(groups, sorted(set(limb)), strict=True):
        mine = np.flatnonzero(limb == number)
        found = sorted(_moving_columns(set(joint[np.isin(point, mine)].tolist()), columns, free))
        group["first"], group["last"], group["width"] = len(order), len(order) + len(mine), len(found)
        group["column"][: len(found)] = found
        group["place"][found] = np.arange(len(found))
        order += mine.tolist()
    ends = [np.searchsorted(point, np.arange(len(pick)) + end) for end in (0, 1)]
    return _Laid(
        tables=(_pairs(first), _pairs(second)),
        points=_records(
            k.POINT,
            (len(pick),),
            joint=np.where(surface, -1, pick),
            first_pair=pairs[0],
            last_pair=pairs[1],
            first_entry=ends[0],
            last_entry=ends[1],
        ),
        entries=_records(k.ENTRY, (len(joint),), joint=joint, first_arm=arm_ends[:-1], last_arm=arm_ends[1:]),
        arms=_ints(np.concatenate([np.zeros(0, np.int64), *arms])),
        order=_ints(order),
        groups=groups,
    )


def _limbs(points: BodyPoints) -> np.ndarray:
    limb = np.zeros(len(points.pick), np.int64)
    for joint in reversed(_LIMBS):
        limb[points.entry_point[points.entry_joint == joint].numpy()] = joint
    return limb


def _free_joints(free: Free) -> np.ndarray:
    moves = np.zeros(layout.N_JOINTS, bool)
    moves[0] = True
    moves[1 : layout.N_BODY + 1] = free.body
    moves[layout.JAW_JOINT] = free.face
    moves[layout.FIRST_FINGER :] = free.hands
    return moves


def _moving_columns(joints: set[int], columns: Columns, free: Free) -> set[int]:
    """Turn columns that move the points rotated by these joints."""
    at = _columns(columns)
    found = set(range(at["translation"], at["betas"]))
    found |= set(range(at["betas"], at["width"])) if free.betas else set()
    found |= set(range(at["expression"], at["translation"])) if free.face else set()
    for joint in joints:
        if joint >= layout.FIRST_FINGER:
            first = layout.HANDS + (columns.hand if joint >= layout.FIRST_FINGER + 15 else 0)
            found |= set(range(first, first + columns.hand))
        else:
            first = at["jaw"] if joint == layout.JAW_JOINT else 3 * joint
            found |= set(range(first, first + 3))
    return found


def served(view: SolverView) -> bool:
    """Whether the kernels support the body's points and the pose prior."""
    p = view.parametrisation
    fits = p.dtype == torch.float64 and p.device.type == "cpu" and p.columns.hand <= layout.MOST_HAND
    return fits and network_of(p.prior) is not None


def divided(terms: list[Term]) -> tuple[list[Term], list[Term]]:
    """Terms evaluated by kernels, and the others: of kinds without a kernel, or whose kernel is taken by another term.

    Quadratic terms share a kernel unless two have the same column; of each other kind the kernel takes one.
    """
    known: list[Term] = []
    columns: set[int] = set()
    for term in terms:
        if type(term) is Quadratic:
            mine = set(range(term.where.start, term.where.stop))
            free = not mine & columns
            columns |= mine
        else:
            free = type(term) in k.KERNELS and type(term) not in map(type, known)
        if free:
            known.append(term)
    return known, [term for term in terms if not any(term is one for one in known)]


def constants_of(terms: list[Term], view: SolverView, free: Free, index: Tensor) -> k.Constants:
    """The constants of terms with kernels, one of them the data term."""
    p, points = view.parametrisation, view.points
    laid = _laid(points, p.columns, free)
    data = next(term for term in terms if isinstance(term, Data))
    given: dict[str, np.ndarray] = {}
    for term in terms:
        for name, value in k.KERNELS[type(term)].constants(term).items():
            value = _plain(value)
            given[name] = given[name] + value if name in given else value
    clip = _records(
        k.CLIP,
        (1,),
        **_columns(p.columns),
        free_body=free.body,
        free_hands=free.hands,
        free_face=free.face,
        free_betas=free.betas,
        free=len(index),
        index=index,
        parents=points.tree.parents,
        rest=points.rest,
        rest_directions=points.rest_directions,
        bone_directions=points.bone_directions,
        hand_mean=p.hand_mean.flatten(),
        hand_basis=p.hand_basis.flatten(0, 1),
        focal=view.focal,
        center=view.center,
        **_in(k.CLIP, given),
    )
    assert view.contour_bin is not None or not points.has_contour, "contour landmarks need each frame's yaw table"
    variant = 0 if view.contour_bin is None else view.contour_bin
    return k.Constants(
        clip=clip.view(np.recarray)[0],
        **_network(p.prior)._asdict(),
        **laid._replace(points=_with(laid.points, given))._asdict(),
        keypoints=_records(k.KEYPOINT, tuple(data.weight.shape), **_in(k.KEYPOINT, given)),
        frames=_records(k.FRAME, (len(data.xy),), variant=variant, **_in(k.FRAME, given)),
    )


def with_data(constants: k.Constants, data: Data) -> k.Constants:
    """With other keypoints."""
    given = k.KERNELS[Data].constants(data)
    return constants._replace(points=_with(constants.points, given), keypoints=_with(constants.keypoints, given))


def _with(records: np.ndarray, given: Mapping[str, Any]) -> np.ndarray:
    """A copy with other values of some fields."""
    made = records.copy()
    for name, values in _in(records.dtype, given).items():
        made[name] = values
    return made


def _in(record: np.dtype, given: Mapping[str, Any]) -> dict[str, Any]:
    """The values of a record's fields."""
    assert record.names is not None, "records have fields"
    return {name: value for name, value in given.items() if name in record.names}
