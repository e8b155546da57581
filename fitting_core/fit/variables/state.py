"""The solver's variables of some frames, their columns, and conversion to and from BodyParams."""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from fitting_core.body import rotations
from fitting_core.body.model import N_BETAS, N_EXPRESSION, N_JOINTS, POSE_COLUMNS, BodyModel
from fitting_core.body.params import BodyParams, hand_basis
from fitting_core.body.points.body_points import whole_pose
from fitting_core.priors.pose import PosePrior

_HALF_FIST = [[(0, 0, -55), (0, 0, -66), (0, 0, -42)]] * 4 + [[(21, 17, -8), (8, 18, -7), (7, 23, -8)]]
"""Axis-angle in degrees of the left hand's finger joints in SMPL-X's order, the thumb last."""
_TOGETHER = 1024
"""Frames decoded at once."""


@dataclass(frozen=True)
class Columns:
    """Place of each group in the tangent vector of one frame, for a pose of `pose` and hands of `hand` numbers."""

    pose: int
    hand: int

    @property
    def orient(self) -> slice:
        """The root's rotation."""
        return slice(0, 3)

    @property
    def body(self) -> slice:
        """The pose prior's numbers."""
        return slice(3, 3 + self.pose)

    @property
    def hands(self) -> slice:
        """Left hand, then right."""
        return slice(self.body.stop, self.body.stop + 2 * self.hand)

    @property
    def jaw(self) -> slice:
        """Axis-angle."""
        return slice(self.hands.stop, self.hands.stop + 3)

    @property
    def expression(self) -> slice:
        """Its coefficients."""
        return slice(self.jaw.stop, self.jaw.stop + N_EXPRESSION)

    @property
    def translation(self) -> slice:
        """From the body's origin into camera space, metres."""
        return slice(self.expression.stop, self.expression.stop + 3)

    @property
    def frame(self) -> int:
        """Numbers that belong to one frame alone."""
        return self.translation.stop

    @property
    def betas(self) -> slice:
        """The shape."""
        return slice(self.frame, self.frame + N_BETAS)

    @property
    def total(self) -> int:
        """Length of the whole vector."""
        return self.betas.stop


@dataclass(frozen=True)
class Free:
    """Which groups a solver moves besides the orientation; the others stay."""

    body: bool = True
    hands: bool = True
    face: bool = True
    betas: bool = True
    translation: bool = True

    def columns(self, c: Columns) -> list[slice]:
        """Slices of the tangent vector that move, in order."""
        groups = [
            (True, c.orient),
            (self.body, c.body),
            (self.hands, c.hands),
            (self.face, slice(c.jaw.start, c.expression.stop)),
        ]
        groups += [(self.translation, c.translation), (self.betas, c.betas)]
        return [columns for free, columns in groups if free]

    def index(self, c: Columns) -> Tensor:
        """The same as one index vector."""
        return torch.cat([torch.arange(s.start, s.stop) for s in self.columns(c)])


@dataclass(frozen=True)
class State:
    """Variables of B frames. The root's rotation is a matrix: an additive axis-angle wandered to |v| = 69."""

    orient: Float[Tensor, "B 3 3"]
    vector: Float[Tensor, "B total"]
    """Tangent columns (see Columns); those of the orientation stay zero."""

    def __len__(self) -> int:
        return len(self.vector)

    def __getitem__(self, frames: slice | Tensor) -> "State":
        return State(self.orient[frames], self.vector[frames])

    def moved(self, step: Float[Tensor, "B total"]) -> "State":
        """The retraction: orientation rotated by the step about world axes, everything else added."""
        turn = step.clone()
        turn[:, 3:] = 0
        return State(rotations.exp(step[:, :3]) @ self.orient, self.vector + (step - turn))

    def put(self, frames: Tensor, other: "State") -> "State":
        """A copy in which `frames` (indices or a mask) take the values of `other`."""
        orient, vector = self.orient.clone(), self.vector.clone()
        orient[frames], vector[frames] = other.orient, other.vector
        return State(orient, vector)

    def with_columns(self, columns: slice, values: Tensor) -> "State":
        """A copy with these columns of every frame replaced."""
        vector = self.vector.clone()
        vector[:, columns] = values
        return replace(self, vector=vector)

    @staticmethod
    def cat(states: list["State"]) -> "State":
        """The frames of all of them, in order."""
        return State(torch.cat([s.orient for s in states]), torch.cat([s.vector for s in states]))


