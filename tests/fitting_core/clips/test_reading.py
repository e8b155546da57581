"""Reading a clip: video and keypoints together, the camera, and what is said about it."""

import json
import math
import re
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from fitting_core.clip import Clip
from fitting_core.clips.options import ClipOptions
from fitting_core.clips.reading import read_clip, read_keypoints
from fitting_core.errors import InputError
from fitting_core.video.frames import FrameSource
from tests.samples.clip_options import as_options
from tests.samples.media import write_images

SIZE = (320, 240)


@pytest.fixture
def walk(write_people, figure) -> Callable[..., Path]:
    """walk(numbers, prefix="walk_"): keypoint files; the person's neck in file n is at x = 100 + n % 100."""

    def write(numbers: list[int] | range, prefix: str = "walk_") -> Path:
        return write_people({f"{prefix}{n:012d}": [figure(100 + n % 100, 120, height=100)] for n in numbers})

    return write


def neck_numbers(clip: Clip) -> list[int | None]:
    """Per frame, the number (modulo 100) of the file that it comes from."""
    xy, confidence = clip.keypoints.xy[:, 1, 0], clip.keypoints.confidence[:, 1]
    return [round(x) - 100 if c > 0 else None for x, c in zip(xy, confidence, strict=True)]


def alignment_note(clip: Clip) -> str:
    notes = [note for note in clip.notes if "keypoint files" in note]
    assert len(notes) <= 1
    return re.sub(r"_0+(?=\d)", "_", notes[0]) if notes else ""


BY_NAMES, FROM_1, FROM_FIRST = "the numbers in their names", "their numbers, counted from 1", "from the first file on"
ALIGNMENTS = {
    "gaps": ([0, 1, 4, 5], [0, 1, None, None, 4, 5], f"{BY_NAMES}. 2 frames have no keypoints"),
    "part in the middle": ([2, 3], [None, None, 2, 3, None, None], "Counted from 1 they fit as well"),
    "perhaps from 1": ([1, 2, 3, 4, 5], [None, 1, 2, 3, 4, 5], "Counted from 1 they fit as well"),
    "numbered from 1": ([1, 2, 3, 4, 5, 6], [1, 2, 3, 4, 5, 6], ""),
    "numbered from 1, one missing": ([1, 2, 4, 5, 6], [1, 2, None, 4, 5, 6], FROM_1),
    "numbered from 1, nobody at first": ([3, 4, 5, 6], [None, None, 3, 4, 5, 6], FROM_1),
    "numbered from 1000": ([1000, 1001, 1003], [0, 1, None, 3, None, None], FROM_FIRST),
    "too many": (list(range(8)), [0, 1, 2, 3, 4, 5], "left out: walk_6, walk_7."),
    "too many, with a gap": ([0, 1, 4, 5, 6, 7], [0, 1, None, None, 4, 5], "left out: walk_6, walk_7. 2 frames"),
    "too many, nobody at first": ([2, 3, 4, 5, 6, 7, 8], [None, None, 2, 3, 4, 5], "out: walk_6, walk_7, walk_8."),
    "too many, from 1": ([1, 2, 4, 5, 6, 7, 8], [1, 2, None, 4, 5, 6], f"{FROM_1}. 2 of the files"),
    "too many, from 1000": ([1000, 1001, 1003, 1004, 1005, 1006], [0, 1, None, 3, 4, 5], "left out: walk_1006."),
    "far apart": ([3, 10, 20], [3, 10, 20, None, None, None], "aligned in their order, from the start. 3 frames"),
}
"""Numbers of the keypoint files beside a video of 6 frames, whose keypoints each frame gets, and what is noted."""


@pytest.mark.parametrize("numbers, expected, note", ALIGNMENTS.values(), ids=ALIGNMENTS)
def test_keypoints_that_do_not_match_the_video(video, walk, numbers, expected, note):
    clip = read_clip(video(6), walk(numbers))
    assert neck_numbers(clip) == expected
    assert note in alignment_note(clip) and bool(note) == bool(alignment_note(clip))


def test_images_are_matched_by_their_names(tmp_path, write_people, figure):
    """SMPLify-X layout, with names that are no numbers of one clip, and an image without keypoints."""
    write_images(tmp_path / "images", "b_7.png", "a.jpg", "c_3.png", size=SIZE)
    write_people({"c_3": [figure(103, 120, height=100)], "a": [figure(101, 120, height=100)]})
    clip = read_clip(tmp_path)
    assert neck_numbers(clip) == [1, None, 3]
    assert (clip.source, clip.name) == (tmp_path / "images", tmp_path.name)
    assert "There are 2 keypoint files, images has 3 frames; they were aligned by the images' names." in clip.notes[0]
    assert any("30 frames per second are assumed" in note for note in clip.notes)


