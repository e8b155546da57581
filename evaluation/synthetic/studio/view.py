"""Where the camera of a generated clip stands."""

from dataclasses import dataclass

import numpy as np

from fitting_core.world_camera import WorldCamera


@dataclass(frozen=True, kw_only=True)
class View:
    """A camera's place in the world (x to the person's left, y up, z forward; metres). It is held upright."""

    azimuth: float
    """Degrees to the person's left, of the way from what it looks at to the camera."""
    height: float
    """Above the floor."""
    distance: float
    """Horizontal, from the vertical line through x = 0 and what it looks at."""
    looking_at: tuple[float, float, float]

    def pose(self) -> WorldCamera:
        """The way from the world to camera space."""
        angle, middle = np.radians(self.azimuth), np.array(self.looking_at)
        place = np.array([self.distance * np.sin(angle), self.height, middle[2] + self.distance * np.cos(angle)])
        forward = middle - place
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 1.0, 0.0])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        return WorldCamera(rotation=rotation, translation=-rotation @ place)
