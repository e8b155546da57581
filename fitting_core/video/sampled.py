"""A few small grey pictures of a clip, taken from its frames while they are decoded for the detector."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from fitting_core.camera import Camera
from fitting_core.lens import Straightener
from fitting_core.video.frames import FrameSource

_PICTURES = 15
"""Frames whose median is taken: people who move vanish from it."""
_LARGEST = 1280
"""Pixels of the longer side of a picture."""


class SampledPictures:
    """Frames spread over a clip, straightened, small and in grey.

    Args:
        video: A video file or a folder of images.
        frames: Numbers of the clip's frames in it.
        camera: Of the clip.
    """

    def __init__(self, video: Path, frames: Sequence[int], camera: Camera) -> None:
        self._video = video
        places = np.unique(np.linspace(0, len(frames) - 1, _PICTURES).round().astype(int))
        self._taken: dict[int, UInt8[np.ndarray, "h w"] | None] = dict.fromkeys(frames[place] for place in places)
        self.scale = min(1.0, _LARGEST / max(camera.size))
        """Of a picture's size to the frame's."""
        width, height = (round(self.scale * length) for length in camera.size)
        self._size = (width, height)
        self._straighten = None if camera.lens is None else Straightener(camera.lens, camera.size)

    def take(self, index: int, image: UInt8[np.ndarray, "H W 3"]) -> None:
        """Keep a decoded frame, RGB, if it is one of those wanted."""
        if index in self._taken:
            straight = image if self._straighten is None else self._straighten(image)
            grey = cv2.cvtColor(straight, cv2.COLOR_RGB2GRAY)
            self._taken[index] = cv2.resize(grey, self._size, interpolation=cv2.INTER_AREA)

    def stacked(self) -> UInt8[np.ndarray, "n h w"]:
        """All of them; frames that were not taken are decoded. Raises InputError if the video cannot be read."""
        if missing := [index for index, picture in self._taken.items() if picture is None]:
            with FrameSource(self._video) as source:
                for index in missing:
                    self.take(index, source.frame_or_grey(index))
        return np.stack([picture for picture in self._taken.values() if picture is not None])
