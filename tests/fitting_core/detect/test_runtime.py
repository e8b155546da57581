"""What onnxruntime leaves behind when tcfit imports it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.parametrize("module", ["fitting_core.detect.runtime", "fitting_core.detect.onnx_model"])
def test_no_identifier_is_made(module: str, tmp_path: Path):
    environment = {name: value for name, value in os.environ.items() if name != "ORT_DISABLE_TELEMETRY"}
    places = dict.fromkeys(("TMPDIR", "HOME", "XDG_CACHE_HOME", "XDG_DATA_HOME"), str(tmp_path))
    code = f"import {module}, sys; assert 'onnxruntime' in sys.modules"
    subprocess.run([sys.executable, "-c", code], env=environment | places, check=True)
    assert list(tmp_path.rglob("*")) == []