@pytest.mark.parametrize("numbers, expected", [([3, 4], [None, 3, 4]), ([1, 2], [None, 1, 2]), ([4, 6], [4, None, 6])])
def test_images_are_matched_by_their_numbers(tmp_path, walk, numbers, expected):
    """Images 2 to 4 beside files of another name: their numbers count if the images have them all."""
    images = write_images(tmp_path / "images", *(f"shot_{number}.png" for number in (2, 3, 4)), size=SIZE)
    clip = read_clip(images, walk(numbers))
    assert neck_numbers(clip) == expected
    assert ("by the numbers in the images' names" in alignment_note(clip)) == (numbers == [3, 4])


GAPS = (0, 1, 2, 5, 6, 8)
WITH_GAPS = {
    "keypoints of all frames": ("walk", GAPS, range(12), [0, 1, 2, 5, 6, 8], "out: walk_3, walk_4, walk_7, walk_9"),
    "of another name": ("shot", GAPS, range(10), [0, 1, 2, 5, 6, 8], "by the numbers in the images' names"),
    "gaps on both sides": ("walk", GAPS, (0, 1, 3, 5, 6), [0, 1, None, 5, 6, None], "left out: walk_3. 2 frames"),
    "the same, of another name": ("shot", GAPS, (0, 1, 3, 5, 6), [0, 1, None, 5, 6, None], "left out: walk_3"),
    "images of a part": ("shot", range(4, 8), range(12), [4, 5, 6, 7], "out: walk_0, walk_1, walk_2, walk_3, walk_8"),
    "images counted from 1": ("walk", range(1, 7), range(6), [0, 1, 2, 3, 4, 5], ""),
}


@pytest.mark.parametrize("name, images, files, expected, note", WITH_GAPS.values(), ids=WITH_GAPS)
def test_images_with_gaps_in_their_numbers(tmp_path, walk, name, images, files, expected, note):
    """Each image gets the keypoints of its own frame; those that have no image are named."""
    folder = write_images(tmp_path / "images", *(f"{name}_{number}.png" for number in images), size=SIZE)
    clip = read_clip(folder, walk(files))
    assert neck_numbers(clip) == expected
    assert note in alignment_note(clip) and bool(note) == bool(alignment_note(clip))


def test_without_video_the_files_numbers_are_the_frames(walk):
    clip = read_clip(None, walk([20, 21, 24]), clip=ClipOptions(image_size=SIZE, frame_rate=50.0))
    assert neck_numbers(clip) == [20, 21, None, None, 24]
    assert (clip.source, clip.first_frame, clip.frame_rate) == (None, 20, 50.0)
    assert "3 keypoint files, the files' numbers span 5 frames" in alignment_note(clip)
    assert "Person: found in 3 of 5 frames, not in frames 22-23." in clip.notes


def test_without_video_or_size_the_size_is_guessed_and_noted(walk):
    clip = read_clip(None, walk(range(300, 310)))
    assert clip.camera.size == (320, 240)
    assert any("320 x 240 is assumed, the smallest common size" in note for note in clip.notes)
    assert any("30 frames per second are assumed" in note for note in clip.notes)


def neck_numbers_read(path: Path, clip: Clip) -> list[int | None]:
    keypoints, _, _ = read_keypoints(path, clip)
    return neck_numbers(replace(clip, keypoints=keypoints))


@pytest.mark.parametrize("numbers, expected", [([51, 53], [51, None, 53]), ([7, 9], [7, None, 9])])
def test_other_keypoints_for_a_clip_without_video(walk, write_people, figure, numbers, expected):
    """They are matched by their numbers, or from the first file on where the clip has none of these."""
    clip = read_clip(None, walk([50, 51, 52, 53]), clip=ClipOptions(image_size=SIZE, first_frame=51))
    other = write_people({f"other_{n}": [figure(100 + n, 120, height=100)] for n in numbers}, "other")
    assert neck_numbers_read(other, clip) == expected


@pytest.mark.parametrize("first, last", [(-1, 3), (0, 6), (4, 3), (6, None), (None, 100)])
def test_frames_that_are_not_in_the_clip(video, walk, first, last):
    with pytest.raises(InputError, match=r"were asked for \(`first_frame`, `last_frame`\); expected .* 0 to 5"):
        read_clip(video(6), walk(range(6)), clip=ClipOptions(first_frame=first, last_frame=last))


def test_a_person_is_chosen_or_asked_for(video, write_people, figure):
    people = [figure(60, 120, height=60), figure(200, 120, height=120)]
    folder = write_people({f"walk_{t}": people for t in range(3)})
    chosen, asked = read_clip(video(3), folder), read_clip(video(3), folder, clip=ClipOptions(person=0))
    assert neck_numbers(chosen) == [100, 100, 100] and neck_numbers(asked) == [-40, -40, -40]
    assert any("largest and surest of 2 people" in note for note in chosen.notes)
    assert any("the one at place 0 of the list of frame 0, as asked" in note for note in asked.notes)


