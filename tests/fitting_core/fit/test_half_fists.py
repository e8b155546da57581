"""Half fists: hands whose fingers are halfway between open and closed, from which a fit can start."""

import numpy as np
import torch

from fitting_core import keypoints as kp
from fitting_core.body.model import BodyModel
from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.fit.variables.state import Parametrisation
from fitting_core.priors.pose import PRIORS


def test_half_fists_are_halfway(free_body: BodyModel) -> None:
    parametrisation = Parametrisation(free_body, PRIORS["relaxed"](), hand_components=12, dtype=torch.float64)
    mean = parametrisation.neutral(1)
    half = parametrisation.with_half_fists(mean)
    length: dict[str, np.ndarray] = {}
    for name, state in (("mean", mean), ("half", half)):
        keypoints, _ = keypoints_in_space(free_body, parametrisation.to_params(state))
        hands = keypoints[0, kp.HANDS].reshape(2, 21, 3)
        length[name] = np.linalg.norm(hands[:, 8::4] - hands[:, :1], axis=-1)
    assert (length["half"] < 0.75 * length["mean"]).all() and (length["half"] > 0.3 * length["mean"]).all()
    assert np.allclose(length["half"][0], length["half"][1], atol=1e-4)
