"""Generated people who hide each other: the truth holds, and whoever is exchanged is named."""

import numpy as np
import pytest

from fitting_core.keypoints import BODY
from tests.samples.company.filmed import film
from tests.samples.company.scenes import SCENES
from tests.samples.company.telling_apart import told_apart


def test_detections_lie_where_their_owners_are():
    company = film("crossing", 2, every=5)
    found = 0
    for t, (people, owners) in enumerate(zip(company.detections.frames, company.owners, strict=True)):
        for points, owner in zip(people, owners, strict=True):
            if owner < 0:
                continue
            true = company.points[owner, t, BODY]
            xy = true[:, :2] / true[:, 2:] * company.camera.focal + company.camera.center
            seen = points[BODY, 2] > 0.4  # what is hidden is found anywhere
            off = np.linalg.norm(points[BODY, :2] - xy, axis=1)[seen]
            assert np.median(off) < 20
            found += 1
    assert found > 60


def test_who_is_behind_is_seen_less():
    """In the frames in which they overlap, the farther one has fewer keypoints than in the others."""
    company = film("behind", 0)
    far = int(np.argmax(company.points[:, :, 0, 2].mean(1)))
    apart = np.abs(np.diff(company.points[:, :, 8, 0] / company.points[:, :, 8, 2], axis=0)[0])
    counts = np.zeros(len(apart))
    for t, (people, owners) in enumerate(zip(company.detections.frames, company.owners, strict=True)):
        if far in owners:
            counts[t] = (people[owners.index(far), :, 2] > 0).sum()
    assert counts[apart < 0.015].mean() < 0.75 * counts[apart > 0.15].mean()


QUICK = ("crossing", "leaving")
"""Scenes of the quick tests: an exchange in plain sight, and one while a person is away."""


@pytest.mark.parametrize(
    "scene", [pytest.param(scene, marks=[pytest.mark.thorough] * (scene not in QUICK)) for scene in SCENES]
)
def test_every_exchange_is_named(scene: str):
    told = [told_apart(film(scene, seed, every=2)) for seed in (0, 1)]
    assert all(one.named == one.exchanges for one in told)
    assert all(one.right > (0.5 if scene == "both leaving" else 0.95) for one in told)
    # Three in a row are near each other for much of their way; who is near nobody is named while away alone.
    named = float(np.mean([one.uncertain for one in told]))
    assert named < (0.03 if scene in ("leaving", "rounding") else 0.25)
