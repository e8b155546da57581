"""`tcfit detect`: keypoints of a video by ONNX models, and the download of such models."""

import sys
from collections.abc import Iterable
from pathlib import Path

from tqdm import tqdm

from fitting_core.detect import BoxModel, load_box_model, load_pose_model
from fitting_core.detect.detecting import Detected, Detection, DetectionProgress
from fitting_core.detect.download import Downloaded, DownloadProgress, announced, download
from fitting_core.detect.known_models import KNOWN_MODELS, KnownModel, find_model, model_path
from fitting_core.detect.stored import StoredDetection
from fitting_core.errors import InputError
from fitting_core.io.keypoints.openpose import SUFFIX, write_openpose
from fitting_core.keypoint_noise import COCO_WHOLEBODY
from fitting_core.video.frame_names import split_number
from fitting_core.video.frames import FrameSource
from tcfit_app.cli.json_lines import Note, Progress, Step, emit, emit_wrote
from tcfit_app.options.detect import DetectOptions

_UNFINISHED = ".detection"
"""In the output folder: what is stored of a detection until it is complete."""
_STEPS = {"people": "People", "keypoints": "Keypoints"}


def run_detect(options: DetectOptions) -> None:
    """Do what the options ask for.

    Raises:
        InputError: Files or options cannot be used; nothing has been written then.
        KeyboardInterrupt: Cancelled; the frames that had been finished have been written.
    """
    if options.list:
        print(model_table())
    for name in options.download:
        fetch(name, agreed=options.yes)
    if options.video is not None or not (options.list or options.download):
        detect(options)


def detect(options: DetectOptions) -> None:
    """Detect, and write the keypoints. Raises as `run_detect`."""
    if options.video is None:
        raise InputError("No video is given; expected `tcfit detect VIDEO --model POSE.onnx`.")
    if options.model is None:
        raise InputError(
            "No --model is given; expected the path of a whole-body ONNX model, or the name of one that has been "
            "downloaded: `tcfit detect --list` shows them."
        )
    pose = load_pose_model(find_model(options.model), provider=options.provider, threads=options.threads)
    boxes = _box_model(options)
    name = options.video.resolve().stem
    folder = options.out or Path(f"{name}_keypoints")
    with FrameSource(options.video) as source:
        frames = frames_of(source, options.first_frame, options.last_frame)
        check_folder(folder, name, frames)
        detection = Detection(
            source=source, frames=frames, pose=pose, boxes=boxes, person=options.person, batch=options.batch
        )
        store = StoredDetection(folder / _UNFINISHED)
        if options.restart:
            store.discard()
        _detect(detection, store, folder, name)


def _detect(detection: Detection, store: StoredDetection, folder: Path, name: str) -> None:
    frames = detection.frames
    known = store.begin(detection.settings())
    if known:
        done = len(detection.so_far(store).keypoints)
        _tell([f"Going on after {done} of {len(frames)} frames, which an earlier run has left in {folder}."])
    try:
        found = shown(detection, store)
    except BaseException:
        part = detection.so_far(store)
        if len(part.keypoints):
            _write(folder, part, name, frames)
        _tell([f"Stopped: {len(part.keypoints)} of {len(frames)} frames are in {folder}. The same command goes on."])
        raise
    _write(folder, found, name, frames)
    store.discard()
    emit_wrote(folder, kind="keypoints")
    if found.note:
        emit(Note(text=found.note))
        _tell([f"Note: {found.note}"])
    detected = (found.keypoints.confidence > 0).any(1).sum()
    print(f"Wrote {len(frames)} files into {folder}: somebody in {detected} of {len(frames)} frames.")


def _write(folder: Path, found: Detected, name: str, frames: range) -> None:
    write_openpose(folder, found.keypoints, name=name, first_frame=frames[0], detector=COCO_WHOLEBODY)


