"""Images: focal lengths in photographs, against files put together byte by byte; sizes, pages, bits a channel."""

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from fitting_core.errors import InputError
from fitting_core.video.frames import FrameSource
from fitting_core.video.images import focal_35mm


def tiff(order: str, entries: list[tuple[int, int, int]]) -> bytes:
    """A directory with a pointer to another one, which has these entries: tag, kind, value."""

    def entry(tag: int, kind: int, value: int) -> bytes:
        packed = struct.pack(order + ("H" if kind == 3 else "I"), value).ljust(4, b"\0")
        return struct.pack(order + "HHI", tag, kind, 1) + packed

    head = (b"II" if order == "<" else b"MM") + struct.pack(order + "HI", 42, 8)
    first = struct.pack(order + "H", 1) + entry(0x8769, 4, 8 + 2 + 12 + 4) + bytes(4)
    return head + first + struct.pack(order + "H", len(entries)) + b"".join(entry(*e) for e in entries) + bytes(4)


def jpeg(data: bytes, size: tuple[int, int] | None = None) -> bytes:
    """A small picture with a comment before its Exif data; its header may claim another size."""
    picture = cv2.imencode(".jpg", np.zeros((6, 8, 3), np.uint8))[1].tobytes()
    segments = [(0xFE, b"a comment"), (0xE1, b"Exif\0\0" + data)]
    if size:
        at = picture.index(b"\xff\xc0") + 5
        picture = picture[:at] + struct.pack(">HH", size[1], size[0]) + picture[at + 4 :]
    return picture[:2] + b"".join(struct.pack(">BBH", 0xFF, kind, len(s) + 2) + s for kind, s in segments) + picture[2:]


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(("kind", "value"), [(3, 26), (4, 135)])
def test_what_a_photograph_tells(tmp_path: Path, order: str, kind: int, value: int):
    path = tmp_path / "one.jpg"
    path.write_bytes(jpeg(tiff(order, [(0x9000, 3, 1), (0xA405, kind, value)])))
    assert focal_35mm(path) == value


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\xff\xd8",
        b"\x89PNG\r\n\x1a\n",
        jpeg(tiff("<", [(0xA405, 3, 0)])),  # unknown, says the standard
        jpeg(tiff("<", [(0x9000, 3, 26)])),
        jpeg(b""),
        jpeg(b"II"),
        jpeg(tiff("<", [(0xA405, 3, 26)])[:-8]),
        jpeg(b"XX" + tiff("<", [(0xA405, 3, 26)])[2:]),
    ],
)
def test_nothing_where_nothing_is_told(tmp_path: Path, content: bytes):
    path = tmp_path / "one.jpg"
    path.write_bytes(content)
    assert focal_35mm(path) is None


@pytest.mark.thorough
def test_a_photograph_of_a_200_megapixel_phone(tmp_path: Path):
    path = tmp_path / "one.jpg"
    path.write_bytes(jpeg(tiff("<", [(0xA405, 3, 26)]), size=(16320, 12240)) + bytes(7_000_000))
    assert focal_35mm(path) == 26
    with FrameSource(path) as frames:
        assert frames.size == (16320, 12240)


@pytest.mark.parametrize("size", [(60000, 60000), (16000, 16000)])
def test_a_small_file_that_claims_many_pixels_is_refused_before_they_take_memory(tmp_path: Path, size: tuple[int, int]):
    path = tmp_path / "one.jpg"
    path.write_bytes(jpeg(b"", size=size))
    with pytest.raises(InputError, match=rf"one.jpg has {size[0]} x {size[1]} pixels by its header and \d+ bytes"):
        FrameSource(path)


def test_an_image_that_is_gone_is_named(tmp_path: Path):
    for name in ("a.png", "b.png"):
        Image.new("RGB", (8, 6)).save(tmp_path / name)
    with FrameSource(tmp_path) as frames:
        (tmp_path / "b.png").unlink()
        with pytest.raises(InputError, match=r"Image b.png of .* cannot be read now \(No such file"):
            frames.frame(1)
        assert frames.frame_or_grey(1).shape == (6, 8, 3)


@pytest.mark.parametrize("name", ["a.webp", "a.png", "a.tif"])
def test_a_file_of_several_pictures_says_so(tmp_path: Path, name: str):
    pictures = [Image.new("RGB", (64, 48), (20 * level, 0, 0)) for level in range(4)]
    pictures[0].save(tmp_path / name, save_all=True, append_images=pictures[1:])
    for path, holds in ((tmp_path / name, f"{name} holds"), (tmp_path, f"A file in {tmp_path.name} holds")):
        with FrameSource(path) as frames:
            [note] = frames.notes()
        assert note.startswith(f"{holds} 4 pictures; only the first is used.")


def test_one_picture_and_the_preview_in_a_photograph_are_nothing_to_note(tmp_path: Path):
    Image.new("RGB", (64, 48)).save(tmp_path / "a.png")
    picture = Image.new("RGB", (64, 48))
    picture.save(tmp_path / "b.jpg", format="MPO", save_all=True, append_images=[picture])
    with FrameSource(tmp_path) as frames:
        assert frames.count == 2 and frames.notes() == []


@pytest.mark.parametrize(("depth", "name"), [(10, "png"), (12, "png"), (12, "tif"), (14, "tif"), (16, "png")])
def test_bits_of_a_camera_in_16_are_shown_bright(tmp_path: Path, depth: int, name: str):
    """The first image is dark: how many bits there are shows in the others."""
    levels = (0.1, 0.5, 0.9)
    for index, level in enumerate(levels):
        image = np.full((6, 8, 3), round(level * (2**depth - 1)), np.uint16)
        image[0, 0] = (level == 0.9) * (2**depth - 1)
        cv2.imwrite(str(tmp_path / f"{index}.{name}"), image)
    with FrameSource(tmp_path) as frames:
        assert [round(float(frame[1:].mean())) for frame in frames] == [pytest.approx(255 * x, abs=1) for x in levels]
        notes = frames.notes()
    assert notes == ([] if depth == 16 else [f"The images of {tmp_path.name} use {depth} of 16 bits a channel; these "
                                             f"{depth} are shown."])  # fmt: skip


@pytest.mark.parametrize("shape", [(6, 8), (6, 8, 3)])
def test_floating_point_pixels_are_refused(tmp_path: Path, shape: tuple[int, ...]):
    """They would come out black."""
    cv2.imwrite(str(tmp_path / "a.tif"), np.full(shape, 0.5, np.float32))
    with pytest.raises(InputError, match=r"a.tif is not an image that can be decoded"):
        FrameSource(tmp_path / "a.tif")
