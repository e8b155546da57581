"""A long video in parts of some minutes, each a clip with a folder of its own."""

import itertools
import math
from dataclasses import replace

import numpy as np

from fitting_core.clips.footage import Footage, locate
from fitting_core.errors import InputError
from fitting_core.frame_alignment import chosen
from tcfit_app.options.fit import FitOptions


def parts_of(fit: FitOptions, minutes: float) -> tuple[FitOptions, ...]:
    """Parts of a clip of equal length, named by their start time in the video.

    Args:
        fit: The whole clip; it is returned unchanged if it is not longer than a part.
        minutes: Maximum length of a part.

    Raises:
        InputError: There is no video, it cannot be read, or it has other frames.
    """
    images, _ = locate(fit.video, fit.keypoints)
    footage = Footage.of(images)
    if footage.timeline is None:
        raise InputError("needs a video; give it in the column video.")
    rate, _ = footage.known_rate(fit.clip.frame_rate, None)
    numbers = footage.timeline.numbers[chosen(footage.timeline, fit.clip.first_frame, fit.clip.last_frame)]
    count = math.ceil(len(numbers) / (60 * minutes * rate))
    if count < 2:
        return (fit,)
    borders = np.linspace(0, len(numbers), count + 1).round().astype(int).tolist()
    return tuple(
        replace(
            fit,
            out=fit.out / _time(numbers[begin] / rate),
            clip=replace(fit.clip, first_frame=numbers[begin], last_frame=numbers[end - 1]),
        )
        for begin, end in itertools.pairwise(borders)
    )


def _time(seconds: float) -> str:
    minutes, second = divmod(int(seconds), 60)
    hour, minute = divmod(minutes, 60)
    return f"{hour:02}-{minute:02}-{second:02}"
