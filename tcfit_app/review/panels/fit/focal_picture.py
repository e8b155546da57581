"""A drawing of what a focal length means: camera, field of view and person from above, to scale."""

import math
from dataclasses import dataclass

import numpy as np

from fitting_core.camera import FULL_FRAME_DIAGONAL_MM, focal_from_35mm
from fitting_core.keypoints import INDEX, Keypoints
from tcfit_app.review.panels.elements.html import Html, tag

LENSES = {"wide 24": 24.0, "phone 28": 28.0, "35": 35.0, "50": 50.0, "portrait 85": 85.0}
"""Usual lenses by name: 35 mm equivalents."""
_TRUNK, _SHOULDERS = 0.5, 0.37
"""Typical distances in metres: shoulders to hips, and shoulder to shoulder."""
_REACH = 0.6
"""How far a hand reaches forward, metres."""
_SURE = 0.3
_WIDTH, _HEIGHT = 300, 96
"""Size of the drawing, CSS pixels."""


@dataclass(frozen=True, kw_only=True)
class Perspective:
    """How a clip was filmed if this is the focal length."""

    focal: float
    """Pixels."""
    size: tuple[int, int]
    """Width and height of the image in pixels."""
    metre: float | None
    """Pixels per metre at the person's distance, median over frames; None if the keypoints do not tell."""

    @property
    def millimetres(self) -> float:
        """The 35 mm equivalent."""
        return self.focal * FULL_FRAME_DIAGONAL_MM / math.hypot(*self.size)

    @property
    def angle(self) -> float:
        """Horizontal field of view, radians."""
        return 2 * math.atan(self.size[0] / 2 / self.focal)

    @property
    def distance(self) -> float | None:
        """Metres from the camera to the person."""
        return None if self.metre is None else self.focal / self.metre

    @property
    def words(self) -> str:
        """Lens, field of view, distance, and how much it enlarges a hand that reaches forward."""
        said = f"{self.millimetres:.0f} mm (35 mm equivalent), {math.degrees(self.angle):.0f}° wide"
        if self.distance is None:
            return said
        said += f"; the person is about {self.distance:.1f} m away"
        if self.distance < 1.5 * _REACH:
            return f"{said}, which is hardly possible"
        larger = self.distance / (self.distance - _REACH) - 1
        return f"{said}. An outstretched hand looks {100 * larger:.0f} % larger"


def metre_in_pixels(keypoints: Keypoints) -> float | None:
    """Pixels per metre at the person's distance, by trunk or shoulders, median over frames; None without any."""

    def lengths(a: str, b: str) -> np.ndarray:
        i, j = INDEX[a], INDEX[b]
        seen = np.minimum(keypoints.confidence[:, i], keypoints.confidence[:, j]) > _SURE
        return np.linalg.norm(keypoints.xy[seen, i] - keypoints.xy[seen, j], axis=-1)

    trunk = np.concatenate([lengths(f"{side}_shoulder", f"{side}_hip") for side in ("left", "right")])
    for found, metres in ((trunk, _TRUNK), (lengths("left_shoulder", "right_shoulder"), _SHOULDERS)):
        if len(found) and (middle := float(np.median(found))) > 1:
            return middle / metres
    return None


def focal_of_lens(name: str, size: tuple[int, int]) -> float:
    """Pixels, of one of LENSES in an image of that size."""
    return focal_from_35mm(LENSES[name], size)


def focal_picture(perspective: Perspective) -> Html:
    """An SVG: the camera on the left, its field of view as a wedge, the person in it, a tick every metre."""
    distance = perspective.distance or 4.0
    scale = (_WIDTH - 30) / (distance + 1.2)
    half, middle = math.tan(perspective.angle / 2), _HEIGHT / 2
    far = _WIDTH - 12
    rise = min(half * (far - 12), 10 * _HEIGHT)
    parts = [
        _svg(
            "polygon", points=f"12,{middle} {far},{middle - rise:.1f} {far},{middle + rise:.1f}", class_="tcfit-wedge"
        ),
        *(
            _svg("line", x1=x, x2=x, y1=_HEIGHT - 5, y2=_HEIGHT, class_="tcfit-tick")
            for x in np.arange(12, far, max(scale, 4)).round(1)
        ),
        _svg("rect", x=2, y=middle - 6, width=12, height=12, rx=2, class_="tcfit-camera"),
    ]
    if perspective.distance is not None:
        x = 12 + distance * scale
        parts += [
            _svg("line", x1=12, x2=f"{x:.1f}", y1=middle, y2=middle, class_="tcfit-ray"),
            _svg(
                "ellipse",
                cx=f"{x:.1f}",
                cy=middle,
                rx=f"{0.14 * scale:.1f}",
                ry=f"{0.24 * scale:.1f}",
                class_="tcfit-person",
            ),
        ]
    inside = Html("".join(parts))
    label = f"From above, a tick for each metre. {perspective.words}"
    return tag("svg", inside, viewBox=f"0 0 {_WIDTH} {_HEIGHT}", class_="tcfit-focal", role="img", aria_label=label)


def _svg(name: str, **attributes: object) -> Html:
    return tag(name, "", **{key: str(value) for key, value in attributes.items()})
