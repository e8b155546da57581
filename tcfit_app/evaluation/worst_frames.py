"""The worst frames of an evaluation as pictures: truth and methods side by side."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from fitting_core.body.mesh import shared_mesh
from fitting_core.body.model import JOINT, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera
from fitting_core.measure.curves import CURVES
from fitting_core.measure.records import Record, baseline_of, methods, of, sequences
from fitting_core.measure.report.plots import style_of
from fitting_core.measure.report.sections import View, WorstFrame
from tcfit_app.evaluation.body_pictures import PlacedBody, camera_around, from_the_side, picture, side_camera

_RANKED = ("vertex_to_surface", "pa_mpjpe", "reprojection")
"""What makes a frame bad: the first of these that was measured."""
_COLORS = {"red": (0.75, 0.28, 0.20), "blue": (0.16, 0.40, 0.78), "violet": (0.45, 0.27, 0.72)}
_OTHER, _TRUE = (0.30, 0.55, 0.52), (0.62, 0.63, 0.62)


@dataclass(frozen=True, kw_only=True, eq=False)
class Drawable:
    """A sequence's bodies."""

    camera: Camera
    bodies: dict[str, tuple[BodyModel, BodyParams]]
    """By method."""
    truth: tuple[BodyModel, BodyParams] | None
    """With the reference's frame for each of the fit's, all of them there."""


@dataclass(frozen=True, kw_only=True)
class _Bad:
    sequence: str
    frame: int
    """Counted from the fit's first."""
    method: str
    value: float


def worst_frames(
    records: Sequence[Record], drawable: Callable[[str], Drawable | None], *, count: int
) -> list[WorstFrame]:
    """The frames with the largest errors, one of each sequence for the last method and one for the baseline.

    Args:
        records: Measured fits.
        drawable: The bodies of a sequence, by its name; None: they are not to be had.
        count: How many at most.
    """
    found: list[WorstFrame] = []
    ready: dict[str, Drawable | None] = {}
    for bad in _ranked(records)[:count]:
        if bad.sequence not in ready:
            ready = {bad.sequence: drawable(bad.sequence)}
        shown = ready[bad.sequence]
        if shown is not None:
            found.append(_pictured(bad, records, shown))
    return found


def _ranked(records: Sequence[Record]) -> list[_Bad]:
    """Those of the last method first."""
    curve = next((name for name in _RANKED if any(r.curve(name) is not None for r in records)), None)
    if curve is None:
        return []
    chosen = list(dict.fromkeys([methods(records)[-1], baseline_of(records)]))
    found: list[_Bad] = []
    for method in chosen:
        some = [bad for sequence in sequences(records) if (bad := _worst(records, sequence, method, curve))]
        found += sorted(some, key=lambda bad: -bad.value)
    kept = {(bad.sequence, bad.frame): bad for bad in reversed(found)}
    return [bad for bad in found if kept[bad.sequence, bad.frame] is bad]


def _worst(records: Sequence[Record], sequence: str, method: str, curve: str) -> _Bad | None:
    for record in of(records, sequence=sequence, method=method):
        values = record.curve(curve)
        if values is not None and np.isfinite(values).any():
            frame = int(np.nanargmax(values))
            return _Bad(sequence=sequence, frame=frame, method=method, value=float(values[frame]))
    return None


def _pictured(bad: _Bad, records: Sequence[Record], shown: Drawable) -> WorstFrame:
    curve = next(name for name in _RANKED if any(r.curve(name) is not None for r in records))
    kind, own = CURVES[curve], of(records, sequence=bad.sequence)
    said = ", ".join(f"{r.method} {_told(r, curve, bad.frame)}" for r in own if r.method in shown.bodies)
    placed = dict(_placed(bad.frame, shown, methods(records)))
    return WorstFrame(
        title=f"{bad.sequence}, frame {own[0].comparison.first_frame + bad.frame}",
        note=f"worst of {bad.method}; {kind.title.lower()}: {said} {kind.unit}",
        rows=_rows(placed, shown.camera),
    )


def _told(record: Record, curve: str, frame: int) -> str:
    value = record.comparison.curves[curve][frame] if curve in record.comparison.curves else None
    return "–" if value is None else f"{value:.1f}"


def _placed(frame: int, shown: Drawable, names: list[str]) -> Iterable[tuple[str, PlacedBody]]:
    if shown.truth is not None:
        yield "truth", _body(*shown.truth, frame, _TRUE)
    for method, (body, params) in shown.bodies.items():
        color = _COLORS.get(style_of(method, names).split()[0], _OTHER)
        yield method, _body(body, params, frame, color)


def _body(body: BodyModel, params: BodyParams, frame: int, color: tuple[float, float, float]) -> PlacedBody:
    mesh, one = shared_mesh(body), params[frame : frame + 1]
    vertices = mesh(one)[0].numpy().astype(np.float64)
    pelvis = mesh.joints(one)[0, JOINT["pelvis"]].numpy().astype(np.float64)
    return PlacedBody(vertices=vertices, faces=body.faces, pelvis=pelvis, color=color)


def _rows(placed: dict[str, PlacedBody], camera: Camera) -> tuple[tuple[View, ...], ...]:
    first = next(iter(placed.values()))
    front = camera_around(first, camera)
    aside = {name: from_the_side(body) for name, body in placed.items()}
    side = side_camera(next(iter(aside.values())))
    return (
        tuple(View(title=name, picture=picture(body, front)) for name, body in placed.items()),
        tuple(View(title=f"{name}, side", picture=picture(body, side)) for name, body in aside.items()),
    )
