"""Fresh starts for frames that are astray: drawn poses, varied hands and limbs, and the best limbs put together.

A frame that stays away from sharp keypoints is in a wrong minimum, and nothing near it tells the way out.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fitting_core import keypoints as kp
from fitting_core import rotations
from fitting_core.body.model import JOINT
from fitting_core.fit.phases.search.limb_flips import FLIPS, LIMBS, LimbFlips
from fitting_core.fit.stages import N_STAGES, Stages
from fitting_core.fit.terms.terms import Data
from fitting_core.fit.variables.estimate import Estimate
from fitting_core.fit.variables.state import State
from fitting_core.priors.loosened import Loosened
from fitting_core.priors.pose import AxisAnglePrior, PosePrior

TURNED_WRISTS = (0.0, 1.57, -1.57)
"""Radians about the forearm: fingers that bend the wrong way mostly belong to a forearm turned over."""
DRAWN_LIMBS = 6
"""Limbs of drawn poses that are tried in the place of one that does not fit."""
_MISFIT = 0.04
"""Root mean square residual in pixels of an image 1000 high (hands: half as much) over which a part does not fit: right
ones end at 0.01 to 0.03 at mean shape, in the mirror or with crossed fingers at 0.06 and more."""
_BETTER = 0.8
"""Share of a part's misfit under which another one is better."""
_LOST = 4
"""Every so many drawn poses have any orientation: of 91 poses one, who lies, was turned by 178 degrees."""
_ORIENT_SPREAD, _AXIS_ANGLE_SPREAD = 0.25, 0.4
"""Standard deviations in radians: of the root about each axis, and of joints where the prior is no latent space."""


@dataclass(frozen=True, kw_only=True)
class Part:
    """What of a pose can be taken from another one."""

    side: str
    joints: tuple[str, ...]
    """Whose rotations are taken."""
    hand: int | None = None
    """0: the left hand's fingers too, 1: the right hand's."""
    limb: str | None = None
    """Name of what can be mirrored in depth; None for a hand."""
    points: tuple[int, ...]
    """Keypoints that tell how well it fits."""


def _parts(side: str, hand: slice, index: int) -> dict[str, Part]:
    fingers, body = tuple(range(hand.start, hand.stop)), kp.INDEX
    arm = tuple(f"{side}_{joint}" for joint in ("collar", "shoulder", "elbow", "wrist"))
    leg = tuple(f"{side}_{joint}" for joint in ("hip", "knee", "ankle", "foot"))
    reach = (body[f"{side}_elbow"], body[f"{side}_wrist"], *fingers)
    foot = tuple(body[f"{side}_{point}"] for point in ("knee", "ankle", "big_toe", "small_toe", "heel"))
    return {
        f"{side}_arm": Part(side=side, joints=arm, hand=index, limb=f"{side}_arm", points=reach),
        f"{side}_hand": Part(side=side, joints=arm[3:], hand=index, points=fingers),
        f"{side}_leg": Part(side=side, joints=leg, limb=f"{side}_leg", points=foot),
    }


PARTS = {**_parts("left", kp.LEFT_HAND, 0), **_parts("right", kp.RIGHT_HAND, 1)}


@dataclass(frozen=True)
class Starts:
    """States, and which of the caller's each was made from."""

    state: State
    source: Int[Tensor, "n"]

    @staticmethod
    def cat(parts: list["Starts"]) -> "Starts":
        """All of them, in order."""
        return Starts(State.cat([p.state for p in parts]), torch.cat([p.source for p in parts]))