class Parametrisation:
    """How a State's numbers become the pose of one body: the pose prior's decoder and the hand space."""

    def __init__(
        self,
        body: BodyModel,
        prior: PosePrior,
        *,
        hand_components: int,
        dtype: torch.dtype,
        device: torch.device | str = "cpu",
    ) -> None:
        self.prior = prior
        self.dtype, self.device = dtype, torch.device(device)
        self.columns = Columns(prior.size, hand_components)
        self.like = torch.zeros(0, dtype=dtype, device=device)
        """Of the type and on the device of its numbers."""
        self.hand_basis, self.hand_mean = hand_basis(body, hand_components, self.like)

    def neutral(self, frames: int) -> State:
        """The prior's neutral pose, mean hands, the mean shape, unit orientation, at the origin."""
        vector = torch.zeros(frames, self.columns.total, dtype=self.dtype, device=self.device)
        vector[:, self.columns.body] = self.prior.neutral.to(vector)
        return State(torch.eye(3, dtype=self.dtype, device=self.device).expand(frames, 3, 3).clone(), vector)

    def body_pose(self, state: State) -> Float[Tensor, "B 63"]:
        """Axis-angle of the 21 body joints."""
        return self.prior.decode(state.vector[:, self.columns.body])

    def with_half_fists(self, state: State) -> State:
        """The same states with both hands halfway to a fist, as near as the hand space allows."""
        left = torch.tensor(_HALF_FIST).to(self.hand_mean).deg2rad()
        both = torch.stack([left, left * left.new_tensor([1.0, -1.0, -1.0])])
        return state.with_columns(self.columns.hands, self.nearest_hands(both.flatten()).expand(len(state), -1))

    def nearest_hands(self, angles: Float[Tensor, "*b 90"]) -> Float[Tensor, "*b hands"]:
        """The numbers of the hands of the hand space that are nearest to 15 + 15 finger joints' axis-angle."""
        offset = angles.unflatten(-1, (2, 45)) - self.hand_mean
        return torch.einsum("hjk,...hj->...hk", self.hand_basis, offset).flatten(-2)

    def hands(self, state: State) -> Float[Tensor, "B 90"]:
        """Axis-angle of the 15 + 15 finger joints."""
        half = self.columns.hand
        values = state.vector[:, self.columns.hands]
        left = self.hand_mean[0] + values[:, :half] @ self.hand_basis[0].T
        return torch.cat([left, self.hand_mean[1] + values[:, half:] @ self.hand_basis[1].T], 1)

    def pose(self, state: State, body_pose: Tensor) -> Float[Tensor, "B 54 3"]:
        """Axis-angle of every joint but the root."""
        return whole_pose(body_pose, state.vector[:, self.columns.jaw], self.hands(state))

    def pose_jacobian(self, state: State) -> Float[Tensor, "B 165 total"]:
        """Derivatives of the axis-angle of all 55 joints by the columns; the root's are turns in camera space."""
        c, joints = self.columns, POSE_COLUMNS
        jacobian = state.vector.new_zeros(len(state), 3 * N_JOINTS, c.total)
        for name, columns in (("global_orient", c.orient), ("jaw_pose", c.jaw)):
            jacobian[:, joints[name], columns] = torch.eye(3).to(jacobian)
        # One step moves all frames, as they are independent.
        latent = state.vector[:, c.body]
        decoded = torch.func.jacfwd(lambda step: self.prior.decode(latent + step))(torch.zeros_like(latent[0]))
        jacobian[:, joints["body_pose"], c.body] = decoded
        for side, basis in enumerate(self.hand_basis):
            columns = slice(c.hands.start + side * c.hand, c.hands.start + (side + 1) * c.hand)
            jacobian[:, joints[("left_hand_pose", "right_hand_pose")[side]], columns] = basis
        return jacobian

    def coefficients(self, state: State) -> Float[Tensor, "B 20"]:
        """Betas, then expression."""
        return torch.cat([state.vector[:, self.columns.betas], state.vector[:, self.columns.expression]], 1)

    def to_params(self, state: State) -> BodyParams:
        """The user's form: detached, on the CPU, float64."""
        c, v, half = self.columns, state.vector, self.columns.hand
        # All at once, a latent prior's layers would take 25 kB a frame.
        poses = [self.prior.decode(part) for part in v[:, c.body].split(_TOGETHER)]
        params = BodyParams(
            betas=v[:, c.betas],
            global_orient=rotations.log(state.orient),
            body_pose=torch.cat(poses),
            left_hand_pose=v[:, c.hands][:, :half],
            right_hand_pose=v[:, c.hands][:, half:],
            jaw_pose=v[:, c.jaw],
            leye_pose=torch.zeros_like(v[:, c.jaw]),
            reye_pose=torch.zeros_like(v[:, c.jaw]),
            expression=v[:, c.expression],
            camera_translation=v[:, c.translation],
        )
        return BodyParams(**{n: t.detach().cpu().double().clone() for n, t in vars(params).items()})

    def from_params(self, params: BodyParams) -> State:
        """The state that decodes to `params`; a latent prior encodes, which may lose what it cannot express."""
        params = params.to(dtype=self.dtype, device=self.device)
        body = self.prior.encode(params.body_pose)
        parts = [
            torch.zeros_like(params.global_orient),
            body,
            params.left_hand_pose,
            params.right_hand_pose,
            params.jaw_pose,
        ]
        parts += [params.expression, params.camera_translation, params.betas]
        return State(rotations.exp(params.global_orient), torch.cat(parts, 1))
