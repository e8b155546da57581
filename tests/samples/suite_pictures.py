"""Pictures of the suite's sequences."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import UInt8

from evaluation.synthetic.studio.clothing import Outfit
from evaluation.synthetic.studio.studio import Studio
from evaluation.synthetic.studio.view import View
from evaluation.synthetic.suite import SuiteClip
from fitting_core.body.geometry import vertex_normals
from fitting_core.body.mesh import shared_mesh
from fitting_core.camera import Camera


def render_frames(
    made: SuiteClip, frames: list[int], *, view: View | None = None, camera: Camera | None = None
) -> Iterator[UInt8[np.ndarray, "H W 3"]]:
    """Pictures (RGB) of some frames, one after the other.

    Args:
        made: The sequence.
        frames: Their numbers.
        view: Where the camera stands instead of its own place.
        camera: Instead of its own; its size must be even.
    """
    body, own = made.body, made.view.pose()
    studio = Studio(camera or made.truth.camera, seat_height=None, view=view or made.view)
    mesh, outfit = shared_mesh(body), Outfit.of(body)
    for frame in frames:
        world = (mesh(made.truth.params[[frame]])[0].numpy().astype(np.float64) - own.translation) @ own.rotation
        yield studio.draw(world, body.faces, vertex_normals(world, body.faces), outfit)[0]
