"""A fitted motion for export: body, parameters, camera and time, in a stated world."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from fitting_core.body import rotations
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams, full_pose
from fitting_core.camera import Camera, CameraPath, World, matrix_of, vector_of
from fitting_core.errors import InputError
from fitting_core.ground.contacts import Contacts
from fitting_core.ground.level import Level
from fitting_core.results.error_bars import ErrorBars

Progress = Callable[[float], None]
"""Receives the finished fraction, 0 to 1; an exception from it ends the writing."""
CHUNK = 16
"""Frames whose meshes are in memory at once."""


@dataclass(frozen=True, kw_only=True)
class Axes:
    """A world, by the axes of a camera that is held level."""

    from_camera: tuple[tuple[int, int, int], ...]
    """Rotation of camera space (x right, y down, z away from the camera) into it, by rows."""
    text: str


AXES: dict[str, Axes] = {
    "camera": Axes(from_camera=((1, 0, 0), (0, 1, 0), (0, 0, 1)), text="x right, y down, z away from the camera"),
    "y-up": Axes(from_camera=((1, 0, 0), (0, -1, 0), (0, 0, -1)), text="x right, y up, z towards the camera"),
    "z-up": Axes(from_camera=((1, 0, 0), (0, 0, 1), (0, -1, 0)), text="x right, y away from the camera, z up"),
}
"""What is up is known from a motion's `level`; without one, upright means: as the camera was held."""
OWN_WORLD = "world"
"""The axes of the user's own world, for a camera of which it is known where it stands there."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """A body that moves over T frames."""

    body: BodyModel
    params: BodyParams
    """T frames; orientation and translation into the world of `axes`."""
    camera: Camera
    frame_rate: float
    """Frames per second."""
    name: str
    first_frame: int = 0
    """Number of the first frame in the video, from 0."""
    axes: str = "camera"
    """A name of AXES, or OWN_WORLD."""
    contacts: Contacts | None = None
    """Foot contacts per frame; None if not computed."""
    error_bars: ErrorBars | None = None
    """Error bars of joints and angles; None if not computed."""
    level: Level | None = None
    """How the camera is held: by it y-up and z-up are upright, and their floor is at 0. None: as if it were level."""

    def __len__(self) -> int:
        return len(self.params)

    def __getitem__(self, frames: slice) -> "Motion":
        """Consecutive frames."""
        start, _, _ = frames.indices(len(self))
        return replace(
            self,
            params=self.params[frames],
            camera=self.camera[frames],
            contacts=None if self.contacts is None else self.contacts[frames],
            error_bars=None if self.error_bars is None else self.error_bars[frames],
            first_frame=self.first_frame + start,
        )

    @cached_property
    def mesh(self) -> Mesh:
        """The body, ready to be posed in single precision."""
        return Mesh(self.body)

    @property
    def one_shape(self) -> "Motion":
        """With the mean of the betas in all frames: phase 1 finds others in each, and a rig has one.

        Its pelvis stays where it is: with the translation kept instead, that of the demo clip's phase 1 moved by up to
        1 mm, in each world to another place.
        """
        if self.has_one_shape:
            return self
        mean = self.params.betas.mean(0, keepdim=True).expand(len(self), -1)
        shaped = replace(self, params=replace(self.params, betas=mean))
        kept = (self.rest_joints[:, 0] - shaped.rest_joints[:, 0]).to(mean)
        return replace(shaped, params=replace(shaped.params, camera_translation=self.params.camera_translation + kept))

    @property
    def shaped_body(self) -> BodyModel:
        """The body whose mean shape is that of `one_shape`."""
        return self.body.with_shape(self.one_shape.params.betas[0].double().numpy())

    @property
    def has_one_shape(self) -> bool:
        """Whether the betas are the same in all frames."""
        return bool((self.params.betas == self.params.betas[:1]).all())

    def in_axes(self, axes: str) -> "Motion":
        """The same motion in another world.

        The root turns about the pelvis, which lies off the body's origin: so the translation changes by more than the
        turn, t' = R (p + t) - p with p the pelvis at rest.

        Raises:
            InputError: The name is unknown, or the camera's pose in the world is not given.
        """
        if axes not in (*AXES, OWN_WORLD):
            raise InputError(f"Axes {axes!r} are not known; expected one of {', '.join(AXES)}, {OWN_WORLD}.")
        if axes == OWN_WORLD and self.camera.world is None:
            raise InputError(
                f"The axes {OWN_WORLD!r} are those of a camera file that says where the camera stands, and this clip "
                "was read without one. Give it by --camera when the clip is fitted or its project made, or choose "
                "other axes."
            )
        if axes == self.axes:
            return self
        there = replace(self, axes=axes)
        turn = torch.as_tensor(there.camera_to_world @ self.camera_to_world.swapaxes(-1, -2))
        pelvis = self.rest_joints[:, 0].double()
        turned_root = turn @ rotations.exp(self.params.global_orient.double())
        orient = rotations.log(turned_root)
        from_camera = pelvis + self.params.camera_translation.double() - torch.as_tensor(self.camera_place)
        translation = (turn @ from_camera[..., None])[..., 0] + torch.as_tensor(there.camera_place) - pelvis
        like = self.params.global_orient
        turned = replace(self.params, global_orient=orient.to(like), camera_translation=translation.to(like))
        return replace(there, params=turned)

    @property
    def camera_to_world(self) -> Float[np.ndarray, "*T 3 3"]:
        """Rotation: x_world = camera_to_world @ x_camera + camera_place; of each frame where the camera moves."""
        path, turn = self._path, self._still_to_world
        return turn if path is None else turn @ path.to_still

    @property
    def camera_place(self) -> Float[np.ndarray, "*T 3"]:
        """Position of the camera in the world, metres; one per frame if it moves.

        In an estimated world it begins above the origin, as high as it is above the floor.
        """
        path, place = self._path, self._still_place
        return place if path is None else path.places @ self._still_to_world.T + place

    @property
    def seen_from(self) -> World | None:
        """Where the camera stands in the world of these axes; None where it moves there."""
        if self._path is not None:
            return None
        rotation = self.camera_to_world.T
        return World(rotation=matrix_of(rotation), translation=vector_of(-rotation @ self.camera_place))

    @property
    def _path(self) -> CameraPath | None:
        """In the axes "camera" those of each frame's camera count, which stands in them at the origin."""
        return None if self.axes == "camera" else self.camera.path

    @property
    def _still_to_world(self) -> Float[np.ndarray, "3 3"]:
        """Rotation of still space (see `CameraPath`) into the world."""
        if self._own_world is not None:
            return self._own_world.from_camera
        axes = np.array(AXES[self.axes].from_camera, float)
        return axes if self.level is None or self.axes == "camera" else axes @ self.level.turn

    @property
    def _still_place(self) -> Float[np.ndarray, "3"]:
        """Where the camera stands in the world, or begins, metres."""
        if self._own_world is not None:
            return self._own_world.place
        if self.level is None or self.axes == "camera":
            return np.zeros(3)
        place = (0.0, -(self.level.height or 0.0), 0.0) if self.level.place is None else self.level.place
        return np.array(AXES[self.axes].from_camera, float) @ place

    @property
    def _own_world(self) -> World | None:
        """Of the camera, where these are its axes."""
        return self.camera.world if self.axes == OWN_WORLD else None

    @property
    def axes_text(self) -> str:
        """The world in words."""
        stands = "stands" if self.camera.path is None else "moves; it begins"
        turned = self.axes != "camera" and self.level is not None and self.level.place is not None
        if turned or self._own_world is not None:
            up = self._own_world.up if self._own_world is not None else self.axes[0]
            at = ", ".join(f"{place:.3f}" for place in self._still_place)
            said = f", {up} up" if up else ""
            return f"the world of the camera's calibration{said}; metres; the camera {stands} at ({at})"
        if self.axes == "camera" and self.camera.path is not None:
            return f"{AXES[self.axes].text}; metres; the camera moves; in each frame it is at the origin"
        if self.axes == "camera" or self.level is None:
            return f"{AXES[self.axes].text}; metres; the camera {stands} at the origin"
        if self.level.height is None:
            return f"{AXES[self.axes].text}; upright by gravity; metres; the camera {stands} at the origin"
        above = f"the camera {stands} {self.level.height:.3f} above the origin"
        return f"{AXES[self.axes].text}; upright by gravity; metres; the floor is at height 0, {above}"

    @cached_property
    def rest_joints(self) -> Float[torch.Tensor, "T 55 3"]:
        """See `rest_joints`."""
        return rest_joints(self.body, self.params)

    @property
    def pelvis(self) -> Float[np.ndarray, "T 3"]:
        """Where the root joint is, metres: the translation alone is not, because the pelvis is off the origin."""
        return (self.rest_joints[:, 0] + self.params.camera_translation.double()).numpy()

    @property
    def pose(self) -> Float[torch.Tensor, "T 55 3"]:
        """Axis-angle of all joints, hands with their mean, double precision; of the root, in the world."""
        return full_pose(self.body, self.params.to(dtype=torch.float64))

    def joints(self) -> Float[np.ndarray, "T 55 3"]:
        """The joints in the world, metres."""
        return self.mesh.joints(self.params).numpy()

    def vertices(self) -> Iterator[Float[np.ndarray, "V 3"]]:
        """All vertices in the world (metres), frame by frame."""
        for start in range(0, len(self), CHUNK):
            yield from self.mesh(self.params[start : start + CHUNK]).numpy()


