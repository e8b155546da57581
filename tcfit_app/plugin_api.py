"""What plugins import: names that stay here, with the fields that docs/plugins.md lists, from version to version.

Each is imported when it is first used, so that a reader of keypoints loads no torch.
"""

from typing import TYPE_CHECKING

from fitting_core.lazy_names import lazy_names

if TYPE_CHECKING:  # the table of the names, which `lazy_names` reads
    from fitting_core.detections import Detections as Detections
    from fitting_core.errors import InputError as InputError
    from fitting_core.io.added_readers import KeypointReader as KeypointReader
    from fitting_core.io.added_readers import MotionReader as MotionReader
    from fitting_core.io.motion.imported_motion import ImportedMotion as ImportedMotion
    from fitting_core.motion import Motion as Motion
    from tcfit_app.exports.source import ExportSource as ExportSource
    from tcfit_app.exports.table import Export as Export

__all__, __getattr__, __dir__ = lazy_names(__name__, __file__)  # pyright: ignore[reportUnsupportedDunderAll]
