"""Read another view of a clip's person, and relate it to the clip."""

from dataclasses import replace

from fitting_core.clip import Clip, OtherView
from fitting_core.clips.footage import uneven_note
from fitting_core.clips.options import CameraOptions, ClipOptions
from fitting_core.clips.reading import read_clip
from fitting_core.detect.found import Tell
from fitting_core.detect.part import Detector
from fitting_core.errors import InputError
from fitting_core.files.regular import StrPath
from fitting_core.fit.views.relating import related
from fitting_core.video.fingerprint import fingerprint
from fitting_core.video.frames import FrameSource


def read_view(
    first: Clip,
    video: StrPath | None,
    keypoints: StrPath | None = None,
    *,
    clip: ClipOptions = ClipOptions(),
    camera: CameraOptions = CameraOptions(),
    detector: Detector | None = None,
    tell: Tell | None = None,
) -> OtherView:
    """Read a clip of the same person at the same time by another camera. Its frames may be unevenly spaced in time.

    Args and errors as in `read_clip`, and:

    Args:
        first: The clip to which it is related, with its other views.

    Raises:
        InputError: It is the video of one of these, it does not show the same person at the same time, or that cannot
            be determined.
    """
    other = read_clip(video, keypoints, clip=clip, camera=camera, detector=detector, tell=tell)
    for known in (first, *(view.clip for view in first.views)):
        sources = [one.source for one in (known, other) if one.source is not None and one.source.exists()]
        if len(sources) == 2 and fingerprint(sources[0]) == fingerprint(sources[1]):
            raise InputError(f"This is the video of {known.name}; expected one of another camera.")
    times = None
    if other.source is not None:
        with FrameSource(other.source) as frames:
            if frames.times is not None:
                times = frames.times[other.first_frame : other.first_frame + len(other)]
                evenly = uneven_note(frames)
                other = replace(other, notes=tuple(note for note in other.notes if note != evenly))
    return related(replace(first, views=()), [OtherView(clip=other, times=times)]).views[0]
