"""Frames of videos and image folders."""

import os
import re
import struct
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from av.video.stream import VideoStream

from fitting_core.errors import InputError
from fitting_core.video import decoding as video_file
from fitting_core.video.decoding import ends_early, told_35mm
from fitting_core.video.frames import FrameSource

STEP = 8


def painted(index: int, size: tuple[int, int] = (64, 48)) -> np.ndarray:
    """A grey whose level tells the frame (RGB), with a red upper left quarter."""
    image = np.full((size[1], size[0], 3), STEP * index % 250, dtype=np.uint8)
    image[: size[1] // 2, : size[0] // 2] = (250, 0, 0)
    return image


def shown(frame: np.ndarray) -> int:
    """The index that a painted frame tells."""
    return round(float(frame[-8:, -8:].mean()) / STEP)


def red_corner(frame: np.ndarray) -> tuple[str, str]:
    """Where the red quarter is."""
    red = frame[..., 0].astype(int) - frame[..., 1] > 100
    rows, columns = np.nonzero(red)
    half_height, half_width = frame.shape[0] / 2, frame.shape[1] / 2
    return ("upper" if rows.mean() < half_height else "lower", "left" if columns.mean() < half_width else "right")


@pytest.fixture
def write_video(tmp_path: Path) -> Callable[..., Path]:
    """write_video(count, name="walk.avi", codec="MJPG"): a video of painted frames, 25 per second."""

    def write(count: int, name: str = "walk.avi", codec: str = "MJPG") -> Path:
        path = tmp_path / name
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), 25.0, (64, 48))
        for index in range(count):
            writer.write(painted(index)[..., ::-1])
        writer.release()
        return path

    return write


def encode(
    path: Path,
    count: int,
    codec: str,
    *,
    size: tuple[int, int] = (64, 48),
    pixels: str = "yuv420p",
    times: Sequence[int] | None = None,
    pixel_aspect: Fraction | None = None,
    **options: str,
) -> None:
    """A video of painted frames, 25 per second or at these milliseconds, by one of FFmpeg's encoders; an MP4's index
    stands before them."""
    with av.open(path, "w", options={"movflags": "+faststart"}) as container:
        stream = container.add_stream(codec, rate=25, options=options)
        assert isinstance(stream, VideoStream)
        stream.width, stream.height, stream.pix_fmt = *size, pixels
        if times:
            stream.codec_context.time_base = Fraction(1, 1000)
        if pixel_aspect:
            stream.codec_context.sample_aspect_ratio = pixel_aspect
        for index in range(count):
            frame = av.VideoFrame.from_ndarray(painted(index, size), format="rgb24")
            if times:
                frame.pts, frame.time_base = times[index], Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


@pytest.fixture
def write_images(tmp_path: Path) -> Callable[..., Path]:
    """write_images(names, sizes={}): a folder of painted images, by default 64 x 48."""

    def write(names: list[str], sizes: dict[str, tuple[int, int]] | None = None) -> Path:
        folder = tmp_path / "images"
        folder.mkdir()
        for index, name in enumerate(names):
            cv2.imwrite(str(folder / name), painted(index, (sizes or {}).get(name, (64, 48)))[..., ::-1])
        return folder

    return write


@pytest.mark.parametrize("name, codec", [("walk.avi", "MJPG"), ("walk.mp4", "mp4v"), ("walk.mkv", "mp4v")])
def test_video_in_sequence_and_at_random(write_video, name, codec):
    with FrameSource(write_video(30, name, codec)) as frames:
        assert (frames.count, frames.declared_count, frames.size, frames.frame_rate) == (30, 30, (64, 48), 25.0)
        assert len(frames) == 30 and frames.stems is None
        assert [shown(frame) for frame in frames] == list(range(30))
        order = [29, 0, 17, 18, 18, 3, 25, 24, 10, 29, 1]
        assert [shown(frames.frame(index)) for index in order] == order


