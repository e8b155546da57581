"""Random access to a video's frames, and its container's metadata."""

import itertools
import struct
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import av
import cv2
import numpy as np
from av.container import InputContainer
from av.error import FFmpegError
from av.video.frame import VideoFrame
from av.video.reformatter import Interpolation, VideoReformatter
from av.video.stream import VideoStream
from jaxtyping import Float, Int

from fitting_core.errors import InputError
from fitting_core.files.regular import regular_file

_VP8_SHOWN = 0x10  # In the first byte of a packet (RFC 6386, section 9.1).
_MP4_BOXES = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip", b"styp")


def packet_times(path: Path, *, early: bool) -> Int[np.ndarray, "P"]:
    """When each packet is shown, in units of the stream and sorted: 30,000 packets take 0.3 s.

    Packets that are never shown are left out: VP8's that are only referred to (10 beside 180 frames), and those that an
    edit list of MP4 cuts away. Empty where two are shown at once or a time is missing, as in raw streams.

    Args:
        path: Of the video.
        early: Whether the file ends before its packets do. Those after the first that is missing are left out then:
            packets come in the order of decoding.
    """
    container, stream = opened(path)
    with container:
        some_hidden = stream.codec_context.name == "vp8"
        times, decoded = [], 0
        for packet in _packets(container, stream):
            if not packet.size:
                continue
            decoded = decoded if packet.dts is None else packet.dts
            hidden = packet.is_discard or (some_hidden and not bytes(packet)[0] & _VP8_SHOWN)
            if not hidden and not (early and packet.is_corrupt):
                times.append(packet.pts)
    if None in times or len(set(times)) < len(times):
        return np.zeros(0, dtype=np.int64)
    shown = np.sort(np.array(times, dtype=np.int64))
    return _before_gap(shown, decoded) if early and len(shown) > 1 else shown


def _before_gap(times: Int[np.ndarray, "P"], decoded: int) -> Int[np.ndarray, "P"]:
    """Those before the first gap. A packet that is missing is decoded, and so shown, after the last that is there."""
    steps = np.diff(times)
    gaps = np.flatnonzero((times[1:] > decoded) & (steps > 1.5 * np.median(steps)))
    return times[: gaps[0] + 1] if len(gaps) else times


_ONLY = {
    "format_whitelist": "mov,matroska,avi,mpegts,mpeg,mpegvideo,flv,asf,dv,mxf,ogg,ivf,nut,rm,gif,apng,yuv4mpegpipe",
    "protocol_whitelist": "file",
}
"""FFmpeg takes nearly any bytes for something, raw pictures among them; and lists, of which some name other files."""
# PyAV refused a file whose title is not UTF-8 until version 19, which dropped this argument.
_ANY_TITLE: dict[str, Any] = {"metadata_errors": "replace"} if int(av.__version__.split(".")[0]) < 19 else {}


def opened(path: Path) -> tuple[InputContainer, VideoStream]:
    """A file and its video. Raises InputError if it is not a video, or of a kind that cannot be decoded."""
    regular_file(path, most=None)
    try:
        # "file:", for FFmpeg takes what stands before a colon for a protocol.
        container = av.open(f"file:{path}", "r", container_options=_ONLY, **_ANY_TITLE)
    except FFmpegError as error:
        raise InputError(
            f"{path} is not a video that can be opened (found {path.stat().st_size} bytes). If it plays elsewhere, "
            "re-encode it as H.264 in MP4; if not, it is damaged or was not fully copied."
        ) from error
    stream = container.streams.best("video")
    if stream is None or stream.codec_context is None:
        container.close()
        raise InputError(f"{path} has no video in it that can be decoded. Re-encode it as H.264 in MP4.")
    assert isinstance(stream, VideoStream)
    stream.thread_type = "AUTO"
    return container, stream


_FOCAL_35MM = "com.apple.quicktime.camera.focal_length.35mm_equivalent"
"""Of the file or of its video (Apple, QuickTime metadata keys); other containers keep it in capitals."""