CAMERAS = {
    "the diagonal, asked for": ({"focal_length": "diagonal"}, 400.0, "not known: assumed to be the image diagonal"),
    "default": ({}, None, "35 mm equivalent of 32 mm, typical of"),
    "pixels": ({"focal_length": 555.0}, 555.0, "focal length of 555 pixels, as given"),
    "fov": ({"fov": 90.0}, 160.0, "horizontal field of view of 90 degrees, as given"),
    "35 mm": ({"focal_length_35mm": 26.0}, 26 / math.hypot(36, 24) * 400, "35 mm equivalent focal length of 26 mm"),
}  # fmt: skip


@pytest.mark.parametrize("options, focal, source", CAMERAS.values(), ids=CAMERAS)
def test_camera(video, walk, options, focal, source):
    camera = read_clip(video(1), walk([0]), **as_options({"center": (150.0, 130.0)} | options)).camera
    assert focal is None or camera.focal == pytest.approx((focal, focal))
    assert camera.center == (150.0, 130.0)
    assert camera.source.startswith(source)


WRONG_OPTIONS = {
    "two focal options": ({"focal_length": 500.0, "fov": 60.0}, "given 2 times: `focal_length` 500 and `fov` 60"),
    "a rule and a focal option": ({"focal_length": "auto", "fov": 60.0}, "2 times: `focal_length` auto and `fov` 60"),
    "no rule": ({"focal_length": "long"}, "`focal_length` is 'long'; expected a number, auto or diagonal"),
    "fov of 0": ({"fov": 0.0}, "`fov` is 0; expected a positive number"),
    "fov of 180": ({"fov": 180.0}, "`fov` is 180; expected degrees from left to right, up to 170"),
    "fov in tiny numbers": ({"fov": 0.01}, "field of view of 0.01 degrees sees 0.01 degrees .* expected 0.5 to 170"),
    "fov NaN": ({"fov": float("nan")}, "`fov` is nan; expected a positive number"),
    "negative focal length": ({"focal_length": -500.0}, "`focal_length` is -500; expected a positive number"),
    "millimetres for pixels": ({"focal_length": 4.2}, r"length of 4.2 pixels sees 177 degrees .* \(`focal_length_35"),
    "infinite focal length": ({"focal_length_35mm": float("inf")}, "`focal_length_35mm` is inf; expected"),
    "centre far outside": ({"center": (5000.0, 120.0)}, r"`center` is \(5000, 120\); expected .* near \(160, 120\)"),
    "centre NaN": ({"center": (float("nan"), 120.0)}, r"`center` is \(nan, 120\); expected"),
    "no frame rate": ({"frame_rate": 0.0}, "`frame_rate` is 0; expected frames per second, above 0"),
    "frame rate NaN": ({"frame_rate": float("nan")}, "`frame_rate` is nan; expected"),
    "another image size": ({"image_size": (640, 480)}, "`image_size` is 640 x 480, but .*walk.avi is 320 x 240 pixels"),
    "image of no size": ({"image_size": (0, 480)}, "`image_size` is 0 x 480; expected width and height in whole"),
    "no such person": ({"person": 4}, "person=4, but no frame of .* has more than one person"),
    "unknown scale": ({"keypoint_scale": "percent"}, "`keypoint_scale` is 'percent'; expected one of auto"),
}  # fmt: skip


@pytest.mark.parametrize("options, message", WRONG_OPTIONS.values(), ids=WRONG_OPTIONS)
def test_wrong_options(video, walk, options, message):
    with pytest.raises(InputError, match=message):
        read_clip(video(1), walk([0]), **as_options(options))


def test_a_truncated_video_is_used_as_far_as_it_goes(video, walk):
    path = video(20)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) * 4 // 5])
    clip = read_clip(path, walk(range(20)))
    assert 5 < len(clip) < 20
    assert f"its header states 20 frames, but only {len(clip)} can be decoded" in clip.notes[0]
    assert f"There are 20 keypoint files, walk.avi has {len(clip)} frames" in alignment_note(clip)