@pytest.mark.parametrize(
    "name, codec", [("walk.avi", "MPG2"), ("walk.mpg", "PIM1"), ("walk.m2v", "MPG2"), ("walk.ts", "MPG2")]
)
def test_frames_that_are_stored_in_another_order(write_video, name, codec):
    """MPEG with B-frames: AVI has no times of presentation, program streams have wrong ones, .m2v is no container."""
    with FrameSource(write_video(30, name, codec)) as frames:
        assert frames.count == frames.declared_count == 30 and not frames.uneven
        order = np.random.default_rng(0).permutation(30).tolist()
        assert [shown(frames.frame(index)) for index in order] == order
        assert [shown(frame) for frame in frames] == list(range(30))


TIMES = 512 * np.arange(30)
"""Of the packets of 30 frames in MP4, as OpenCV writes it."""
WRONG_TIMES = {
    "none": TIMES[:0],
    "half of them": TIMES[::2],
    "shifted": TIMES + 256,
    "one moved": TIMES + 7 * (np.arange(30) == 15),
    "drifting": TIMES + np.arange(30),
    "too far apart": 2 * TIMES,
}


@pytest.mark.parametrize("times", WRONG_TIMES.values(), ids=WRONG_TIMES)
def test_times_that_are_not_the_frames(write_video, monkeypatch, times):
    """Then it is decoded from the start: slow, but the frame that was asked for."""
    file = write_video(30, "walk.mp4", "mp4v")
    assert np.array_equal(video_file.packet_times(file, early=False), TIMES)
    monkeypatch.setattr(video_file, "packet_times", lambda path, early: times)
    with FrameSource(file) as frames:
        order = np.random.default_rng(0).permutation(30).tolist()
        assert [shown(frames.frame(index)) for index in order] == order


def test_the_rate_of_uneven_frames_is_that_of_their_times(tmp_path):
    """10 frames at 25 per second and 20 at 5, though the header says 25."""
    file = tmp_path / "phone.mkv"
    encode(file, 30, "libx264", bf="0", crf="5", times=[40 * min(k, 10) + 200 * max(k - 10, 0) for k in range(30)])
    with FrameSource(file) as frames:
        assert (frames.uneven, frames.declared_frame_rate) == (True, 25.0)
        assert frames.frame_rate == pytest.approx(29 / 4.2, rel=1e-6)
        assert frames.times is not None and frames.times[[0, 9, 11, 29]] == pytest.approx([0, 0.36, 0.6, 4.2])
        assert frames.count == frames.declared_count == 30, "the header's length times its rate makes 110"
        order = np.random.default_rng(0).permutation(30).tolist()
        assert [shown(frames.frame(index)) for index in order] == order


@pytest.mark.parametrize("name", ["walk.avi", "walk.mkv", "walk.mp4", "walk.mov", "walk.webm"])
def test_a_file_that_ends_early(write_video, name):
    file = write_video(30, name, {"walk.webm": "VP80"}.get(name, "mp4v"))
    content = file.read_bytes()
    assert not ends_early(file)
    for part in (0.5, 0.9):
        file.write_bytes(content[: int(len(content) * part)])
        assert ends_early(file)