class FreshStarts:
    """Makes starts from states of one clip.

    Args:
        stages: with keypoints as sharp as it takes for one minimum to show beside others, and no sharper.
        state: of the whole clip, for the tables of the face contour.
        seed: of what is drawn.
    """

    def __init__(self, stages: Stages, state: State, seed: int) -> None:
        self.parametrisation, self.flips = stages.parametrisation, LimbFlips(stages)
        # A free shape adapts to wrong poses (betas of 2 to 20), which then miss no more than the right one; and without
        # outliers nothing is gained by a function that lets go of points that start far off.
        self.objective = stages.objective(N_STAGES, state, stages.free(N_STAGES, betas=False)).trusting()
        self.generator = torch.Generator().manual_seed(seed)
        self.unit = stages.sharpness**0.5
        points = stages.data_keypoints(N_STAGES)
        self.members = torch.stack([torch.isin(points, points.new_tensor(p.points)) for p in PARTS.values()])

    def _normal(self, *shape: int) -> Tensor:
        drawn = torch.randn(*shape, generator=self.generator, dtype=torch.float64)
        return drawn.to(self.parametrisation.neutral(1).vector)

    def drawn(self, state: State, count: int) -> Starts:
        """For each state so many others at about the same place, of mean shape.

        Half of the hands are halfway to a fist, the others any.
        """
        p, total = self.parametrisation, count * len(state)
        source = torch.arange(len(state), device=state.vector.device).repeat_interleave(count)
        vector = p.neutral(total).vector
        vector[:, p.columns.translation] = state.vector[source, p.columns.translation]
        vector[:, p.columns.body] = drawn_poses(p.prior, self._normal(total, p.prior.size))
        vector[:, p.columns.hands] = self._normal(total, 2 * p.columns.hand)
        orient = rotations.exp(_ORIENT_SPREAD * self._normal(total, 3)) @ state.orient[source]
        lost = torch.arange(total, device=vector.device)[_LOST - 1 :: _LOST]
        orient[lost] = rotations.orthonormalised(self._normal(len(lost), 3, 2))
        starts = State(orient, vector)
        fists = torch.arange(0, total, 2, device=vector.device)
        return Starts(starts.put(fists, p.with_half_fists(starts[fists])), source)

    def of_mean_shape(self, state: State) -> State:
        """The states with their shape at rest."""
        betas = self.parametrisation.columns.betas
        return state.with_columns(betas, torch.zeros_like(state.vector[:, betas]))

    def misfits(self, state: State, frames: Int[Tensor, "B"]) -> Float[Tensor, "B P"]:
        """Root of the mean squared residual of each part's keypoints, weighted, in pixels of an image 1000 high."""
        data = self.objective.terms[0]
        assert isinstance(data, Data)
        residual = data.residual(Estimate(self.objective.view, state, frames)) / self.unit
        members = self.members.to(residual)
        square = residual.square().view(len(state), -1, 2).sum(-1)
        return (square @ members.T / members.sum(1).clamp_min(1)).sqrt()

    def _fingers(self, hand: int) -> slice:
        c = self.parametrisation.columns
        return slice(c.hands.start + hand * c.hand, c.hands.start + (hand + 1) * c.hand)

    def with_part(self, state: State, donor: State, part: Part) -> State:
        """The states with a part of the donors' poses."""
        p = self.parametrisation
        pose, other = p.body_pose(state).clone(), p.body_pose(donor)
        for joint in part.joints:
            own = slice(3 * (JOINT[joint] - 1), 3 * JOINT[joint])
            pose[:, own] = other[:, own]
        state = state.with_columns(p.columns.body, p.prior.encode(pose))
        if part.hand is None:
            return state
        fingers = self._fingers(part.hand)
        return state.with_columns(fingers, donor.vector[:, fingers])

    def crossed(self, state: State, donors: Int[Tensor, "B P"], pool: State, better: Tensor) -> Starts:
        """The states with each part of a donor in the pool where that is better, and with all of these."""
        made, everything = [], state
        for k, part in enumerate(PARTS.values()):
            rows = better[:, k].nonzero()[:, 0]
            if not len(rows):
                continue
            donor = pool[donors[rows, k]]
            made.append(Starts(self.with_part(state[rows], donor, part), rows))
            everything = everything.put(rows, self.with_part(everything[rows], donor, part))
        several = (better.sum(1) > 1).nonzero()[:, 0]
        return Starts.cat([*made, Starts(everything[several], several)])

    def better_donors(
        self, misfit: Float[Tensor, "n P"], base: Int[Tensor, "B"], owner: Int[Tensor, "n"]
    ) -> tuple[Int[Tensor, "B P"], Tensor]:
        """For each base (index into the pool) and part the best of the same owner, and whether it is better."""
        same = owner[base][:, None] == owner
        reachable = torch.where(same[..., None], misfit, torch.inf)
        lowest = reachable.min(1)
        return lowest.indices, lowest.values < _BETTER * misfit[base]

    def varied(self, state: State, misfit: Float[Tensor, "B P"]) -> Starts | None:
        """The states with each part varied that does not fit; None if all do."""
        made: list[Starts] = []
        for k, part in enumerate(PARTS.values()):
            rows = (misfit[:, k] > _MISFIT).nonzero()[:, 0]
            if len(rows):
                vary = self._varied_limb if part.limb else self._varied_hand
                made += [Starts(s.state, rows[s.source]) for s in vary(state[rows], part)]
        return Starts.cat(made) if made else None

    def _varied_limb(self, state: State, part: Part) -> list[Starts]:
        """Mirrored in depth, and replaced by drawn ones."""
        assert part.limb is not None
        own, limb = torch.arange(len(state), device=state.vector.device), LIMBS[part.limb]
        flips = [Starts(self.flips.flipped(state, limb, upper=upper, lower=lower), own) for upper, lower in FLIPS]
        drawn = self.drawn(state, DRAWN_LIMBS)
        return [*flips, Starts(self.with_part(state[drawn.source], drawn.state, part), drawn.source)]

    def _varied_hand(self, state: State, part: Part) -> list[Starts]:
        """With other fingers, and with the forearm turned over."""
        assert part.hand is not None
        p, fingers = self.parametrisation, self._fingers(part.hand)
        own, now = torch.arange(len(state), device=state.vector.device), state.vector[:, fingers]
        others = (0 * now, -now, p.with_half_fists(state).vector[:, fingers], self._normal(*now.shape))
        pose, wrist = p.body_pose(state), JOINT[f"{part.side}_wrist"]
        columns, made = slice(3 * (wrist - 1), 3 * wrist), []
        for angle in TURNED_WRISTS:
            turned = pose.clone()
            turn = rotations.exp(pose.new_tensor([[angle, 0.0, 0.0]]))
            turned[:, columns] = rotations.log(rotations.exp(pose[:, columns]) @ turn)
            start = state.with_columns(p.columns.body, p.prior.encode(turned))
            made += [Starts(start.with_columns(fingers, values), own) for values in others]
        return made


def drawn_poses(prior: PosePrior, normal: Float[Tensor, "B size"]) -> Float[Tensor, "B size"]:
    """Numbers of a prior that are distributed as it expects, from normally distributed ones."""
    if isinstance(prior, AxisAnglePrior):
        return prior.neutral.to(normal) + _AXIS_ANGLE_SPREAD * normal
    held = prior.prior.size if isinstance(prior, Loosened) else prior.size
    return torch.cat([normal[:, :held], torch.zeros_like(normal[:, held:])], 1)
