"""Light and looks of the scene in one browser tab."""

import viser

from tcfit_app.review.scene.layers import RGB

# Directions towards the lights in camera space (x right, y down, z away from the camera), colours, intensities: a key
# light from the upper left of the camera, a weak fill from its right, and a rim from behind.
_LIGHTS: tuple[tuple[str, tuple[float, float, float], RGB, float], ...] = (
    ("key", (-0.5, -0.7, -0.9), (255, 250, 242), 2.5),
    ("fill", (0.9, -0.1, -0.6), (226, 236, 255), 0.55),
    ("rim", (0.3, -0.6, 1.0), (255, 255, 255), 0.9),
)
_AMBIENT = 0.6


def light_scene(client: viser.ClientHandle) -> None:
    """Soft light from the video camera's side, in place of viser's, and y downwards."""
    scene = client.scene
    scene.set_up_direction("-y")
    scene.configure_default_lights(enabled=False, cast_shadow=False)
    scene.configure_environment_map(None)
    scene.add_light_ambient("/light/ambient", intensity=_AMBIENT)
    for name, direction, color, intensity in _LIGHTS:
        scene.add_light_directional(
            f"/light/{name}", color=color, intensity=intensity, cast_shadow=False, position=direction
        )
