"""Derivative of a body's points by the free pose columns, assembled from their closed-form entries."""

import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core.body.model import JOINT, N_BETAS, N_EXPRESSION, POSE_COLUMNS, POSE_JOINTS
from fitting_core.body.points.body_points import N_COEFFICIENTS, BodyPoints, Posed
from fitting_core.fit.variables.state import Columns, Free

_JAW = JOINT["jaw"]
_FIRST_FINGER = JOINT["left_index1"]
_BODY = POSE_JOINTS["body_pose"]


class PointJacobian:
    """Assembles by_point @ d points / d (free columns), for one list of points and one choice of free groups.

    Columns are those of `columns` (axis-angle pose), the free ones only, in order. The eyes are never free.
    """

    def __init__(self, points: BodyPoints, columns: Columns, free: Free, hand_basis: Float[Tensor, "2 45 K"]) -> None:
        self.points, self.columns, self.free, self.hand_basis = points, columns, free, hand_basis
        self._others: dict[BodyPoints, PointJacobian] = {}
        self.width = len(free.index(columns))
        start = 0
        self.place: dict[int, int] = {}  # first full column of a free group -> its first compact column
        for group in free.columns(columns):
            self.place[group.start] = start
            start += group.stop - group.start
        joint = points.entry_joint
        self.direct = (joint == 0) | ((joint < _BODY.stop) & free.body) | ((joint == _JAW) & free.face)
        self.direct = self.direct.nonzero()[:, 0]
        self.finger = ((joint >= _FIRST_FINGER) & free.hands).nonzero()[:, 0]
        self._index_direct()
        if free.hands:
            self._index_fingers(hand_basis)

    def on(self, points: BodyPoints) -> "PointJacobian":
        """The same for other points, created once."""
        if points not in self._others:
            self._others[points] = PointJacobian(points, self.columns, self.free, self.hand_basis)
        return self._others[points]

    def _index_direct(self) -> None:
        joint, point = self.points.entry_joint[self.direct], self.points.entry_point[self.direct]
        jaw_start = self.place.get(self.columns.jaw.start, 0)
        self.direct_column = torch.where(joint == _JAW, jaw_start, 3 * joint)
        self.direct_point = point

    def _index_fingers(self, hand_basis: Tensor) -> None:
        joint, point = self.points.entry_joint[self.finger], self.points.entry_point[self.finger]
        self.finger_points, self.finger_row = point.unique(return_inverse=True)
        self.finger_column = 3 * (joint - _FIRST_FINGER)
        half = hand_basis.shape[2]
        self.basis = hand_basis.new_zeros(90, 2 * half)
        self.basis[:45, :half], self.basis[45:, half:] = hand_basis[0], hand_basis[1]

    def _scatter(self, target: Tensor, rows: Tensor, columns: Tensor, values: Float[Tensor, "B E R 3"]) -> None:
        """target (B, N, R, width)[:, rows, :, columns..columns+2] = values, as one flat copy."""
        _, _, ranks, width = target.shape
        rank = torch.arange(ranks, device=rows.device)
        flat = ((rows[:, None] * ranks + rank) * width + columns[:, None])[..., None] + torch.arange(
            3, device=rows.device
        )
        target.view(len(target), -1)[:, flat.flatten()] = values.flatten(1)

    def __call__(
        self, posed: Posed, by_point: Float[Tensor, "B N R 3"], *, translation: bool = True
    ) -> Float[Tensor, "B N*R width"]:
        """The Jacobian of R residuals for each point, from `by_point`, their derivatives by its position (camera axes).

        `translation` False: the residuals do not depend on the camera translation.
        """
        frames, count, ranks, _ = by_point.shape
        entries = self.points.rotation_entries(posed, by_point)
        out = by_point.new_zeros(frames, count, ranks, self.width)
        self._scatter(out, self.direct_point, self.direct_column, entries[:, self.direct])
        if self.free.hands and len(self.finger):
            fingers = by_point.new_zeros(frames, len(self.finger_points), ranks, 90)
            self._scatter(fingers, self.finger_row, self.finger_column, entries[:, self.finger])
            start = self.place[self.columns.hands.start]
            out[:, self.finger_points, :, start : start + self.basis.shape[1]] = fingers @ self.basis
        if self.free.face:
            self._put_coefficients(
                out, posed, by_point, self.place[self.columns.jaw.start] + 3, slice(10, N_COEFFICIENTS)
            )
        if translation and self.free.translation:
            start = self.place[self.columns.translation.start]
            out[..., start : start + 3] = by_point
        if self.free.betas:
            self._put_coefficients(out, posed, by_point, self.place[self.columns.betas.start], slice(0, 10))
        return out.flatten(1, 2)

    def _put_coefficients(self, out: Tensor, posed: Posed, by_point: Tensor, start: int, which: slice) -> None:
        moved = by_point @ self.points.coefficient_jacobian(posed, which)
        out[..., start : start + moved.shape[-1]] = moved

    @property
    def needs_coefficients(self) -> bool:
        """Whether betas or expression are free."""
        return self.free.betas or self.free.face

    def in_free_columns(
        self, by_joint: Float[Tensor, "R 55 3"], by_coefficient: Float[Tensor, "R 20"] | None = None
    ) -> Float[Tensor, "R width"]:
        """Derivatives by the joints' axis-angles (and by betas and expression) as rows in the free columns.

        For points that do not move with the camera translation.
        """
        out = by_joint.new_zeros(len(by_joint), self.width)
        out[:, :3] = by_joint[:, 0]
        if self.free.body:
            out[:, POSE_COLUMNS["body_pose"]] = by_joint[:, _BODY].flatten(1)
        if self.free.hands:
            start = self.place[self.columns.hands.start]
            out[:, start : start + self.basis.shape[1]] = by_joint[:, _FIRST_FINGER:].flatten(1) @ self.basis
        if self.free.face:
            start = self.place[self.columns.jaw.start]
            out[:, start : start + 3] = by_joint[:, _JAW]
            if by_coefficient is not None:
                out[:, start + 3 : start + 3 + N_EXPRESSION] = by_coefficient[:, N_BETAS:]
        if self.free.betas and by_coefficient is not None:
            start = self.place[self.columns.betas.start]
            out[:, start : start + N_BETAS] = by_coefficient[:, :N_BETAS]
        return out

    def corrective_gradient(self, posed: Posed, by_point: Float[Tensor, "B N 3"]) -> Float[Tensor, "B width"]:
        """Sum of by_point . d points / d (free columns) through the pose correctives, which the Jacobian omits."""
        return self.in_free_columns(self.points.corrective_gradient(posed, by_point))
