"""Temporally consistent SMPL-X fits from 2D keypoints: the library behind tcfit. It knows nothing of any viewer.

The names that a notebook needs are here, and each is imported when it is first used: `import fitting_core` alone loads
no torch. Modules of this package import from each other, never from here.

```python
from fitting_core import PRESETS, find_body, fit_clip, load_body, read_clip

clip = read_clip("walk.mp4")
body = load_body(find_body(gender="neutral"))
result = fit_clip(clip, body, PRESETS["tcfit"])
print(result.last.params.body_pose.shape)  # frames, 63: axis-angle in radians
```
"""

from typing import TYPE_CHECKING

from fitting_core.lazy_names import lazy_names

if TYPE_CHECKING:  # the table of public names, which `lazy_names` reads
    from fitting_core.body.files.reading import load_body as load_body
    from fitting_core.body.files.registry import find_body as find_body
    from fitting_core.body.files.registry import list_bodies as list_bodies
    from fitting_core.body.mesh import Mesh as Mesh
    from fitting_core.body.model import BodyModel as BodyModel
    from fitting_core.body.params import BodyParams as BodyParams
    from fitting_core.body.points.positions import joints_in_space as joints_in_space
    from fitting_core.body.points.positions import keypoints_in_space as keypoints_in_space
    from fitting_core.camera import Camera as Camera
    from fitting_core.clip import Clip as Clip
    from fitting_core.clip import OtherView as OtherView
    from fitting_core.clips.demo import demo_clip as demo_clip
    from fitting_core.clips.options import CameraOptions as CameraOptions
    from fitting_core.clips.options import ClipOptions as ClipOptions
    from fitting_core.clips.other_views import read_view as read_view
    from fitting_core.clips.people import read_people as read_people
    from fitting_core.clips.reading import read_clip as read_clip
    from fitting_core.clips.reading import read_keypoints as read_keypoints
    from fitting_core.config.schema import PRESETS as PRESETS
    from fitting_core.config.schema import FitConfig as FitConfig
    from fitting_core.config.schema import ShapeSample as ShapeSample
    from fitting_core.config.schema import SolverSettings as SolverSettings
    from fitting_core.config.schema import Temporal as Temporal
    from fitting_core.config.schema import Weights as Weights
    from fitting_core.config.toml import read_config as read_config
    from fitting_core.detect.detecting import DetectionProgress as DetectionProgress
    from fitting_core.detect.detectors import DETECTORS as DETECTORS
    from fitting_core.detect.detectors import find_detector as find_detector
    from fitting_core.errors import InputError as InputError
    from fitting_core.fit.events import Finished as Finished
    from fitting_core.fit.events import FitEvent as FitEvent
    from fitting_core.fit.events import FramesFitted as FramesFitted
    from fitting_core.fit.events import Iteration as Iteration
    from fitting_core.fit.events import PhaseFinished as PhaseFinished
    from fitting_core.fit.events import PhaseStarted as PhaseStarted
    from fitting_core.fit.fitting import fit_clip as fit_clip
    from fitting_core.fit.fitting import fit_events as fit_events
    from fitting_core.fit.fitting import rerun_events as rerun_events
    from fitting_core.fit.phase_figures import evaluate_objective as evaluate_objective
    from fitting_core.fit.refitting import refit as refit
    from fitting_core.io import read_motion as read_motion
    from fitting_core.io.known_shape import read_known_shape as read_known_shape
    from fitting_core.io.motion.mesh_sequence import write_obj_sequence as write_obj_sequence
    from fitting_core.io.motion_files import motion_of as motion_of
    from fitting_core.io.motion_files import stored_motion as stored_motion
    from fitting_core.io.motion_files import write_motion as write_motion
    from fitting_core.io.result_files import StoredFit as StoredFit
    from fitting_core.io.result_files import read_fit as read_fit
    from fitting_core.io.result_files import write_result as write_result
    from fitting_core.keypoints import Keypoints as Keypoints
    from fitting_core.measure.comparison import Comparison as Comparison
    from fitting_core.measure.comparison import evaluate_fit as evaluate_fit
    from fitting_core.measure.comparison import figure_titles as figure_titles
    from fitting_core.measure.references.files import read_reference as read_reference
    from fitting_core.motion import Motion as Motion
    from fitting_core.render.overlay import Shown as Shown
    from fitting_core.render.overlay import picture_of as picture_of
    from fitting_core.render.overlay import write_overlay as write_overlay
    from fitting_core.results.fit_result import FitResult as FitResult
    from fitting_core.results.fit_result import PhaseResult as PhaseResult
    from fitting_core.results.given_start import KnownShape as KnownShape
    from fitting_core.starts.reading import read_start as read_start


# A folder's name must not be among them: once imported, the folder would hide it.
__all__, __getattr__, __dir__ = lazy_names(__name__, __file__)  # pyright: ignore[reportUnsupportedDunderAll]
