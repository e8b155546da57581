"""Many short clips for `tcfit batch`: bodies in random poses, some of the clips broken, each in its own way."""

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.camera import Camera, project
from fitting_core.io.keypoints.openpose import write_openpose
from fitting_core.keypoints import BODY, COUNT, Keypoints

CAMERA = Camera(focal=(800.0, 800.0), center=(320.0, 240.0), size=(640, 480))
CHEAP = (
    "--no-overlay --preset paper --set pose_prior=relaxed --image-size 640 480 --focal-length 800 --set last_phase=1"
    " --set settings.iterations=2 --set weights.collision=0,0,0,0,0"
).split()
"""Options that fit such a clip in a fraction of a second."""


def write_clip(folder: Path, body: BodyModel, *, frames: int = 3, seed: int = 0) -> None:
    """OpenPose JSON of a person 4.5 m away, the 25 points of the body, in poses that drift."""
    draw = torch.Generator().manual_seed(seed)
    params = BodyParams.neutral(frames)
    params.global_orient[:, 0] = torch.pi
    params.camera_translation[:] = torch.tensor([0.0, -0.3, 4.5])
    steps = 0.02 * torch.randn(frames, 63, generator=draw).cumsum(0)
    params.body_pose[:] = 0.25 * torch.randn(1, 63, generator=draw) + steps
    points, exists = keypoints_in_space(body, params)
    seen = exists & (np.arange(COUNT) < BODY.stop)
    xy = np.zeros((frames, COUNT, 2))
    xy[:, seen] = project(CAMERA, torch.as_tensor(points[:, seen])).numpy()
    write_openpose(folder, Keypoints(xy=xy, confidence=np.tile(0.9 * seen, (frames, 1))), name=folder.name)


def _edited(change: Callable[[dict], object]) -> Callable[[Path], None]:
    """Changes the last frame's content."""

    def edit(folder: Path) -> None:
        file = _files(folder)[-1]
        content = json.loads(file.read_text())
        change(content)
        file.write_text(json.dumps(content))

    return edit


def _files(folder: Path) -> list[Path]:
    return sorted(folder.iterdir())


def _each(write: Callable[[Path], object]) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        for file in _files(folder):
            write(file)

    return change


def _without_people(file: Path) -> None:
    file.write_text(json.dumps({"version": 1.3, "people": []}))


def _unsure(file: Path) -> None:
    content = json.loads(file.read_text())
    points = content["people"][0]["pose_keypoints_2d"]
    points[2::3] = [0.01] * (len(points) // 3)
    file.write_text(json.dumps(content))


def _far_away(file: Path) -> None:
    content = json.loads(file.read_text())
    points = content["people"][0]["pose_keypoints_2d"]
    points[0::3] = [x + 5000 if x else 0 for x in points[0::3]]
    file.write_text(json.dumps(content))


BREAKAGES: dict[str, Callable[[Path], object]] = {
    "truncated": lambda folder: _files(folder)[0].write_text(_files(folder)[0].read_text()[:80]),
    "empty file": lambda folder: _files(folder)[1].write_text(""),
    "no files": _each(Path.unlink),
    "nobody": _each(_without_people),
    "unsure": _each(_unsure),
    "too few numbers": _edited(lambda content: content["people"][0]["pose_keypoints_2d"].pop()),
    "words": _edited(lambda content: content["people"][0].update(pose_keypoints_2d=["a", "b", "c"] * 25)),
    "not a number": _edited(lambda content: content["people"][0]["pose_keypoints_2d"].__setitem__(0, float("nan"))),
    "no OpenPose": _each(lambda file: file.write_text('{"landmarks": [1, 2, 3]}')),
    "outside the image": _each(_far_away),
}
"""Ten ways in which keypoints cannot be used."""


def broken_places(clips: int, broken: int) -> dict[int, str]:
    """Which of the clips are broken, spread over the list, and how."""
    places = np.linspace(1, clips - 2, broken).round().astype(int)
    return dict(zip(places.tolist(), BREAKAGES, strict=False))


def write_batch(folder: Path, body: BodyModel, *, clips: int, broken: int = 0, frames: int = 3) -> Path:
    """Makes this many clips and a list of them; returns the path of the list."""
    for index in range(clips):
        write_clip(folder / "keypoints" / f"c{index:03}", body, frames=frames, seed=index)
    for index, how in broken_places(clips, broken).items():
        BREAKAGES[how](folder / "keypoints" / f"c{index:03}")
    return write_list(folder, [{"keypoints": f"keypoints/c{i:03}", "out": f"fits/c{i:03}"} for i in range(clips)])


def write_list(folder: Path, rows: list[dict[str, str]]) -> Path:
    """A list of clips as CSV."""
    path = folder / "clips.csv"
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(dict.fromkeys(name for row in rows for name in row)))
        writer.writeheader()
        writer.writerows(rows)
    return path


def rows_of(folder: Path) -> dict[str, dict[str, str]]:
    """The rows of a batch's summary, by clip."""
    with (folder / "clips.batch" / "summary.csv").open(newline="", encoding="utf-8") as file:
        return {row["clip"]: row for row in csv.DictReader(file)}


def states_of(folder: Path) -> list[str]:
    """The state of each clip of a batch, in the order of its list."""
    return [row["state"] for row in rows_of(folder).values()]


def fitted(folder: Path) -> dict[str, float]:
    """The time of each result that is done, by the name of its folder."""
    marks = ((path.parent.name, json.loads(path.read_text())) for path in folder.glob("fits/*/summary.json"))
    return {name: (folder / "fits" / name / "fit.npz").stat().st_mtime_ns for name, mark in marks if "batch" in mark}
