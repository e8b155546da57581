"""Fixtures for all tests."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real development data, which is not part of the project; tests that need it skip without it."""
    default = Path(__file__).parents[1] / ".." / "shared" / "data"
    folder = Path(os.environ.get("TCFIT_SHARED_DATA", default)).resolve()
    if not folder.is_dir():
        pytest.skip(f"the shared development data is not at {folder} (TCFIT_SHARED_DATA names another place)")
    return folder
