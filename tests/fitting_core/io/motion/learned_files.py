"""Results as learned systems write them, of known poses, by numpy, pickle and torch; joblib's form by hand."""

import io
import pickle
import sys
import types
import zlib
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import torch

from fitting_core.body import rotations
from fitting_core.body.params import BodyParams
from fitting_core.camera import Camera

SIZE = (640, 480)
FRAMES = 5
DIAGONAL = Camera(focal=(800.0, 800.0), center=(320.0, 240.0), size=SIZE)


class NumpyArrayWrapper:
    """What joblib writes in front of an array's bytes."""

    def __init__(self, array: np.ndarray, alignment: int | None) -> None:
        self.subclass, self.shape, self.dtype = np.ndarray, array.shape, array.dtype
        self.order = "F" if array.flags.f_contiguous and not array.flags.c_contiguous else "C"
        self.allow_mmap = True
        if alignment is not None:
            self.numpy_array_alignment_bytes = alignment


NumpyArrayWrapper.__module__ = "joblib.numpy_pickle"


_Pickler: Any = pickle._Pickler


class _JoblibPickler(_Pickler):
    """joblib's pickler: arrays lie in the file between the pickle's codes."""

    def __init__(self, file: io.BytesIO, protocol: int, alignment: int | None) -> None:
        super().__init__(file, protocol=protocol)
        self._file, self._alignment = file, alignment

    def save(self, obj: Any, save_persistent_id: bool = True) -> Any:
        """Write an object."""
        if type(obj) is not np.ndarray:
            return super().save(obj, save_persistent_id)
        wrapper = NumpyArrayWrapper(obj, None if obj.dtype.hasobject else self._alignment)
        super().save(wrapper)
        if self.proto >= 4:
            self.framer.commit_frame(force=True)
        if obj.dtype.hasobject:
            pickle.dump(obj, self._file, protocol=2)
            return None
        if self._alignment is not None:
            padding = self._alignment - (self._file.tell() + 1) % self._alignment
            self._file.write(bytes([padding]) + b"\xff" * padding)
        self._file.write(obj.tobytes("F" if wrapper.order == "F" else "C"))
        return None


def joblib_bytes(content: Any, *, protocol: int = 4, alignment: int | None = 16) -> bytes:
    """A file of joblib.dump."""
    module = types.ModuleType("joblib.numpy_pickle")
    module.NumpyArrayWrapper = NumpyArrayWrapper  # pyright: ignore[reportAttributeAccessIssue]
    names = {"joblib": types.ModuleType("joblib"), "joblib.numpy_pickle": module}
    before = {name: sys.modules.get(name) for name in names}
    sys.modules.update(names)
    try:
        file = io.BytesIO()
        _JoblibPickler(file, protocol, alignment).dump(content)
        return file.getvalue()
    finally:
        for name, old in before.items():
            if old is None:
                del sys.modules[name]
            else:
                sys.modules[name] = old


def torch_bytes(content: Any, **options: Any) -> bytes:
    """A file of torch.save."""
    file = io.BytesIO()
    torch.save(content, file, **options)
    return file.getvalue()


def npz_bytes(**content: Any) -> bytes:
    """A file of np.savez with Python objects."""
    file = io.BytesIO()
    np.savez(file, allow_pickle=True, **{name: np.array(value, dtype=object) for name, value in content.items()})
    return file.getvalue()


def truth(seed: int = 0, frames: int = FRAMES) -> BodyParams:
    """A motion in camera space without hands and face, 4 m away."""
    draw = torch.Generator().manual_seed(seed)
    zero = BodyParams.neutral(frames, hand_components=45)
    drawn = {
        name: 0.4 * torch.randn(getattr(zero, name).shape, generator=draw, dtype=torch.float64)
        for name in ("betas", "global_orient", "body_pose", "camera_translation")
    }
    drawn["betas"] = drawn["betas"][:1].expand(frames, -1)
    drawn["global_orient"] = drawn["global_orient"] * 0.3 + torch.tensor([3.0, 0.0, 0.0])
    drawn["camera_translation"] = drawn["camera_translation"] * 0.3 + torch.tensor([0.2, 0.1, 4.0])
    return BodyParams(**{**vars(zero), **drawn})


def smpl_pose(params: BodyParams) -> np.ndarray:
    """SMPL's 72 numbers; those of the two hand joints are not zero."""
    hands = torch.full((len(params), 6), 0.2, dtype=torch.float64)
    return torch.cat([params.global_orient, params.body_pose, hands], 1).numpy().astype(np.float32)


def matrices(params: BodyParams) -> np.ndarray:
    """SMPL's 24 rotation matrices."""
    return rotations.exp(torch.as_tensor(smpl_pose(params).reshape(len(params), 24, 3), dtype=torch.float64)).numpy()


def f4(values: torch.Tensor) -> np.ndarray:
    """In float32."""
    return values.numpy().astype(np.float32)