def with_frame_durations(mp4: bytes, durations: list[tuple[int, float]]) -> bytes:
    """The video with other times: (number of frames, duration relative to now), ... in place of its one duration.

    The table of durations grows, and with it every box around it; they stand after the frames, whose places stay.
    """
    boxes, start = [], 0
    for kind in (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stts"):
        while mp4[start + 4 : start + 8] != kind:
            start += struct.unpack_from(">I", mp4, start)[0]
        boxes.append(start)
        start += 8
    (size,), (step,) = struct.unpack_from(">I", mp4, boxes[-1]), struct.unpack_from(">I", mp4, boxes[-1] + 20)
    rows = b"".join(struct.pack(">II", count, round(relative * step)) for count, relative in durations)
    table = struct.pack(">I4sII", 16 + len(rows), b"stts", 0, len(durations)) + rows
    result = bytearray(mp4[: boxes[-1]] + table + mp4[boxes[-1] + size :])
    for box in boxes[:-1]:
        struct.pack_into(">I", result, box, struct.unpack_from(">I", mp4, box)[0] + len(table) - size)
    return bytes(result)


def test_unevenly_spaced_frames_at_random(write_video):
    """OpenCV alone gives frame 29 for 28 here, and none for 29."""
    file = write_video(30, "phone.mp4", "mp4v")
    with FrameSource(file) as frames:
        assert not frames.uneven
    file.write_bytes(with_frame_durations(file.read_bytes(), [(10, 1), (10, 0.25), (10, 1.75)]))
    with FrameSource(file) as frames:
        assert frames.uneven and frames.count == 30
        assert [shown(frame) for frame in frames] == list(range(30))
        for index in range(30):
            for before in (0, 29):
                frames.frame(before)
                assert shown(frames.frame(index)) == index


INTERLACED: dict[str, dict] = {
    "dv.avi": {"codec": "dvvideo", "size": (720, 576)},
    "h264.mp4": {"codec": "libx264", "x264-params": "interlaced=1:crf=10"},
    "mpeg2.ts": {"codec": "mpeg2video", "flags": "+ilme+ildct"},
}


@pytest.mark.parametrize("name", INTERLACED)
def test_interlaced_frames_are_pictures(tmp_path, name):
    """Both fields of a frame in one image, as cameras for tape film. DV's pixels are not square."""
    encode(tmp_path / name, 20, **INTERLACED[name])
    with FrameSource(tmp_path / name) as frames:
        assert [shown(frame) for frame in frames] == list(range(20))
        assert [shown(frames.frame(index)) for index in (13, 2, 19)] == [13, 2, 19]
        assert red_corner(frames.frame(0)) == ("upper", "left")
        assert frames.pixel_aspect == pytest.approx(16 / 15 if name == "dv.avi" else 1)


@pytest.fixture
def same_priority() -> Iterator[None]:
    """Restores the scheduling. SVT-AV1 gives root's encoding thread the highest real-time priority, and browsers
    started from it later stall the computer."""
    before = os.sched_getscheduler(0) if hasattr(os, "sched_getscheduler") else None
    yield
    if before is not None:
        os.sched_setscheduler(0, before, os.sched_param(0))


@pytest.mark.parametrize("codec", ["libsvtav1", "libx265", "libvpx-vp9"])
@pytest.mark.usefixtures("same_priority")
def test_codecs_of_today(tmp_path, codec):
    encode(tmp_path / "a.mp4", 15, codec, size=(128, 96))
    with FrameSource(tmp_path / "a.mp4") as frames:
        assert [shown(frames.frame(index)) for index in (14, *range(15))] == [14, *range(15)]


@pytest.mark.parametrize("part", [0.55, 0.75, 0.95])
def test_a_file_that_ends_among_frames_that_wait_for_others(tmp_path, part):
    """B-frames are stored after a frame that is shown later: what is counted can be decoded, without a gap."""
    file = tmp_path / "walk.mp4"
    encode(file, 30, "libx264", bf="3", g="60")
    content = file.read_bytes()
    start = content.index(b"mdat")
    file.write_bytes(content[: start + int((len(content) - start) * part)])
    with FrameSource(file) as frames:
        assert frames.declared_count == 30 and 2 < frames.count < 30
        assert [shown(frames.frame(index)) for index in range(frames.count)] == list(range(frames.count))
        order = np.random.default_rng(0).permutation(frames.count).tolist()
        assert [shown(frames.frame(index)) for index in order] == order


def test_frames_are_missing_in_the_middle(write_video):
    """Those that can be decoded keep their numbers, and what shows the clip goes on."""
    file = write_video(30)
    content = bytearray(file.read_bytes())
    starts = [match.start() for match in re.finditer(rb"\xff\xd8", content)]
    assert len(starts) == 30
    for start, end in pairwise(starts[12:15]):
        content[start : end - 20] = bytes(end - 20 - start)
    file.write_bytes(content)
    with FrameSource(file) as frames:
        assert frames.count == 30
        for index in [*range(30), 12, 29, 14, 13, 0]:
            if index in (12, 13):
                with pytest.raises(InputError, match=rf"Frame {index} of .* cannot be decoded"):
                    frames.frame(index)
                grey = frames.frame_or_grey(index)
                assert grey.shape == (48, 64, 3) and np.ptp(grey) == 0
            else:
                assert shown(frames.frame(index)) == index
                assert np.array_equal(frames.frame_or_grey(index), frames.frame(index))


def test_a_folder_of_images_is_in_natural_order(write_images):
    folder = write_images(["f1.png", "f2.jpg", "f10.PNG", "F11.jpeg"])
    (folder / "notes.txt").touch()
    (folder / ".f3.png").touch()
    with FrameSource(folder) as frames:
        assert frames.stems == ("f1", "f2", "f10", "F11")
        assert (frames.count, frames.size, frames.frame_rate) == (4, (64, 48), None)
        assert [shown(frame) for frame in frames] == [0, 1, 2, 3]
        assert shown(frames.frame(2)) == 2


def test_one_thread_reads_at_a_time(write_video):
    order = np.random.default_rng(0).integers(0, 30, 60).tolist()
    with FrameSource(write_video(30)) as frames, ThreadPoolExecutor(4) as threads:
        assert [shown(frame) for frame in threads.map(frames.frame, order)] == order


def test_a_photo_stands_upright(tmp_path):
    """EXIF orientation 6: the camera was held turned by a quarter, so the first row is the right side."""
    file = tmp_path / "photo.jpg"
    ok, encoded = cv2.imencode(".jpg", painted(4)[..., ::-1])
    assert ok
    tag = struct.pack("<HHII", 0x0112, 3, 1, 6)
    exif = b"Exif\0\0" + struct.pack("<2sHIH", b"II", 42, 8, 1) + tag + bytes(4)
    content = encoded.tobytes()
    file.write_bytes(content[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + content[2:])
    with FrameSource(file) as frames:
        assert frames.size == (48, 64)
        assert red_corner(frames.frame(0)) == ("upper", "right")


def test_a_video_stands_upright(write_video):
    """The rotation that phones write: a matrix in the track header, here a quarter turn clockwise."""
    file = write_video(5, "phone.mp4", "mp4v")
    _turned(file)
    with FrameSource(file) as frames:
        assert frames.size == (48, 64)
        assert red_corner(frames.frame(0)) == ("upper", "right")
        assert frames.frame(4).shape == (64, 48, 3)


def _turned(file: Path) -> None:
    content = bytearray(file.read_bytes())
    matrix = content.index(b"tkhd") + 4 + 40
    assert content[matrix : matrix + 4] == b"\0\1\0\0"
    content[matrix : matrix + 20] = struct.pack(">5i", 0, 0x10000, 0, -0x10000, 0)
    file.write_bytes(content)


def test_pixels_that_are_not_square_are_told(tmp_path, write_video):
    with FrameSource(write_video(3, "square.mp4", "mp4v")) as frames:
        assert frames.pixel_aspect == 1
    wide = tmp_path / "wide.mp4"
    encode(wide, 3, "mpeg4", pixel_aspect=Fraction(16, 11))
    with FrameSource(wide) as frames:
        assert frames.pixel_aspect == pytest.approx(16 / 11) and frames.size == (64, 48), "as they are stored"
    _turned(wide)
    with FrameSource(wide) as frames:
        assert frames.pixel_aspect == pytest.approx(11 / 16) and frames.size == (48, 64)


@pytest.mark.parametrize("name, content, message", [
    ("text.mp4", b"this is no video\n" * 50, r"text.mp4 is not a video that can be opened \(found 850 bytes\)"),
    ("empty.mp4", b"", r"empty.mp4 is not a video that can be opened \(found 0 bytes\)"),
    ("broken.png", b"\x89PNG\r\n", "broken.png is not an image that can be decoded; remove or replace it"),
    ("empty.jpg", b"", "empty.jpg is not an image that can be decoded"),
])  # fmt: skip
def test_files_that_hold_no_frames(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=message):
        FrameSource(tmp_path / name)


def test_a_video_without_its_index(write_video):
    """An MP4 keeps its index at the end; a copy that stopped early lacks it."""
    file = write_video(30, "walk.mp4", "mp4v")
    file.write_bytes(file.read_bytes()[:1500])
    with pytest.raises(InputError, match=r"walk.mp4 is not a video .*\(found 1500 bytes\).*not fully copied"):
        FrameSource(file)


def test_a_truncated_video_says_both_numbers(write_video):
    file = write_video(30)
    content = file.read_bytes()
    file.write_bytes(content[: len(content) * 3 // 4])
    with FrameSource(file) as frames:
        assert frames.declared_count == 30 and 5 < frames.count < 25
        assert [shown(frame) for frame in frames][:-1] == list(range(frames.count - 1))
        message = (
            f"Frame {frames.count} .* says it has 30 frames, but only {frames.count} can be decoded. It is truncated"
        )
        with pytest.raises(InputError, match=message):
            frames.frame(frames.count)


@pytest.mark.parametrize("index", [-1, 5, 100])
def test_a_frame_that_is_not_there(write_video, index):
    with FrameSource(write_video(5)) as frames, pytest.raises(InputError, match=f"no frame {index} .*frames 0 to 4"):
        frames.frame(index)


def test_images_of_different_sizes_are_scaled_to_the_first(write_images):
    folder = write_images(["a1.png", "a2.png", "a3.png"], {"a2.png": (32, 24), "a3.png": (32, 48)})
    with FrameSource(folder) as frames:
        assert [frame.shape for frame in frames] == [(48, 64, 3)] * 3
        assert shown(frames.frame(1)) == 1 and red_corner(frames.frame(1)) == ("upper", "left")
        narrow = frames.frame(2)
        assert np.ptp(narrow[:, :16]) == 0 and np.ptp(narrow[:, 48:]) == 0, "grey beside a picture of another shape"
        assert round(float(narrow[-8:, 36:44].mean()) / STEP) == 2
        [note] = frames.notes()
    assert "changes: some are 32 x 24, 32 x 48. They are scaled to 64 x 48" in note


@pytest.mark.parametrize(("suffix", "codec"), [("ts", "libx264"), ("m2v", "mpeg2video")])
def test_a_video_whose_picture_size_changes_is_scaled_to_the_first(tmp_path, suffix, codec):
    """As browsers record calls. The file is recordings of two sizes behind each other."""
    video = tmp_path / f"call.{suffix}"
    for size in ((64, 48), (128, 96)):
        encode(tmp_path / f"part.{suffix}", 20, codec, size=size, g="5")
        with video.open("ab") as whole:
            whole.write((tmp_path / f"part.{suffix}").read_bytes())
    with FrameSource(video) as frames:
        assert frames.size == (64, 48) and frames.count > 25
        pictures = [frames.frame_or_grey(index) for index in range(frames.count)]
        read = [picture for picture in pictures if np.ptp(picture) > 100]
        assert len(read) >= frames.count - 1, "FFmpeg may lose the last frame before the change"
        assert all(red_corner(picture) == ("upper", "left") for picture in read)
        [note] = frames.notes()
    assert f"The picture size of {video.name} changes: some are 128 x 96" in note


def test_a_title_that_is_not_utf8(write_video):
    file = write_video(5, "walk.mkv", "mp4v")
    content = file.read_bytes()
    assert content.count(b"Lavf") >= 2, "of the program that wrote it"
    file.write_bytes(content.replace(b"Lavf", b"La\xff\xfe"))
    with FrameSource(file) as frames:
        assert frames.count == 5 and told_35mm(file) is None


@pytest.mark.parametrize(
    "file, count, size, rate",
    [
        ("signs/gebaerden/video.mp4", 149, (640, 480), 25.0),
        pytest.param("balancing/cam03/video.mp4", 100, (1088, 1920), 60.0, marks=pytest.mark.thorough),
        # cut without encoding again
        pytest.param(
            "opencap/walk_ts/video.mp4", 89, (720, 1280), pytest.approx(59.346, abs=1e-3), marks=pytest.mark.thorough
        ),
    ],
)
def test_real_videos_at_random_as_in_sequence(shared_data, file, count, size, rate):
    with FrameSource(shared_data / file) as frames:
        assert (frames.count, frames.size, frames.frame_rate) == (count, size, rate)
        wanted = [count - 1, 0, count // 2, 7]
        at_random = {index: frames.frame(index) for index in wanted}
        for index, frame in enumerate(frames):
            if index in at_random:
                assert (frame == at_random[index]).all()
