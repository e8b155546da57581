"""Freed memory goes back to the system."""

import ctypes
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from fitting_core.memory import give_back

MANY = 3000
"""Blocks of 64 KiB: glibc keeps those below 128 KiB for itself."""


def _resident() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(
    sys.platform != "linux" or not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="no glibc, which keeps it"
)
def test_what_lies_below_a_block_in_use_is_given_back():
    blocks = [np.ones(1 << 13) for _ in range(MANY)]
    in_use = blocks[-1]  # above all others: the heap cannot shrink
    del blocks
    before = _resident()
    give_back()
    assert before - _resident() > MANY * in_use.nbytes / 2


def test_systems_without_it_are_left_alone(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(ctypes, "CDLL", lambda name: pytest.fail("asked for a C library"))
    give_back()
