"""`tcfit detect`: keypoints of a video as OpenPose JSON."""

import sys
from contextlib import closing
from pathlib import Path

from fitting_core.detect.detecting import Detected, Detection, DetectionProgress
from fitting_core.detect.detectors import Running, find_detector
from fitting_core.detect.found import found_by
from fitting_core.errors import InputError, printable
from fitting_core.io.keypoints.openpose import SUFFIX, write_all_people
from fitting_core.video.frame_names import split_number
from fitting_core.video.frames import FrameSource
from tcfit_app.cli.json_lines import emit_wrote
from tcfit_app.cli.progress import DetectionShown
from tcfit_app.options.detect import DetectOptions


def run_detect(options: DetectOptions) -> None:
    """Detect, and write the keypoints.

    Raises:
        InputError: Files or options cannot be used; nothing has been written then.
        KeyboardInterrupt: Cancelled; what was found is kept for the next time.
    """
    if options.video is None:
        raise InputError("No video given; expected `tcfit detect VIDEO`.")
    name = options.video.resolve().stem
    folder = options.out or Path(f"{name}_keypoints")
    with FrameSource(options.video) as source:
        for note in source.notes():
            print(printable(f"Note: {note}"), file=sys.stderr)
        frames = _frames(source, options.first_frame, options.last_frame)
        _check_folder(folder, name, frames)
        running = Running(boxes=options.boxes, provider=options.provider, threads=options.threads)
        detector = find_detector(options.detector, running)
        found = _found(Detection(source=source, frames=frames, detector=detector))
    write_all_people(folder, found.people, name=name, first_frame=frames[0], detector=found.points)
    emit_wrote(folder, kind="keypoints")
    seen = sum(len(people) > 0 for people in found.people)
    where = f"people in {seen} of {len(frames)} frames, by {found_by(found)}"
    print(printable(f"Wrote {len(frames)} files into {folder}: {where}."))


def _found(detection: Detection) -> Detected:
    with DetectionShown() as shown, closing(detection.events(detection.store())) as events:
        for event in events:
            if isinstance(event, DetectionProgress):
                shown(event)
            elif isinstance(event, Detected):
                return event
    raise AssertionError("a detection ends with what it found")


def _frames(source: FrameSource, first: int | None, last: int | None) -> range:
    """The frames from one to another, both included. Raises InputError if no frame is in between."""
    start, stop = first or 0, source.count if last is None else last + 1
    if not 0 <= start < stop <= source.count:
        raise InputError(
            f"--first-frame and --last-frame: frames {start}–{stop - 1} are not all in {source.path}, which has frames "
            f"0–{source.count - 1}."
        )
    return range(start, stop)


def _check_folder(folder: Path, name: str, frames: range) -> None:
    """Raises InputError if keypoints cannot be written there without mixing them with others."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out {folder}: is a file; expected a folder, which may not exist yet.")
    for file in sorted(folder.glob(f"*{SUFFIX}")):
        prefix, number = split_number(file.name.removesuffix(SUFFIX))
        if prefix != f"{name}_" or number not in frames:
            raise InputError(
                f"--out {folder}: contains keypoints of other frames or another video, such as {file.name}. Choose "
                "another folder."
            )
