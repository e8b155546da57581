"""Where each frame's fit came from: what files hold, and what it says to a person."""

import numpy as np
import pytest

from fitting_core.results.provenance import Provenance, Start, Stopped


def test_numbers_that_files_hold_keep_their_meaning():
    starts = ["UNKNOWN", "TURNED_0", "TURNED_90", "TURNED_180", "TURNED_270", "SEAT", "FRAME_BEFORE", "FRAME_AFTER"]
    limbs = ["LEFT_ARM", "RIGHT_ARM", "LEFT_LEG", "RIGHT_LEG", "LEFT_HAND", "RIGHT_HAND"]
    assert [s.name for s in sorted(Start)] == [*starts, *limbs, "FILLED", "AGAIN", "BETWEEN", "GIVEN"]
    assert [int(s) for s in sorted(Start)] == list(range(18))
    assert {s.name: int(s) for s in Stopped} == {
        "UNKNOWN": 0, "CONVERGED": 1, "ITERATIONS": 2, "STALLED": 3, "FAILED": 4, "EMPTY": 5,
    }  # fmt: skip


def test_sentences_name_each_frame_s_own():
    given = Provenance(np.array([5, 1, 5], np.uint8), np.array([2, 1, 2], np.uint8))
    texts, which = given.sentences()
    seat = "started from a sitting pose, stopped because the limit of iterations was reached"
    facing = "started from the neutral pose, facing the camera, stopped because the cost fell no further"
    assert [texts[i] for i in which] == [seat, facing, seat] and len(texts) == 2


def test_numbers_of_a_later_version_are_unknown():
    texts, which = Provenance(np.array([200], np.uint8), np.array([1], np.uint8)).sentences()
    assert texts[which[0]].startswith("started from a start that was not noted, stopped because the cost")


@pytest.mark.parametrize("frames", [range(0, 2), range(3, 5), range(1, 1)])
def test_some_frames_are_replaced(frames: range):
    before = Provenance(np.arange(5, dtype=np.uint8), np.arange(5, dtype=np.uint8) + 10)
    other = Provenance(np.full(len(frames), 99, np.uint8), np.full(len(frames), 98, np.uint8))
    after = before.with_frames(frames, other)
    assert after.start.tolist() == [99 if i in frames else i for i in range(5)]
    assert after.stopped.tolist() == [98 if i in frames else i + 10 for i in range(5)]
    part = after[frames.start : frames.stop]
    assert part.start.tolist() == other.start.tolist() and len(part) == len(frames)
    assert before.start.tolist() == list(range(5))
