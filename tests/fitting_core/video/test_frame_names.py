"""Numbers of frames in the names of files."""

import pytest

from fitting_core.video.frame_names import frame_numbers, image_numbers

NAMES: dict[tuple[str, ...], tuple[int, ...] | None] = {
    ("walk_0009", "walk_0010"): (9, 10),
    ("9", "10"): (9, 10),
    ("cam01.0009", "cam01.0010"): (9, 10),
    ("walk_0009_30fps", "walk_0010_30fps"): (9, 10),
    ("clip (9)", "clip (10)"): (9, 10),
    ("1403636579763555584", "1403636579813555456"): (1403636579763555584, 1403636579813555456),
    ("walk_9_of_9", "walk_10_of_10"): (9, 10),
    ("walk_0012",): (12,),
    ("walk_12", "walk_0012"): (12, 12),
    ("walk_12_30fps",): None,
    ("walk", "run"): None,
    ("walk_9", "run_10"): None,
    ("walk_9", "walk"): None,
    ("walk_1_33", "walk_2_66"): None,
    (): None,
}


@pytest.mark.parametrize("names", NAMES)
def test_the_one_number_by_which_names_differ(names: tuple[str, ...]):
    assert frame_numbers(names) == NAMES[names]
    assert image_numbers(names) == {number: k for k, number in enumerate(NAMES[names] or ())}