@pytest.mark.parametrize(
    ("found", "words"),
    [
        ({"pixel_aspect": 1.45}, "1.45 times.* too thin.*ffmpeg -i walk.avi -vf scale=iw.sar:ih,setsar=1"),
        ({"pixel_aspect": 0.8}, "0.8 times.* too wide"),
        ({"uneven": True, "frame_rate": 14.98765}, "not evenly spaced in time.* 14.99 per second .*header states 25"),
    ],
)
def test_pixels_that_are_not_square_and_uneven_frames_are_noted(found, words, video, walk, monkeypatch):
    opened = FrameSource.__init__

    def open_odd(self, path, **options):
        opened(self, path, **options)
        vars(self).update(found)

    assert not read_clip(video(1), walk([0])).notes
    monkeypatch.setattr(FrameSource, "__init__", open_odd)
    clip = read_clip(video(1), walk([0]))
    (note,) = clip.notes
    assert re.search(words, note) and clip.frame_rate == found.get("frame_rate", 25)


def test_a_whole_video_is_not_called_truncated(video, walk):
    """Many headers say more frames than there are: length times rate, or what an edit list hides."""
    path = video(20)
    content = bytearray(path.read_bytes())
    for length in (b"avih", b"strh"):
        place = content.index(length) + 8 + {b"avih": 16, b"strh": 32}[length]
        assert content[place : place + 4] == struct.pack("<I", 20)
        struct.pack_into("<I", content, place, 30)
    path.write_bytes(content)
    assert not any("truncated" in note for note in read_clip(path, walk(range(20))).notes)


def test_nothing_detected_in_the_whole_clip(video, write_people):
    folder = write_people({f"walk_{t}": [] for t in range(3)})
    with pytest.raises(InputError, match=r"No keypoint is detected in any of the 3 frames of .*keypoints"):
        read_clip(video(3), folder)
    with pytest.raises(InputError, match="No keypoint is detected in any of the 3 frames"):
        read_clip(None, folder)


def test_keypoints_of_several_clips(video, walk):
    walk([0, 1], "run_")
    with pytest.raises(InputError, match=r"holds keypoint files of 2 clips \(run_\.\.\., walk_\.\.\.\)"):
        read_clip(video(4), walk([0, 1], "walk_"))
    with pytest.raises(InputError, match="holds keypoint files of 2 clips"):
        read_clip(None, walk([0, 1], "walk_"), clip=ClipOptions(image_size=SIZE))


def test_stray_numbers_make_no_endless_clip(walk, write_people, figure):
    walk([0])
    folder = write_people({"walk_999999999999": [figure(100, 120)]})
    with pytest.raises(InputError, match=r"The 2 keypoint files .* are numbered from 0 to 999999999999: too few"):
        read_clip(None, folder, clip=ClipOptions(image_size=SIZE))


def test_keypoints_of_images_of_another_size(video, write_people, figure):
    folder = write_people({"walk_0": [figure(900, 500, height=300)]})
    with pytest.raises(InputError, match=r"100% of the keypoints lie outside the image: .* the image is 320 x 240"):
        read_clip(video(1), folder)


@pytest.mark.parametrize("broken", ["video", "keypoints", "no video", "no images"])
def test_broken_parts_are_named(tmp_path, video, walk, broken):
    path, folder = video(2), walk([0, 1])
    if broken == "video":
        path.write_bytes(b"no video")
    elif broken == "no video":
        path.unlink()
    elif broken == "keypoints":
        (folder / "walk_000000000001_keypoints.json").write_text(json.dumps({"people": [3]}))
    else:
        path = tmp_path / "images"
        path.mkdir()
    names = {"video": "walk.avi is not a video", "keypoints": "000001_keypoints.json: person 0 is the number 3",
             "no video": "walk.avi does not exist", "no images": "No images in"}  # fmt: skip
    with pytest.raises(InputError, match=names[broken]):
        read_clip(path, folder)


REAL = [
    pytest.param("balancing/cam03", 100, (1088, 1920), 60.0, marks=pytest.mark.thorough),
    ("signs/gebaerden", 149, (640, 480), 25.0),
    ("signs/psychologie", 157, (640, 480), 25.0),
]


@pytest.mark.parametrize("folder, frames, size, rate", REAL)
def test_real_clips(shared_data, folder, frames, size, rate):
    path = shared_data / folder
    clip = read_clip(path / "video.mp4", path / "keypoints")
    assert (len(clip), clip.camera.size, clip.frame_rate, clip.notes) == (frames, size, rate, ())
    assert clip.name == path.name
    assert (clip.keypoints.confidence[:, :9].max(1) > 0.2).all()


@pytest.mark.parametrize("name, frames, strays", [("example", 66, ""), ("openpose", 93, "(4 from 1.003 to 1.006)")])
def test_real_keypoints_without_video(shared_data, name, frames, strays):
    clip = read_clip(None, shared_data / "openpose_sequences" / name)
    assert len(clip) == frames and clip.name == name
    assert len(clip.notes) == 2 + bool(strays)
    assert not strays or f"has confidences outside 0 to 1 {strays}" in clip.notes[0]
