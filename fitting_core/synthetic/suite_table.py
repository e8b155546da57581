"""The table of the synthetic suite: who does what, and where the camera stands.

Frame counts are those of the paper's Table 1, as are the people's volumes in kind.
"""

from dataclasses import dataclass

from fitting_core.camera import Camera
from fitting_core.synthetic.studio.view import View

SIZE = (720, 960)
"""Of the images, as the paper's: width and height in pixels."""
FRAME_RATE = 25.0


@dataclass(frozen=True, kw_only=True)
class Subject:
    """A person of the suite."""

    gender: str
    """Of the free body whose shape the person has."""
    betas: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class SuiteSequence:
    """One sequence of the suite."""

    name: str
    motion: str
    """One of MOTIONS."""
    subject: Subject
    frames: int
    view: View
    focal: float
    """Of the camera, pixels in an image of SIZE."""
    seed: int
    frame_rate: float = FRAME_RATE
    scale: float = 1.0
    """Of the image, against SIZE."""

    @property
    def seconds(self) -> float:
        """From the first frame to the last."""
        return (self.frames - 1) / self.frame_rate

    @property
    def camera(self) -> Camera:
        """With the principal point in the image's middle."""
        width, height = (round(self.scale * length) for length in SIZE)
        focal = self.scale * self.focal
        return Camera(
            focal=(focal, focal), center=(width / 2, height / 2), size=(width, height), source="the suite's own camera"
        )


_SUBJECTS = (
    Subject(gender="male", betas=(0.1, -0.4, 0.3, -0.15, 0.2, 0.3, -0.2, 0.0, 0.1, 0.0)),
    Subject(gender="female", betas=(0.5, 0.2, 0.3, 1.7, 0.2, -0.2, -0.1, 0.0, 0.2, 0.0)),
    Subject(gender="female", betas=(0.9, 0.3, -0.2, 0.25, 0.2, -0.3, 0.1, 0.2, 0.0, 0.0)),
    Subject(gender="male", betas=(-0.4, 0.3, 0.2, 0.05, -0.2, 0.1, 0.3, -0.2, 0.0, 0.1)),
    Subject(gender="male", betas=(0.4, 0.2, -0.3, 1.2, -0.3, 0.2, 0.2, 0.1, 0.0, 0.0)),
    Subject(gender="female", betas=(-0.5, -0.3, -0.2, -0.9, 0.1, 0.2, -0.2, 0.1, 0.0, -0.1)),
)
"""Average, heavy, average, average, heavy, light; in the order of the paper's subjects 1, 16, 17, 32, 41 and 45."""
_SIGNER = Subject(gender="female", betas=(0.2, -0.5, 0.1, -0.1, 0.3, 0.1, 0.2, -0.2, 0.1, 0.0))


def _view(azimuth: float, height: float, distance: float, up: float = 0.86) -> View:
    return View(azimuth=azimuth, height=height, distance=distance, looking_at=(0.0, up, -0.05))


_CAMERAS = {
    "simple": (
        (_view(22, 1.35, 3.4), 1330.0), (_view(-18, 1.10, 4.2), 1700.0), (_view(28, 1.50, 3.0), 1150.0),
        (_view(-26, 1.25, 3.8), 1480.0), (_view(15, 0.95, 4.8), 1880.0), (_view(-32, 1.55, 2.8), 1120.0),
    ),
    "complex": (
        (_view(20, 1.30, 3.9, 0.80), 1480.0), (_view(-24, 1.45, 4.4, 0.80), 1700.0),
        (_view(30, 1.20, 3.4, 0.80), 1260.0), (_view(-16, 1.60, 3.7, 0.80), 1400.0),
        (_view(26, 1.05, 5.0, 0.80), 1860.0), (_view(-30, 1.40, 3.2, 0.80), 1210.0),
    ),
}  # fmt: skip
"""Slightly from the side, each with its focal length in pixels."""
_FRAMES = {"simple": (50, 75, 75, 100, 100, 75), "complex": (225, 200, 175, 250, 219, 177)}
_SEEDS = {"simple": (100, 101, 102, 103, 104, 105), "complex": (208, 315, 417, 505, 605, 707)}
"""Chosen so that people differ in the foot that crosses and the hands that support."""


SEQUENCES: dict[str, SuiteSequence] = {
    f"{motion}_{i + 1}": SuiteSequence(
        name=f"{motion}_{i + 1}",
        motion=motion,
        subject=subject,
        frames=_FRAMES[motion][i],
        view=_CAMERAS[motion][i][0],
        focal=_CAMERAS[motion][i][1],
        seed=_SEEDS[motion][i],
    )
    for motion in _FRAMES
    for i, subject in enumerate(_SUBJECTS)
} | {
    "signing_1": SuiteSequence(
        name="signing_1",
        motion="signing",
        subject=_SIGNER,
        frames=200,
        view=View(azimuth=8.0, height=1.3, distance=2.6, looking_at=(0.0, 1.15, 0.0)),
        focal=1500.0,
        seed=300,
    )
}
"""By name: simple_1 to simple_6, complex_1 to complex_6, signing_1."""