def told_35mm(path: Path) -> float | None:
    """The 35 mm equivalent in millimetres that a phone wrote into its video; None where it wrote none. Raises
    InputError as `opened` does."""
    container, stream = opened(path)
    with container:
        said = {name.lower(): value for name, value in (container.metadata | stream.metadata).items()}
    try:
        return float(said[_FOCAL_35MM])
    except (KeyError, ValueError):
        return None


def _packets(container: InputContainer, stream: VideoStream) -> Iterator[av.Packet]:
    """Those that can be read, and an empty one that ends them; a damaged file may end before its last."""
    try:
        yield from container.demux(stream)
    except FFmpegError:
        return


def ends_early(path: Path) -> bool:
    """Whether an AVI, MP4, MOV, MKV or WebM file has fewer bytes than its own parts say.

    Other containers, and streams written without lengths, are unknown: False. The number of frames in the header is
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
    """Bytes of the MP4 box that starts here; 1: a 64-bit size follows; 0: to the end of the file (returns None)."""
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
_EARLIER = (0.0, 1.0, 10.0)
"""Seconds before a frame at which it is looked for: some containers land behind the time that was asked for."""
_TURNS = {1: cv2.ROTATE_90_COUNTERCLOCKWISE, 2: cv2.ROTATE_180, 3: cv2.ROTATE_90_CLOCKWISE}


class VideoFile:
    """A video file, decoded on from the last frame or after a seek.

    The number of a frame is the place of its time among those of the packets, which are whole numbers: where one cannot
    be decoded, those after it keep theirs. Where there are no times, or a frame has one that no packet has, it is the
    place in the order of decoding, and going back starts again from the first frame.
    """

    stems = None

    def __init__(self, path: Path) -> None:
        """Open the file and count its frames. Raises InputError if it is not a video, or no frame can be decoded."""
        self._path = path
        self._early = ends_early(path)
        self._times = packet_times(path, early=self._early)
        self._broken: dict[int, tuple[int, int]] = {}
        """Frames that could not be decoded, and size and time of the file then."""
        self._sizes: set[tuple[int, int]] = set()
        # One for all frames: a new one for each takes 2 ms more at 1088 x 1920.
        self._reformatter = VideoReformatter()
        self._container, self._stream = opened(path)
        self._from_here()
        rate = self._stream.average_rate or self._stream.guessed_rate
        self.declared_frame_rate: float | None = float(rate) if rate else None
        # What the header says is an estimate in many containers: length times rate (MKV), more than is shown (MP4).
        seconds = (self._container.duration or 0) / av.time_base
        header_count = self._stream.frames or round(seconds * (self.declared_frame_rate or 0))
        while self._frame is None and self._advance():
            pass
        if len(self._times) and self._last > 0:
            self._times, self._last = self._times[self._last :], 0
        self._turn = 0 if self._frame is None else round(self._frame.rotation / 90) % 4
        self.pixel_aspect = _pixel_aspect(self._stream, lies=self._turn % 2 == 1)
        self.count = self._counted()
        if self.count == 0:
            raise InputError(
                f"{path} has no frame that can be decoded (the file says it has {header_count}); re-encode it."
            )
        self.declared_count = max(self.count, header_count) if self._early else self.count
        times = self._times[: self.count] * float(self._stream.time_base or 0)
        self.uneven = _uneven(times)
        self.times = times - times[0] if self.uneven else None
        self.frame_rate = (len(times) - 1) / float(times[-1] - times[0]) if self.uneven else self.declared_frame_rate

    def read(self, index: int) -> np.ndarray | None:
        """Frame as BGR; None if it cannot be decoded. Raises InputError or OSError if the file cannot be read now."""
        now = self._path.stat()
        stamp = now.st_size, now.st_mtime_ns
        if self._broken.get(index) == stamp:
            return None
        if index < self._last or index - self._last > _SKIP:
            self._seek(index)
        if not self._reach(index):
            # Seeking can fail where decoding from the start does not.
            self._reopen()
            if not self._reach(index):
                self._broken[index] = stamp
                return None
        return self._image()

    def sizes(self, indices: Sequence[int]) -> set[tuple[int, int]]:
        """Widths and heights in pixels of the key frames before some frames, and of all that were decoded so far."""
        for index in indices if len(self._times) else ():
            self._seek(index)
        return {(height, width) if self._turn % 2 else (width, height) for width, height in self._sizes}

    def notes(self, indices: Sequence[int]) -> list[str]:
        """See `Images.notes`."""
        return []

    def label(self, index: int) -> str:
        """The frame in words."""
        return f"Frame {index}"

    def close(self) -> None:
        """Release the file, and what its decoder holds: 40 MB at 1088 x 1920. Nothing can be read any more."""
        self._container.close()
        del self._container, self._stream, self._frames, self._frame

    def _counted(self) -> int:
        """Frames: up to the last that decodes, of a file that ends early to the first that does not.

        From near the end on if there are times, else all are decoded.
        """
        if len(self._times):
            self._seek(len(self._times) - 1)
        seen = {self._last}
        while self._advance():
            seen.add(self._last)
        count = self._last + 1
        if self._early and len(self._times):
            count = next(place for place in itertools.count(min(seen)) if place not in seen)
        self._last = count  # Past the end: any next read is behind.
        return count

    def _reach(self, index: int) -> bool:
        """Decode on to a frame; whether it is there."""
        while self._last < index and self._advance():
            pass
        return self._last == index

    def _advance(self) -> bool:
        """Decode one more frame; if no packet has its time, start over and count frames without times."""
        frame = next(self._frames, None)
        if frame is None:
            return False
        self._frame = frame
        self._sizes.add((frame.width, frame.height))
        if not len(self._times):
            self._last += 1
            return True
        place = -1 if frame.pts is None else int(np.searchsorted(self._times, frame.pts))
        if place == len(self._times):
            return False
        if place >= 0 and self._times[place] == frame.pts:
            self._last = place
        else:
            self._times = self._times[:0]
            self._reopen()
        return True

    def _seek(self, index: int) -> None:
        """Go to a frame or to one before it; back to the start if its position is unknown."""
        for seconds in _EARLIER if index < len(self._times) else ():
            earlier = round(seconds / float(self._stream.time_base or 1))
            try:
                self._container.seek(max(int(self._times[0]), int(self._times[index]) - earlier), stream=self._stream)
            except FFmpegError:
                break
            self._from_here()
            if self._advance() and self._last <= index:
                return
        self._reopen()

    def _reopen(self) -> None:
        container, stream = opened(self._path)
        self._container.close()
        self._container, self._stream = container, stream
        self._from_here()

    def _from_here(self) -> None:
        self._frames = _decoded(self._container, self._stream, early=self._early)
        self._frame: VideoFrame | None = None
        self._last = -1

    def _image(self) -> np.ndarray:
        """The last frame, upright; in OpenCV's colours to the bit, for 10 bits a channel as well."""
        assert self._frame is not None
        image = self._reformatter.reformat(
            self._frame, format="bgr24", interpolation=Interpolation.BICUBIC
        ).to_ndarray()
        return cv2.rotate(image, _TURNS[self._turn]) if self._turn else image


def _decoded(container: InputContainer, stream: VideoStream, *, early: bool) -> Iterator[VideoFrame]:
    """The container's next frames; damaged ones are skipped."""
    for packet in _packets(container, stream):
        try:
            # The torn last packet of a file makes FFmpeg's threads lose whole frames before it.
            yield from () if early and packet.is_corrupt else packet.decode()
        except FFmpegError:
            continue


def _pixel_aspect(stream: VideoStream, *, lies: bool) -> float:
    """Width by height of a pixel of the upright image, which is turned by quarters and not stretched."""
    ratio = stream.sample_aspect_ratio
    if not ratio:
        return 1.0
    return float(1 / ratio if lies else ratio)


def _uneven(times: Float[np.ndarray, "T"]) -> bool:
    """Whether frames are; not by the first step, which is twice as long in AVI with B-frames, which has no times."""
    steps = np.diff(times[1:])
    return len(steps) > 0 and bool((np.abs(steps - np.median(steps)) > 0.5 * np.median(steps)).any())