def rest_joints(body: BodyModel, params: BodyParams) -> Float[torch.Tensor, "T 55 3"]:
    """The joints of the rest pose with each frame's shape and expression, metres, double precision."""
    params = params.to(dtype=torch.float64)
    coefficients, (rest, moves) = torch.cat([params.betas, params.expression], 1), _rest_tables(body)
    return rest + torch.einsum("jac,tc->tja", moves, coefficients)


@lru_cache(maxsize=4)
def _rest_tables(body: BodyModel) -> tuple[Float[torch.Tensor, "55 3"], Float[torch.Tensor, "55 3 20"]]:
    """Joints of the mean shape at rest, and what betas and expression add. Kept, for it takes 40 ms."""
    directions = np.concatenate([body.shape_directions, body.expression_directions], 2)
    moves = np.einsum("jv,vac->jac", body.joint_regressor, directions)
    return torch.as_tensor(body.rest_joints, dtype=torch.float64), torch.as_tensor(moves, dtype=torch.float64)


def stated(motion: Motion) -> dict[str, Any]:
    """Metadata of a motion for files, as plain values."""
    camera, body, level = motion.camera, motion.body, motion.level
    return {
        "name": motion.name,
        "frames": len(motion),
        "first_frame": motion.first_frame,
        "frame_rate": motion.frame_rate,
        "axes": motion.axes,
        "axes_text": motion.axes_text,
        "gender": body.gender,
        "body_kind": body.kind,
        "body_hash": body.hash,
        "betas_source": "the fit's" if motion.has_one_shape else "mean of the frames' own",
        "intrinsics": {
            "focal_px": list(camera.focal),
            "center_px": list(camera.center),
            "image_size_px": list(camera.size),
            "focal_source": camera.source,
            "distortion": None if camera.lens is None else list(camera.lens.distortion),
        },
        "camera_to_world": motion.camera_to_world.tolist(),
        "camera_place": motion.camera_place.tolist(),
        "ground": "not known: upright means as the camera was held" if level is None else level.text,
        "generator": "tcfit",
    }


def stated_by_frame(motion: Motion) -> dict[str, Any]:
    """What a file of meshes or of a skeleton alone does not have: shape, and translation and pelvis by frame.

    The translation is the one that belongs to these betas.
    """
    params = motion.one_shape.params
    return stated(motion) | {
        "betas": params.betas[0].tolist() if len(motion) else [],
        "translation": params.camera_translation.tolist(),
        "pelvis": motion.pelvis.tolist(),
    }
