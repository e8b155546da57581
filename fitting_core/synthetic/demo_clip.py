"""The demo clip: a video, keypoints as a detector would give them, and the truth, made from the free body alone.

It is generated on the user's computer, so nothing large is shipped, and the same everywhere: no OpenGL takes part.
"""

import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import platformdirs
from jaxtyping import Bool, Float
from tqdm import tqdm

from fitting_core.body.files.reading import load_body
from fitting_core.body.files.registry import find_body
from fitting_core.body.geometry import vertex_normals
from fitting_core.body.mesh import shared_mesh
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.camera import Camera
from fitting_core.errors import InputError
from fitting_core.files.atomic import drafting, put_folder
from fitting_core.io.keypoints.openpose import write_openpose
from fitting_core.shipped import FREE_FOLDER
from fitting_core.synthetic.acting.performance import perform, standing_root
from fitting_core.synthetic.motions import demo_script
from fitting_core.synthetic.simulated_detector import detect, visible
from fitting_core.synthetic.studio.clothing import Outfit
from fitting_core.synthetic.studio.studio import CAMERA, STOOL_MIDDLE, VIEW, Studio
from fitting_core.synthetic.studio.world_camera import in_camera
from fitting_core.synthetic.truth import Truth, fingerprint, truth_of, write_truth
from fitting_core.video.encoding import video_writer

NAME = "demo"
FRAME_RATE = 25.0
_VIDEO, _KEYPOINTS, _TRUTH = "video.mp4", "keypoints", "truth.npz"
_SEAT_RADIUS = 0.17
_SINK = 0.015
"""How deep the person sinks into the seat, metres: flesh is soft."""


@dataclass(frozen=True, kw_only=True)
class DemoClip:
    """Where the demo clip's parts lie."""

    folder: Path
    video: Path
    keypoints: Path
    """Folder of OpenPose JSON, one file per frame."""
    truth: Path
    """Read it with `fitting_core.synthetic.truth.read_truth`."""
    camera: Camera


def cached_demo(*, progress: bool = True, making: Callable[[], None] = lambda: None) -> DemoClip:
    """The demo clip in the user's cache, made when it is asked for the first time (about 20 s).

    Args:
        progress: Show a progress bar.
        making: Called before it is made.
    """
    body_hash = hashlib.sha256(find_body(search=FREE_FOLDER).read_bytes()).hexdigest()
    folder = platformdirs.user_cache_path("tcfit", appauthor=False) / f"demo-{fingerprint(body_hash)}"
    if not (folder / _TRUTH).is_file():
        making()
        folder.parent.mkdir(parents=True, exist_ok=True)
        return make_demo(folder, progress=progress)
    return _clip_in(folder, CAMERA)


def make_demo(
    folder: Path,
    *,
    progress: bool = True,
    seed: int = 0,
    frame_rate: float = FRAME_RATE,
    camera: Camera = CAMERA,
    body: BodyModel | None = None,
) -> DemoClip:
    """Generate the demo clip into a new folder, which appears only when it is whole.

    Args:
        folder: It must not exist, or be empty; its parent must exist.
        progress: Show a progress bar.
        seed: The same seed gives the same keypoints and truth.
        frame_rate: Frames per second; a lower one makes fewer frames of the same motion.
        camera: Its size must be even; the view stays that of CAMERA if its focal length is scaled with its size.
        body: The free neutral body when None.

    Raises:
        InputError: The folder is in use, its parent is missing, or no video encoder works.
    """
    body = body or load_body(find_body(search=FREE_FOLDER))
    with _appearing(folder) as draft:
        truth, world = _performed(body, seed, frame_rate, camera)
        truth = replace(truth, visible=_film(draft / _VIDEO, body, truth, world, progress=progress))
        keypoints = detect(
            truth.keypoints,
            truth.visible,
            truth.exists,
            frame_rate=frame_rate,
            height=camera.size[1],
            failures=demo_script.FAILURES,
            rng=np.random.default_rng([seed, 1]),
        )
        write_openpose(draft / _KEYPOINTS, keypoints, name=NAME)
        write_truth(draft / _TRUTH, truth)
    return _clip_in(folder, camera)


def _clip_in(folder: Path, camera: Camera) -> DemoClip:
    return DemoClip(
        folder=folder, video=folder / _VIDEO, keypoints=folder / _KEYPOINTS, truth=folder / _TRUTH, camera=camera
    )


@contextmanager
def _appearing(folder: Path) -> Iterator[Path]:
    """A draft folder that takes the name `folder` when the block ends well, and vanishes when it does not."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder} exists already: delete it, or choose another folder for the demo clip.")
    if not folder.parent.is_dir():
        raise InputError(f"The folder {folder.parent} for the demo clip does not exist: create it first.")
    with drafting(folder) as draft:
        draft.mkdir()
        yield draft
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
        if not folder.exists():  # else another process was faster, and its clip is the same
            put_folder(draft, folder)


def _performed(body: BodyModel, seed: int, frame_rate: float, camera: Camera) -> tuple[Truth, BodyParams]:
    """The truth, as yet without what is visible, and the parameters in the world."""
    times = np.arange(round(demo_script.SECONDS * frame_rate)) / frame_rate
    world = perform(body, demo_script.SCRIPT, times, np.random.default_rng([seed, 0]), betas=demo_script.BETAS)
    rest, _ = standing_root(body, demo_script.BETAS)
    params = in_camera(world, rest[0], VIEW.pose())
    return truth_of(body, params, camera, frame_rate), world


def _film(path: Path, body: BodyModel, truth: Truth, world: BodyParams, *, progress: bool) -> Bool[np.ndarray, "T 137"]:
    """Write the video; return which keypoints its frames show."""
    mesh, outfit = shared_mesh(body), Outfit.of(body)
    studio = Studio(truth.camera, seat_height=_seat_height(mesh(world[-1:])[0].numpy()))
    points, _ = keypoints_in_space(body, truth.params)
    seen = np.zeros(points.shape[:2], bool)
    with video_writer(path, truth.camera.size, truth.frame_rate) as video:
        for i in tqdm(range(len(world)), desc="demo clip", unit="frame", disable=not progress):
            vertices = mesh(world[i : i + 1])[0].numpy().astype(np.float64)
            normals = vertex_normals(vertices, body.faces)
            image, depth = studio.draw(vertices, body.faces, normals, outfit)
            seen[i] = truth.exists & visible(points[i], depth, truth.camera)
            video.write(image)
    return seen


def _seat_height(seated: Float[np.ndarray, "V 3"]) -> float:
    """Height of the stool's seat: where the seated person ends below, and a little of it taken up by soft flesh."""
    over = np.hypot(seated[:, 0] - STOOL_MIDDLE[0], seated[:, 2] - STOOL_MIDDLE[1]) < _SEAT_RADIUS
    return float(seated[over, 1].min()) + _SINK