def shown(detection: Detection, store: StoredDetection) -> Detected:
    """Detect with a progress bar for each step, or on no terminal with a line."""
    bar: tqdm | None = None
    step, end = "", None
    try:
        for event in detection.events(store):
            if isinstance(event, Detected):
                end = event
                continue
            if event.step != step:
                emit(Step(step=event.step, title=_STEPS[event.step]))
                step, bar = event.step, _next_bar(bar, event)
            if bar is not None:
                bar.update(event.done - bar.n)
            emit(Progress(step=event.step, share=event.share, text=f"{event.done} of {event.total} frames"))
    finally:
        if bar is not None:
            bar.close()
    assert end is not None
    return end


def _next_bar(bar: tqdm | None, event: DetectionProgress) -> tqdm | None:
    if bar is not None:
        bar.close()
    if not sys.stderr.isatty():
        _tell([f"{_STEPS[event.step]} in {event.total} frames ..."])
        return None
    return tqdm(desc=f"{_STEPS[event.step]:9}", total=event.total, unit="frames", dynamic_ncols=True)


def _box_model(options: DetectOptions) -> BoxModel | None:
    if options.boxes is None:
        return None
    return load_box_model(find_model(options.boxes), provider=options.provider, threads=options.threads)


def frames_of(source: FrameSource, first: int | None, last: int | None) -> range:
    """The frames from one to another, both of which belong to them. Raises InputError where there are none."""
    start, stop = first or 0, source.count if last is None else last + 1
    if not 0 <= start < stop <= source.count:
        raise InputError(
            f"Frames {start} to {stop - 1} were asked for, but {source.path} has 0 to {source.count - 1}; expected "
            "--first-frame and --last-frame within these."
        )
    return range(start, stop)


def check_folder(folder: Path, name: str, frames: range) -> None:
    """Raises InputError if keypoints cannot be written there without mixing them with others."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out {folder}: is a file; expected a folder, which may not exist yet.")
    others = sorted(file.name for file in folder.glob(f"*{SUFFIX}") if not _is_own(file.name, name, frames))
    if others:
        raise InputError(
            f"--out {folder}: holds keypoints of other frames or another video, such as {others[0]}. Choose another "
            "folder."
        )


def _is_own(file: str, name: str, frames: range) -> bool:
    prefix, number = split_number(file.removesuffix(SUFFIX))
    return prefix == f"{name}_" and number in frames


def model_table() -> str:
    """The models that can be downloaded, and which are here."""
    lines = []
    for model in KNOWN_MODELS.values():
        where = model_path(model.name)
        state = f"here: {where}" if where.is_file() else f"to be fetched by --download {model.name} ({model.size})"
        use = {"points": "--model", "boxes": "--boxes"}[model.finds]
        lines.append(f"{model.name:12} {use}  {model.title}\n{'':12} {state}\n{'':12} licence: {model.licence}")
    return "\n".join(lines)


def fetch(name: str, *, agreed: bool) -> None:
    """Download a known model, after the user has seen what it is and agreed.

    Raises:
        InputError: There is no such model, nobody agreed, or it cannot be fetched.
    """
    model = KNOWN_MODELS.get(name)
    if model is None:
        raise InputError(f"--download {name}: no such model is known; expected one of {', '.join(KNOWN_MODELS)}.")
    print(announced(model), flush=True)
    if not agreed and not _agrees():
        raise InputError("Nothing was downloaded.")
    got = _fetched(model)
    checksum = "as expected" if got.checked else "not known before; remembered for the next download"
    print(f"{model.name} is in {got.path}\n  SHA-256   {got.sha256} ({checksum})")


def _agrees() -> bool:
    if not sys.stdin.isatty():
        raise InputError("Nothing was downloaded: give --yes to agree where nobody can be asked.")
    return input("Download it? [y/N] ").strip().lower() in ("y", "yes")


def _fetched(model: KnownModel) -> Downloaded:
    with tqdm(unit="B", unit_scale=True, dynamic_ncols=True, disable=not sys.stderr.isatty()) as bar:
        for event in download(model):
            if isinstance(event, Downloaded):
                return event
            assert isinstance(event, DownloadProgress)
            bar.total = event.total
            bar.update(event.done - bar.n)
    raise AssertionError("a download ends with what it got")


def _tell(lines: Iterable[str]) -> None:
    for line in lines:
        print(line, file=sys.stderr, flush=True)
