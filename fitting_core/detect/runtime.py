"""onnxruntime with its telemetry switched off. Import it from here only.

Its recent packages (1.31 is one) write a lasting identifier when they are imported, and report to their maker what
they run. The environment variable stops both and must be set before the import; on Windows only the function counts.
Set the variable to 0 to allow telemetry.
"""

import os

_VARIABLE = "ORT_DISABLE_TELEMETRY"
os.environ.setdefault(_VARIABLE, "1")

import onnxruntime  # noqa: E402

if os.environ[_VARIABLE] != "0":
    onnxruntime.disable_telemetry_events()

__all__ = ["onnxruntime"]
