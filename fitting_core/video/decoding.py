"""A video file: what its container says, and the frame that is asked for, whatever is read before it."""

import shlex
import struct
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import cv2
import numpy as np
from jaxtyping import Float

from fitting_core.errors import InputError
from fitting_core.files.regular import regular_file

_VP8 = cv2.VideoWriter.fourcc(*"VP80")
_VP8_SHOWN = 0x10  # In the first byte of a packet (RFC 6386, section 9.1).
_AV1 = "av01"
_MP4_BOXES = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip", b"styp")


def packet_times(path: Path) -> Float[np.ndarray, "P"]:
    """When each packet is shown, in milliseconds and sorted: 30,000 packets take a tenth of a second.

    VP8's packets that are never shown, only referred to (10 beside 180 frames), are left out. Not always when frames
    are: see `_times_of_frames`. Empty if OpenCV's backend cannot read a file without decoding it.
    """
    packets = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, -1])
    some_hidden = int(packets.get(cv2.CAP_PROP_FOURCC)) == _VP8
    times = []
    while packets.grab():
        if not some_hidden or int(packets.retrieve()[1].flat[0]) & _VP8_SHOWN:
            times.append(packets.get(cv2.CAP_PROP_POS_MSEC))
    packets.release()
    return np.sort(np.array(times, dtype=float))  # Packets come in the order of decoding.


def ends_early(path: Path) -> bool:
    """Whether an AVI, MP4, MOV, MKV or WebM file has fewer bytes than its own parts say.

    Other containers, and streams written without lengths, cannot be told: False. The number of frames in the header is
    no sign: whole files of variable rate, cut without encoding again, or in FLV, have fewer.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(12)
        file.seek(0)
        if head[:4] == b"RIFF":
            return _end_of_parts(file, size, _riff) > size
        if head[4:8] in _MP4_BOXES:
            return _end_of_parts(file, size, _box) > size
        return head[:4] == b"\x1a\x45\xdf\xa3" and _end_of_parts(file, size, _element) > size


def _end_of_parts(file: BinaryIO, size: int, length_of: Callable[[BinaryIO], int | None]) -> int:
    """Where the last part on the top level ends, in bytes; 0 if one does not say its length."""
    end = 0
    while end < size:
        file.seek(end)
        length = length_of(file)
        if not length:
            return 0
        end += length
    return end


def _riff(file: BinaryIO) -> int | None:
    """Bytes of the chunk that starts here: padded to an even number."""
    head = file.read(8)
    length = int.from_bytes(head[4:], "little")
    return 8 + length + length % 2 if len(head) == 8 and 0 < length < 0xFFFFFFFF else None


def _box(file: BinaryIO) -> int | None:
    """Bytes of the MP4 box that starts here; a length of 1 stands for a longer number, 0 for the rest: not told."""
    head = file.read(16)
    if len(head) < 8:
        return None
    (length,) = struct.unpack_from(">I", head)
    length = int.from_bytes(head[8:], "big") if length == 1 else length
    return length if length >= 8 else None  # its own head


def _element(file: BinaryIO) -> int | None:
    """Bytes of the EBML element that starts here; a length of all ones is not known, as in live recordings."""
    head = file.read(12)
    id_bytes = 9 - head[0].bit_length()
    length_bytes = 9 - head[id_bytes].bit_length() if id_bytes <= 4 < len(head) - id_bytes else 9
    if length_bytes > 8:
        return None
    length = int.from_bytes(head[id_bytes : id_bytes + length_bytes], "big") & ((1 << 7 * length_bytes) - 1)
    return None if length == (1 << 7 * length_bytes) - 1 else id_bytes + length_bytes + length


# Decoding on costs one frame each, a seek up to a whole group of pictures (often 12 to 250 frames).
_SKIP = 12
# The first tells how far ahead the packets are; of more, opening a 1088 x 1920 video of 100 frames (0.6 s) feels each.
_PROBED = 3
# The times of packets and of decoded frames come from the same numbers: they are equal or not each other's.
_SAME_TIME_MS = 0.001


class VideoFile:
    """A video file, decoded on from the last frame or after a seek.

    OpenCV takes frames for evenly spaced when it seeks, which phones' are not: it then lands next to the frame that was
    asked for and says nothing. So the frame's time tells where it is, and the time of what was decoded after the seek
    tells which frame that is. Times are compared at the start and with every frame that is decoded; once they
    contradict the order of the frames there are no more seeks: going back starts again from the first frame.
    """

    stems = None

    def __init__(self, path: Path) -> None:
        """Open the file and count its frames.

        Raises:
            InputError: It is no video, or none of its frames can be decoded.
        """
        self._path = path
        if not _is_text(path):  # OpenCV crashes on such a name, and takes the process with it.
            raise InputError(
                f"{str(path)!r}: has a name that is not UTF-8. Rename the video or the folder that it is in."
            )
        self._capture = cv2.VideoCapture(str(regular_file(path, most=None)))
        if not self._capture.isOpened():
            raise InputError(
                f"{path} is not a video that OpenCV can open (found {path.stat().st_size} bytes). If it plays "
                "elsewhere, re-encode it as H.264 in MP4; if not, it is damaged or was not fully copied."
            )
        self._last = -1
        self.pixel_aspect = _pixel_aspect(self._capture)
        rate = self._capture.get(cv2.CAP_PROP_FPS)
        self.declared_frame_rate: float | None = float(rate) if np.isfinite(rate) and rate > 0 else None
        # What the header says is an estimate in many containers: length times rate (MKV), more than is shown (MP4).
        header_count = max(0, int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT)))
        self._times = _times_of_frames(packet_times(path), self._first_times())
        self.count = self._counted()
        if self.count == 0 and _codec(self._capture) == _AV1:
            raise InputError(
                f"{path} is AV1, which the OpenCV on this computer cannot decode. Convert it, for example: ffmpeg -i "
                f"{shlex.quote(path.name)} -c:v libx264 -crf 16 {shlex.quote(path.stem)}-h264.mp4"
            )
        if self.count == 0:
            raise InputError(
                f"{path} has no frame that can be decoded (the file says it has {header_count}); re-encode it."
            )
        self.declared_count = max(self.count, header_count) if ends_early(path) else self.count
        times = self._times[: self.count]
        self.uneven = _uneven(times)
        self.frame_rate = (
            1000 * (len(times) - 1) / float(times[-1] - times[0]) if self.uneven else self.declared_frame_rate
        )

    def read(self, index: int) -> np.ndarray | None:
        """Frame as BGR; None if it cannot be decoded."""
        if index < self._last or (index - self._last > _SKIP and len(self._times)):
            self._seek(index)
        image = self._decode(index)
        if image is None:
            # Seeking can fail where decoding from the start does not: back in an AVI of one frame, for example.
            self._reopen()
            image = self._decode(index)
        return image

    def label(self, index: int) -> str:
        """The frame in words."""
        return f"Frame {index}"

    def close(self) -> None:
        """Release the file."""
        self._capture.release()

    def _first_times(self) -> list[float]:
        """Milliseconds that the decoder says of the first frames."""
        times = []
        while len(times) < _PROBED and self._capture.grab():
            times.append(self._capture.get(cv2.CAP_PROP_POS_MSEC))
        self._last = len(times) - 1
        return times

    def _counted(self) -> int:
        """Frames that decode: from near the end on if its place can be told, else all are counted."""
        if len(self._times):
            self._seek(len(self._times) - 1)
        while self._advance():
            pass
        count = self._last + 1
        self._last = count  # Past the end: whatever is read next is behind.
        return count

    def _decode(self, index: int) -> np.ndarray | None:
        while self._last < index:
            if not self._advance():
                return None
        ok, image = self._capture.retrieve()
        return image if ok else None

    def _advance(self) -> bool:
        """One frame on; back to the start, for good without times, if its time is another frame's."""
        if not self._capture.grab():
            return False
        self._last += 1
        if self._last < len(self._times) and not self._at(self._last):
            self._times = self._times[:0]
            self._reopen()
        return True

    def _at(self, index: int) -> bool:
        return abs(self._times[index] - self._capture.get(cv2.CAP_PROP_POS_MSEC)) < _SAME_TIME_MS

    def _seek(self, index: int) -> None:
        """Go to a frame or to one shortly before it; back to the start if its place cannot be told."""
        place = min(index, len(self._times) - 1)
        if place >= 0 and self.declared_frame_rate:
            even = round((self._times[place] - self._times[0]) / 1000 * self.declared_frame_rate)
            for margin in (0, _SKIP, 4 * _SKIP):
                self._capture.set(cv2.CAP_PROP_POS_FRAMES, max(0, even - margin))
                if self._capture.grab():
                    self._last = int(np.abs(self._times - self._capture.get(cv2.CAP_PROP_POS_MSEC)).argmin())
                    if self._last <= index and self._at(self._last):
                        return
        self._reopen()

    def _reopen(self) -> None:
        self._capture.release()
        self._capture = cv2.VideoCapture(str(self._path))
        self._last = -1


