"""What plugins import: names that stay here, with the fields that docs/plugins.md lists, from version to version.

Each is imported when it is first used, so that a reader of keypoints loads no torch.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # for editors and type checkers, which do not follow the table below; a test compares the two
    from fitting_core.detections import Detections as Detections
    from fitting_core.errors import InputError as InputError
    from fitting_core.io.added_readers import KeypointReader as KeypointReader
    from fitting_core.io.added_readers import MotionReader as MotionReader
    from fitting_core.io.motion.imported_motion import ImportedMotion as ImportedMotion
    from fitting_core.measure.comparison import FigureKind as FigureKind
    from fitting_core.measure.pairing import Pair as Pair
    from fitting_core.motion import Motion as Motion
    from tcfit_app.analysis.findings import Finding as Finding
    from tcfit_app.analysis.posed_fit import PosedFit as PosedFit
    from tcfit_app.analysis.run_metrics import MeasuredRun as MeasuredRun
    from tcfit_app.analysis.run_metrics import MetricKind as MetricKind
    from tcfit_app.exports.source import ExportSource as ExportSource
    from tcfit_app.exports.table import Export as Export

HOMES = {
    "InputError": "fitting_core.errors",
    "KeypointReader": "fitting_core.io.added_readers",
    "MotionReader": "fitting_core.io.added_readers",
    "Detections": "fitting_core.detections",
    "Motion": "fitting_core.motion",
    "ImportedMotion": "fitting_core.io.motion.imported_motion",
    "FigureKind": "fitting_core.measure.comparison",
    "Pair": "fitting_core.measure.pairing",
    "Finding": "tcfit_app.analysis.findings",
    "PosedFit": "tcfit_app.analysis.posed_fit",
    "MeasuredRun": "tcfit_app.analysis.run_metrics",
    "MetricKind": "tcfit_app.analysis.run_metrics",
    "ExportSource": "tcfit_app.exports.source",
    "Export": "tcfit_app.exports.table",
}
__all__ = sorted(HOMES)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    """A name of the table, imported from its home (PEP 562)."""
    if name not in HOMES:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    return getattr(import_module(HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
