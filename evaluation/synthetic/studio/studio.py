"""The room of the demo clip: camera, floor and wall, a stool, light and shadow. Draws with the software rasterizer."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from evaluation.synthetic.studio.clothing import Outfit
from evaluation.synthetic.studio.rasterize import rasterize
from evaluation.synthetic.studio.view import View
from fitting_core.camera import Camera

CAMERA = Camera(focal=(1400.0, 1400.0), center=(270.0, 360.0), size=(540, 720), source="the demo's own camera")
VIEW = View(azimuth=24.0, height=1.25, distance=4.05, looking_at=(0.0, 0.87, -0.13))
STOOL_MIDDLE = (0.0, -0.405)
"""x and z of the stool."""
_SAMPLES = 2
"""Per pixel and axis: outlines are smooth because the picture is drawn larger and scaled down."""
_WALL_Z = -2.2
_WALL, _FLOOR, _WOOD = np.array([0.50, 0.53, 0.54]), np.array([0.40, 0.37, 0.34]), np.array([0.36, 0.20, 0.10])
# Direction towards the light in the world, and how bright it is; the first one casts the shadow.
_LIGHTS = (
    (np.array([0.45, 1.0, 0.75]), 0.75),
    (np.array([-0.9, 0.25, 0.5]), 0.22),
    (np.array([-0.3, 0.5, -1.0]), 0.25),
)
_AMBIENT = 0.30


@dataclass(frozen=True, kw_only=True, eq=False)
class Solid:
    """A thing in the room: triangles that share no corners, so that edges stay sharp."""

    vertices: Float[np.ndarray, "V 3"]
    """In the world, metres."""
    faces: Int[np.ndarray, "F 3"]
    normals: Float[np.ndarray, "V 3"]


class Studio:
    """The empty room, drawn once, to which each frame adds the person.

    Args:
        camera: Its size must be even.
        seat_height: Of the stool, metres; None: no stool.
        view: Where the camera stands.
    """

    def __init__(self, camera: Camera = CAMERA, *, seat_height: float | None, view: View = VIEW) -> None:
        self.camera = camera
        self.to_camera = view.pose()
        factor = _SAMPLES
        self._large = Camera(
            focal=(camera.focal[0] * factor, camera.focal[1] * factor),
            center=(camera.center[0] * factor, camera.center[1] * factor),
            size=(camera.size[0] * factor, camera.size[1] * factor),
        )
        self._depth = np.full(self._large.size[::-1], np.inf)
        self._color, self._floor = self._room()
        if seat_height is not None:
            self._add(stool(seat_height))

    def _add(self, solid: Solid) -> None:
        """Put a thing into the empty room."""
        color = self._color * self._shadow(_points_on(solid))[..., None]
        fragments = rasterize(self.to_camera(solid.vertices), solid.faces, self._large, self._depth)
        shade = light(fragments.interpolate(solid.faces, solid.normals))
        self._color, covered = self._over(color, fragments.pixel, _WOOD * shade[:, None])
        self._floor = self._floor * (1 - covered)

    def draw(
        self,
        vertices: Float[np.ndarray, "V 3"],
        faces: Int[np.ndarray, "F 3"],
        normals: Float[np.ndarray, "V 3"],
        outfit: Outfit,
    ) -> tuple[UInt8[np.ndarray, "H W 3"], Float[np.ndarray, "H W"]]:
        """The room with a person in it (RGB), and the depth buffer (metres; infinite on floor and wall).

        Args:
            vertices: In the world, metres.
            faces: Triangles, counter-clockwise from outside.
            normals: Of the vertices, in the world.
            outfit: What the person wears.
        """
        depth = self._depth.copy()
        fragments = rasterize(self.to_camera(vertices), faces, self._large, depth)
        lit = light(fragments.interpolate(faces, normals))[:, None]
        person = outfit.colors(fragments.interpolate(faces, outfit.paint)) * lit
        image, _ = self._over(self._color * self._shadow(vertices)[..., None], fragments.pixel, person)
        nearest = np.minimum.reduce([depth[i::_SAMPLES, j::_SAMPLES] for i in range(_SAMPLES) for j in range(_SAMPLES)])
        return (255 * np.minimum(image, 1.0) ** (1 / 2.2) + 0.5).astype(np.uint8), nearest

    def _over(self, below: np.ndarray, samples: np.ndarray, colors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Samples (indices into the large picture) with their colours over an image; also how far they cover it."""
        width, height = self.camera.size
        row, column = np.divmod(samples, self._large.size[0])
        pixel = row // _SAMPLES * width + column // _SAMPLES
        share = 1 / _SAMPLES**2
        sums = [np.bincount(pixel, weights, width * height) for weights in (None, *np.minimum(colors, 1.0).T)]
        covered, *channels = (share * total.reshape(height, width) for total in sums)
        covered = np.minimum(covered, 1.0)
        return below * (1 - covered[..., None]) + np.stack(channels, -1), covered

    def _rays(self) -> np.ndarray:
        """Directions (H, W, 3) in the world through the middles of the pixels."""
        width, height = self.camera.size
        x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        flat = np.stack([x, y], -1) - self.camera.center
        return np.concatenate([flat / self.camera.focal, np.ones((height, width, 1))], -1) @ self.to_camera.rotation

    def _room(self) -> tuple[np.ndarray, np.ndarray]:
        """Linear colour (H, W, 3) of the empty room, and how much of each pixel is floor, 0 to 1."""
        rays, place = self._rays(), -self.to_camera.rotation.T @ self.to_camera.translation
        to_floor = np.where(rays[..., 1] < 0, -place[1] / np.minimum(rays[..., 1], -1e-9), np.inf)
        to_wall = (_WALL_Z - place[2]) / rays[..., 2]
        behind = place[2] + np.minimum(to_floor, 1e3) * rays[..., 2]
        # Floor and wall meet in a bend: the one turns into the other over half a metre.
        floor = np.clip((behind - _WALL_Z) / 0.5, 0.0, 1.0) * np.isfinite(to_floor)
        floor = floor * floor * (3 - 2 * floor)
        spot = place + np.minimum(to_floor, to_wall)[..., None] * rays
        fall = np.exp(-(((spot - [0.3, 1.0, -0.8]) / [1.6, 2.2, 2.4]) ** 2).sum(-1) / 2)[..., None]
        color = (_WALL + floor[..., None] * (_FLOOR - _WALL)) * (0.55 + 0.5 * fall)
        return color, floor

    def _shadow(self, points: Float[np.ndarray, "N 3"]) -> Float[np.ndarray, "H W"]:
        """Factor by which things at these points darken the floor: what the main light throws, and close contact."""
        width, height = (length // 4 for length in self.camera.size)
        direction = _LIGHTS[0][0] / _LIGHTS[0][0][1]
        thrown = points - points[:, 1:2] * direction
        near = np.clip(1 - points[:, 1] / 0.16, 0, 1)
        layers = ((thrown, np.ones(len(points)), 2.2, 0.9, 0.42), (points * [1, 0, 1], near, 1.3, 1.4, 0.6))
        factor = np.ones((height, width), np.float32)
        for ground, weight, blur, gain, strength in layers:
            p = self.to_camera(ground)
            pixel = (p[:, :2] / p[:, 2:] * self.camera.focal + self.camera.center) / 4
            edges = [np.arange(height + 1), np.arange(width + 1)]
            dark = np.histogram2d(pixel[:, 1], pixel[:, 0], bins=edges, weights=weight)[0]
            dark = cv2.GaussianBlur(np.minimum(dark, 1.0).astype(np.float32), (0, 0), blur)
            factor *= 1 - strength * np.minimum(gain * dark, 1.0)
        large = cv2.resize(factor, self.camera.size, interpolation=cv2.INTER_LINEAR)
        return 1 - self._floor * (1 - large)


def light(normals: Float[np.ndarray, "P 3"]) -> Float[np.ndarray, "P"]:
    """Brightness of surfaces with these normals (world; need not be of unit length)."""
    unit = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    shade = _AMBIENT * (0.75 + 0.25 * unit[:, 1])
    for direction, strength in _LIGHTS:
        shade = shade + strength * np.maximum(unit @ (direction / np.linalg.norm(direction)), 0.0)
    return shade


def stool(height: float) -> Solid:
    """A round stool of that height (metres), with four legs."""
    parts = [_drum(0.185, height - 0.045, height)]
    for x in (-0.11, 0.11):
        for z in (-0.11, 0.11):
            parts.append(_bar(np.array([1.25 * x, 0.0, 1.25 * z]), np.array([x, height - 0.045, z]), 0.014))
    triangles = np.concatenate(parts) + np.array([STOOL_MIDDLE[0], 0.0, STOOL_MIDDLE[1]])
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    faces = np.arange(3 * len(triangles)).reshape(-1, 3)
    return Solid(vertices=triangles.reshape(-1, 3), faces=faces, normals=np.repeat(normals, 3, axis=0))


def _drum(radius: float, low: float, high: float, sides: int = 48) -> np.ndarray:
    """Triangles (F, 3, 3) of a disc with a rim, counter-clockwise from outside."""
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    ring = radius * np.stack([np.sin(angle), 0 * angle, np.cos(angle)], 1)
    top, bottom = ring + np.array([0, high, 0]), ring + np.array([0, low, 0])
    middle = np.broadcast_to(np.array([0, high, 0]), top[:-1].shape)
    lid = np.stack([middle, top[:-1], top[1:]], 1)
    rim = np.stack([bottom[:-1], bottom[1:], top[1:]], 1), np.stack([bottom[:-1], top[1:], top[:-1]], 1)
    return np.concatenate([lid, *rim])


def _bar(foot: np.ndarray, head: np.ndarray, half: float) -> np.ndarray:
    """Triangles (8, 3, 3) of a square bar from its foot to its head, open at both ends."""
    corners = half * np.array([[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]])
    low, high = foot + corners, head + corners
    return np.concatenate([np.stack([low[:-1], low[1:], high[1:]], 1), np.stack([low[:-1], high[1:], high[:-1]], 1)])


def _points_on(solid: Solid, count: int = 6000) -> np.ndarray:
    """Points spread evenly over a solid's triangles."""
    rng = np.random.default_rng(0)
    triangles = solid.vertices[solid.faces]
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    chosen = triangles[rng.choice(len(area), count, p=area / area.sum())]
    return (chosen * rng.dirichlet(np.ones(3), count)[..., None]).sum(1)