def gvhmr(params: BodyParams, **changed: Any) -> dict[str, Any]:
    """hmr4d_results.pt."""
    k = torch.tensor([[800.0, 0, 320], [0, 800, 240], [0, 0, 1]])
    own = {
        "body_pose": params.body_pose.float(),
        "betas": params.betas[:1].float().expand(len(params), -1),
        "global_orient": params.global_orient.float(),
        "transl": params.camera_translation.float(),
    }
    own |= changed.pop("incam", {})
    return {
        "smpl_params_global": {key: torch.zeros(len(params), 3) for key in own},
        "smpl_params_incam": {key: value for key, value in own.items() if value is not None},
        "K_fullimg": k.repeat(len(params), 1, 1),
        "net_outputs": {"static_conf_logits": torch.zeros(1, len(params), 6).half(), "done": torch.tensor(True)},
        **changed,
    }


def wham(people: dict[int, tuple[BodyParams, np.ndarray]], **changed: Any) -> dict[int, Any]:
    """wham_output.pkl."""
    found: defaultdict[int, Any] = defaultdict(dict)
    for number, (params, frames) in people.items():
        found[number] = {
            "pose": smpl_pose(params),
            "trans": f4(params.camera_translation),
            "pose_world": smpl_pose(params) * 0,
            "trans_world": f4(params.camera_translation) * 0,
            "betas": f4(params.betas),
            "verts": np.zeros((len(params), 6890, 3), np.float32),
            "frame_ids": frames,
            **changed,
        }
    return found


_CAMERA = {
    "pred_cam_R": np.eye(3)[None],
    "pred_cam_T": np.zeros((1, 3)),
    "img_focal": np.float64(800),
    "img_center": np.array([320.0, 240.0]),
}


def prompthmr(people: dict[int, tuple[BodyParams, np.ndarray]], **changed: Any) -> dict[str, Any]:
    """results.pkl."""
    return {
        "camera": {**_CAMERA, "img_focal": np.float32(800)},
        "people": {
            number: {
                "track_id": number,
                "frames": frames,
                "masks": np.ones((len(params), 30, 40), bool),
                "bboxes": np.zeros((len(params), 4)),
                "smplx_cam": {
                    "rotmat": np.zeros((len(params), 55, 3, 3), np.float32),
                    "pose": np.pad(smpl_pose(params)[:, :66], ((0, 0), (0, 9))),
                    "shape": f4(params.betas),
                    "trans": f4(params.camera_translation),
                },
            }
            for number, (params, frames) in people.items()
        },
        "timings": {},
        "masks": None,
        "has_tracks": True,
        "contact_joint_ids": [7, 10, 8, 11, 20, 21],
        **changed,
    }


PHALP_CAMERA = Camera(focal=(12500.0, 12500.0), center=(320.0, 240.0), size=SIZE)
"""5000 pixels in a square of 256, of which the image's longer side takes all."""


def phalp(people: dict[int, tuple[BodyParams, np.ndarray]], **changed: Any) -> dict[str, Any]:
    """demo_walk.pkl; a ghost of each person in the last image."""
    last = max(int(frames.max()) for _, frames in people.values()) + 1
    found: dict[str, Any] = {}
    for t in range(last + 1):
        values: dict[str, Any] = {"time": t, "shot": 0, "frame_path": f"outputs/_DEMO/walk/img/{t + 1:06d}.jpg"}
        lists: dict[str, list[Any]] = {
            key: [] for key in ("tid", "tracked_time", "smpl", "camera", "size", "img_name", "mask", "bbox", "conf")
        }
        for number, (params, frames) in people.items():
            places = np.flatnonzero(frames == t)
            ghost = t == last
            if not len(places) and not ghost:
                continue
            k = int(places[0]) if len(places) else 0
            turns = matrices(params)[k].astype(np.float32)
            lists["tid"].append(number)
            lists["tracked_time"].append(3 if ghost else 0)
            lists["smpl"].append(
                {"global_orient": turns[:1], "body_pose": turns[1:], "betas": f4(params.betas)[k]}
                | changed.get("smpl", {})
            )
            lists["camera"].append(f4(params.camera_translation)[k] * (0 if ghost else 1))
            lists["size"].append([SIZE[1], SIZE[0]])
            lists["img_name"].append(f"{t + 1:06d}.jpg")
            lists["mask"].append([{"size": [480, 640], "counts": b"abc"}])
            lists["bbox"].append(np.zeros(4))
            lists["conf"].append(np.float32(0.9))
        found[values["frame_path"]] = {**values, **lists, **{k: v for k, v in changed.items() if k != "smpl"}}
    return found


def written(path: Path, data: bytes) -> Path:
    """A file with these bytes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


def zlib_packed(data: bytes) -> bytes:
    """As joblib.dump(compress=3) packs it."""
    return zlib.compress(data, 3)
