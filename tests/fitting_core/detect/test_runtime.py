"""What onnxruntime leaves behind when tcfit imports it, and what ends it."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from onnx import TensorProto, helper

from tests.drivers.processes import INTERRUPTIBLE
from tests.fitting_core.detect.onnx_files import save


@pytest.mark.parametrize("module", ["fitting_core.detect.runtime", "fitting_core.detect.onnx_model"])
def test_no_identifier_is_made(module: str, tmp_path: Path):
    environment = {name: value for name, value in os.environ.items() if name != "ORT_DISABLE_TELEMETRY"}
    places = dict.fromkeys(("TMPDIR", "HOME", "XDG_CACHE_HOME", "XDG_DATA_HOME"), str(tmp_path))
    code = f"import {module}, sys; assert 'onnxruntime' in sys.modules"
    subprocess.run([sys.executable, "-c", code], env=environment | places, check=True)
    assert list(tmp_path.rglob("*")) == []


def endless_model(path: Path) -> Path:
    """A model that loops 2^62 times before it answers."""
    number = helper.make_tensor_value_info("number", TensorProto.INT64, [])
    go_on, still = (helper.make_tensor_value_info(name, TensorProto.BOOL, []) for name in ("go_on", "still"))
    value, after = (helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, 3, 8, 8]) for name in ("value", "after"))
    steps = [helper.make_node("Identity", ["go_on"], ["still"]), helper.make_node("Cos", ["value"], ["after"])]
    body = helper.make_graph(steps, "body", [number, go_on, value], [still, after])
    loop = helper.make_node("Loop", ["turns", "", "image"], ["answer"], body=body)
    turns = {"turns": np.array(2**62, np.int64)}
    return save(path, [loop], image=(1, 3, 8, 8), outputs={"answer": (1, 3, 8, 8)}, constants=turns)


def test_ctrl_c_ends_a_model_that_loops(tmp_path: Path):
    code = f"""
import numpy as np
from pathlib import Path
from fitting_core.detect.onnx_model import OnnxModel
model = OnnxModel(Path({str(endless_model(tmp_path / "loop.onnx"))!r}), threads=1)
print("running", flush=True)
try:
    model.run([np.zeros((8, 8, 3), np.float32)])
except KeyboardInterrupt:
    print("ended")
"""
    process = subprocess.Popen([sys.executable, "-c", INTERRUPTIBLE + code], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None and process.stdout.readline() == "running\n"
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=60)[0] == "ended\n" and process.returncode == 0
    finally:
        process.kill()