def _codec(capture: cv2.VideoCapture) -> str:
    """Four letters."""
    number = int(capture.get(cv2.CAP_PROP_FOURCC))
    return (number & 0xFFFFFFFF).to_bytes(4, "little").decode("latin-1").lower()


def _pixel_aspect(capture: cv2.VideoCapture) -> float:
    """Width by height of a pixel of the upright image, which OpenCV turns by quarters and does not stretch."""
    width, height = capture.get(cv2.CAP_PROP_SAR_NUM), capture.get(cv2.CAP_PROP_SAR_DEN)
    if not (np.isfinite((width, height)).all() and width > 0 and height > 0):
        return 1.0  # not told
    lies = round(capture.get(cv2.CAP_PROP_ORIENTATION_META) / 90) % 2 == 1
    return height / width if lies else width / height


def _times_of_frames(packets: Float[np.ndarray, "P"], first: list[float]) -> Float[np.ndarray, "T"]:
    """The decoder's times of the frames, in milliseconds; none if the packets' do not tell them.

    Where a container has no times of presentation (AVI), the decoder says of a frame the time of the packet that it
    took last, which is some packets ahead: all but the last few frames then have the times of the packets from there.

    Args:
        packets: Of all packets, sorted.
        first: What the decoder says of the first frames.
    """
    if not len(packets) or not first or (np.diff(packets) < 2 * _SAME_TIME_MS).any():
        return packets[:0]
    times = packets[np.abs(packets - first[0]).argmin() :]
    said = np.array(first)[: len(times)]
    return times if (np.abs(times[: len(said)] - said) < _SAME_TIME_MS).all() else packets[:0]


def _uneven(times: Float[np.ndarray, "T"]) -> bool:
    steps = np.diff(times)
    return len(steps) > 0 and bool((np.abs(steps - np.median(steps)) > 0.5 * np.median(steps)).any())


def _is_text(path: Path) -> bool:
    try:
        str(path).encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True
