"""onnxruntime, which tells nobody that it runs. Whoever needs it imports it from here.

Its recent packages (1.31 is one) write a lasting identifier when they are imported, and report to their maker what
they run. The environment variable stops both and must be set before; on Windows only the function counts. Somebody who
wants it otherwise sets the variable to 0.
"""

import os

_VARIABLE = "ORT_DISABLE_TELEMETRY"
os.environ.setdefault(_VARIABLE, "1")

import onnxruntime  # noqa: E402

if os.environ[_VARIABLE] != "0":
    onnxruntime.disable_telemetry_events()

__all__ = ["onnxruntime"]
