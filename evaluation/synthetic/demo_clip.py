"""Makes the demo clip that comes with tcfit, from the free body alone: a video, keypoints and the truth.

No OpenGL takes part, so that it is the same wherever it is made.
"""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from tqdm import tqdm

from evaluation.options import DemoOptions
from evaluation.synthetic.acting.performance import perform, standing_root
from evaluation.synthetic.motions import demo_script
from evaluation.synthetic.simulated_detector import detect, visible
from evaluation.synthetic.studio.clothing import Outfit
from evaluation.synthetic.studio.studio import CAMERA, STOOL_MIDDLE, VIEW, Studio
from evaluation.synthetic.studio.view import View
from evaluation.synthetic.truth import truth_of, write_truth
from fitting_core.body.files.reading import load_body
from fitting_core.body.files.registry import find_body
from fitting_core.body.geometry import vertex_normals
from fitting_core.body.mesh import shared_mesh
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import keypoints_in_space
from fitting_core.camera import Camera
from fitting_core.clips.demo import DemoClip, clip_in
from fitting_core.io.keypoints.openpose import write_openpose
from fitting_core.io.truth import Truth
from fitting_core.shipped import DEMO_FOLDER, FREE_FOLDER
from fitting_core.video.encoding import video_writer
from fitting_core.world_camera import in_camera

FRAME_RATE = 25.0
_SEAT_RADIUS = 0.17
_SINK = 0.015
"""How deep the person sinks into the seat, metres: flesh is soft."""


def run(options: DemoOptions, command: str) -> None:
    """Make the clip, and say where it is."""
    made = make_demo(options.out or DEMO_FOLDER)
    print(f"Wrote {made.video.name}, {made.keypoints.name} and {made.truth.name} into {made.video.parent}")


def make_demo(
    folder: Path,
    *,
    seed: int = 0,
    frame_rate: float = FRAME_RATE,
    camera: Camera = CAMERA,
    view: View = VIEW,
    body: BodyModel | None = None,
) -> DemoClip:
    """Make the demo clip.

    Args:
        folder: Made if it is missing; a clip that lies there is replaced.
        seed: The same seed gives the same keypoints and truth.
        frame_rate: Frames per second; a lower one makes fewer frames of the same motion.
        camera: Its size must be even; the view stays that of CAMERA if its focal length is scaled with its size.
        view: Where the camera stands.
        body: The free neutral body when None.

    Raises:
        InputError: No video encoder works.
    """
    body = body or load_body(find_body(search=FREE_FOLDER))
    folder.mkdir(parents=True, exist_ok=True)
    truth, world = _performed(body, seed, frame_rate, camera, view)
    truth = replace(truth, visible=_film(folder / "video.mp4", body, truth, world, view))
    write_truth(folder / "truth.npz", truth)
    keypoints = detect(
        truth.keypoints,
        truth.visible,
        truth.exists,
        frame_rate=frame_rate,
        height=camera.size[1],
        failures=demo_script.FAILURES,
        rng=np.random.default_rng([seed, 1]),
    )
    frames = write_openpose(folder / "frames", keypoints, name="demo")
    made = clip_in(folder)
    made.keypoints.write_text(json.dumps([json.loads(frame.read_text()) for frame in frames]))
    shutil.rmtree(folder / "frames")
    return made


def _performed(body: BodyModel, seed: int, frame_rate: float, camera: Camera, view: View) -> tuple[Truth, BodyParams]:
    """The truth, as yet without what is visible, and the parameters in the world."""
    times = np.arange(round(demo_script.SECONDS * frame_rate)) / frame_rate
    world = perform(body, demo_script.SCRIPT, times, np.random.default_rng([seed, 0]), betas=demo_script.BETAS)
    rest, _ = standing_root(body, demo_script.BETAS)
    params = in_camera(world, rest[0], view.pose())
    return truth_of(body, params, camera, frame_rate), world


def _film(path: Path, body: BodyModel, truth: Truth, world: BodyParams, view: View) -> Bool[np.ndarray, "T 137"]:
    """Write the video; return which keypoints its frames show."""
    mesh, outfit = shared_mesh(body), Outfit.of(body)
    studio = Studio(truth.camera, seat_height=_seat_height(mesh(world[-1:])[0].numpy()), view=view)
    points, _ = keypoints_in_space(body, truth.params)
    seen = np.zeros(points.shape[:2], bool)
    with video_writer(path, truth.camera.size, truth.frame_rate) as video:
        for i in tqdm(range(len(world)), desc="demo clip", unit="frame", disable=None):
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
