"""Data that ships with the project: nothing licensed to others' terms only, nothing large."""

from pathlib import Path

FOLDER = Path(__file__).resolve().parent
"""Where the data lies, in a checkout as in an installed package."""

BODIES = FOLDER / "bodies"
"""The free bodies: SMPLX_NEUTRAL.npz, SMPLX_MALE.npz, SMPLX_FEMALE.npz and SMPLX_CHILD.npz, with ATTRIBUTION.md."""

HAND_SPACE = FOLDER / "hands" / "hand_space.npz"
"""What hands do, learnt from recordings and postures; the free body's builder reads it. With ATTRIBUTION.md."""

MOTION_SUITE = FOLDER / "motion_suite" / "motion_suite.npz"
"""Sixty windows of captured motion that the motion suite is made of, with ATTRIBUTION.md."""

LIFTER = FOLDER / "lifter" / "tcfit_lifter.npz"
"""The network that tells how deep keypoints lie, with MODEL_CARD.md."""

PERSPECTIVE = FOLDER / "perspective" / "tcfit_perspective.npz"
"""The network that tells how near a camera stood, with MODEL_CARD.md."""
