"""Data that ships with the project: nothing licensed to others' terms only, nothing large."""

from pathlib import Path

FOLDER = Path(__file__).resolve().parent
"""Where the data lies, in a checkout as in an installed package."""

BODIES = FOLDER / "bodies"
"""The free body: SMPLX_NEUTRAL.npz, SMPLX_MALE.npz and SMPLX_FEMALE.npz, with ATTRIBUTION.md."""

HAND_SPACE = FOLDER / "hands" / "hand_space.npz"
"""What hands do, learnt from recordings and postures; the free body's builder reads it. With ATTRIBUTION.md."""
