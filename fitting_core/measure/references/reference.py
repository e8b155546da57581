"""The reference of a fit: points in space, and their body if known."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int

from fitting_core import keypoints as kp
from fitting_core.body.markers.marker_set import NAMED, MarkerSet
from fitting_core.body.model import N_JOINTS, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.errors import InputError
from fitting_core.files.npz import write_npz
from fitting_core.video.frame_names import frames_for_one

FORMAT = "tcfit reference 1"


@dataclass(frozen=True, kw_only=True)
class BodyOf:
    """Which body model a reference is a pose of."""

    kind: str
    gender: str
    hash: str
    """SHA-256 of its file; empty: whichever file of this kind and gender is there."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Reference:
    """T frames of something that is known better than a fit knows it. Metres."""

    name: str
    """For the user."""
    kind: str
    """Its source, in words."""
    frame_rate: float | None
    """Frames per second; None: as the clip's."""
    first_frame: int = 0
    """Number of its first frame, counted at its own rate from the video's first one."""
    first_frame_known: bool = True
    """False: assumed to start with the video."""
    in_camera: bool
    """Whether it stands in the camera's space (x right, y down, z away); else only its form can be compared."""
    points: Float[np.ndarray, "T 137 3"]
    """The keypoints of `fitting_core.keypoints`; NaN if unknown."""
    joints: Float[np.ndarray, "T 55 3"] | None = None
    """SMPL-X's joints."""
    markers: MarkerSet | None = None
    """Markers and joints that were measured beside the keypoints, or in their place."""
    marker_places: Float[np.ndarray, "T M 3"] | None = None
    """Given exactly when `markers` is; NaN where one was not seen."""
    params: BodyParams | None = None
    body: BodyOf | None = None
    """Given exactly when `params` is."""
    others: Mapping[str, Float[np.ndarray, "T 137 3"]] = field(default_factory=dict)
    """Other systems' results for this clip, by name, each in its own space."""
    notes: tuple[str, ...] = field(default=())
    """Notes for the user on how it was read."""

    def __post_init__(self) -> None:
        assert self.points.shape[1:] == (kp.COUNT, 3)
        assert self.joints is None or self.joints.shape == (len(self.points), N_JOINTS, 3)
        assert (self.params is None) == (self.body is None)
        assert all(points.shape == self.points.shape for points in self.others.values())
        assert (self.markers is None) == (self.marker_places is None)

    def __len__(self) -> int:
        return len(self.points)

    @property
    def all_points(self) -> Float[np.ndarray, "T 137+M 3"]:
        """Keypoints and markers."""
        return self.points if self.marker_places is None else np.concatenate([self.points, self.marker_places], 1)

    def starting_at(self, frame: int, frame_rate: float) -> "Reference":
        """The same reference, stated to begin at this frame of a video with that frame rate."""
        return replace(self, first_frame=round(frame * self._frames_for_one(frame_rate)), first_frame_known=True)

    def frames_of(self, count: int, first_frame: int, frame_rate: float) -> Int[np.ndarray, "count"]:
        """For each frame of a fit the reference's frame of that moment; -1 where it has none.

        Args:
            count: Frames of the fit.
            first_frame: Number in the video of its first frame.
            frame_rate: Frames per second of the video.

        Raises:
            InputError: They have no moment in common; or both last as long, the fit begins later than the video, and
                the start of the reference is not given.
        """
        ratio = self._frames_for_one(frame_rate)
        if first_frame and not self.first_frame_known and round(len(self) / ratio) == count:
            raise InputError(
                f"{self.name}: has {len(self)} frames, which last as long as the fit's {count}, and does not say where "
                f"it begins; expected that to be known, as the fit begins at the video's frame {first_frame}. Say it "
                f"with --reference-first-frame {first_frame} if the reference was "
                "cut to the fit's frames, 0 if it begins with the video."
            )
        numbers = first_frame + np.arange(count)
        found = np.round(numbers * ratio).astype(int) - self.first_frame
        found = np.where((found >= 0) & (found < len(self)), found, -1)
        if (found < 0).all():
            first, last = round(self.first_frame / ratio), first_frame + count - 1
            raise InputError(
                f"{self.name}: has {len(self)} frames from the video's frame {first} on, and the fit has "
                f"frames {first_frame} to {last}; expected a reference of the same clip. Give that."
            )
        return found

    def is_even(self, frame_rate: float) -> bool:
        """Whether its frames at the moments of a video's frames lie evenly in time, so that they tell accelerations.

        Otherwise the nearest ones are up to half a frame off: a motion sampled at 30 per second that is compared with
        itself at 60 had an acceleration error of 14 m/s².
        """
        return self._frames_for_one(frame_rate).is_integer()

    def _frames_for_one(self, frame_rate: float) -> float:
        """How many of its frames pass in one frame of a video."""
        return 1.0 if self.frame_rate is None else frames_for_one(self.frame_rate, frame_rate)


def stated_rate(path: Path, arrays: Mapping[str, np.ndarray], keys: Sequence[str]) -> float | None:
    """Frames per second by the first of these keys that a file has; None: it does not say. Raises InputError if it says
    something impossible."""
    rate = next((float(arrays[key]) for key in keys if key in arrays), None)
    if rate is not None and not 0 < rate < np.inf:
        raise InputError(f"{path}: has {rate:g} frames per second; expected a number above 0.")
    return rate


def stated_first_frame(path: Path, arrays: Mapping[str, np.ndarray]) -> int | None:
    """What a file's key `first_frame` says, counted at its own rate from the video's first frame; None: nothing. Raises
    InputError if it says something impossible."""
    if "first_frame" not in arrays:
        return None
    number = float(arrays["first_frame"])
    if not number.is_integer():
        raise InputError(f"{path}: its first_frame is {number:g}; expected a whole number.")
    return int(number)


def write_reference(path: Path, reference: Reference) -> None:
    """Write a reference as npz; `read_stored` has it back.

    Keys: format, name, kind, frame_rate (0: as the clip's), first_frame, first_frame_known, in_camera,
    notes, points, and where they are known joints, marker_names, marker_targets, marker_radius, marker_places,
    the fields of `BodyParams`, body_kind, body_gender, body_hash, other_names, other_points (N, T, 137, 3).
    """
    arrays: dict[str, object] = {
        "format": FORMAT,
        "name": reference.name,
        "kind": reference.kind,
        "frame_rate": reference.frame_rate or 0.0,
        "first_frame": reference.first_frame,
        "first_frame_known": reference.first_frame_known,
        "in_camera": reference.in_camera,
        "notes": np.array(reference.notes, np.str_),
        "points": reference.points,
    }
    if reference.joints is not None:
        arrays["joints"] = reference.joints
    if reference.markers is not None and reference.marker_places is not None:
        targets = [str(on) for on in reference.markers.targets.values()]
        arrays |= {"marker_names": np.array(reference.markers.names), "marker_targets": np.array(targets)}
        arrays |= {"marker_radius": reference.markers.radius, "marker_places": reference.marker_places}
    if reference.params is not None and reference.body is not None:
        arrays |= {f.name: getattr(reference.params, f.name).numpy() for f in fields(BodyParams)}
        arrays |= {f"body_{f.name}": getattr(reference.body, f.name) for f in fields(BodyOf)}
    if reference.others:
        arrays |= {"other_names": np.array([*reference.others]), "other_points": np.stack([*reference.others.values()])}
    write_npz(path, {name: np.asarray(value) for name, value in arrays.items()})


def read_stored(path: Path, arrays: dict[str, np.ndarray]) -> Reference:
    """Read the file of `write_reference`.

    Raises:
        KeyError: An array is missing.
        ValueError: One has another form.
    """
    params = body = None
    if "body_pose" in arrays:
        params = BodyParams(**{f.name: torch.as_tensor(arrays[f.name]) for f in fields(BodyParams)})
        body = BodyOf(**{f.name: str(arrays[f"body_{f.name}"]) for f in fields(BodyOf)})
    points, joints = arrays["points"], arrays.get("joints")
    markers = _stored_markers(arrays) if "marker_names" in arrays else None
    if points.ndim != 3 or points.shape[1:] != (kp.COUNT, 3):
        raise ValueError(f"points has the shape {points.shape}, expected (frames, {kp.COUNT}, 3)")
    return Reference(
        name=str(arrays["name"]),
        kind=str(arrays["kind"]),
        frame_rate=float(arrays["frame_rate"]) or None,
        first_frame=int(arrays["first_frame"]),
        first_frame_known=bool(arrays.get("first_frame_known", True)),
        in_camera=bool(arrays["in_camera"]),
        points=points,
        joints=joints,
        markers=markers,
        marker_places=None if markers is None else arrays["marker_places"],
        params=params,
        body=body,
        others=dict(zip(arrays["other_names"].tolist(), arrays["other_points"], strict=True))
        if "other_names" in arrays
        else {},
        notes=tuple(arrays["notes"].tolist()),
    )


def _stored_markers(arrays: Mapping[str, np.ndarray]) -> MarkerSet:
    names, on = arrays["marker_names"].tolist(), arrays["marker_targets"].tolist()
    targets = {str(name): int(t) if t.isdecimal() else t for name, t in zip(names, on, strict=True)}
    if unknown := [t for t in targets.values() if isinstance(t, str) and t not in NAMED]:
        raise ValueError(f"a marker sits on {unknown[0][:40]!r}, expected a vertex, a joint or a marker's name")
    if arrays["marker_places"].shape != (len(arrays["points"]), len(targets), 3):
        raise ValueError(f"marker_places has the shape {arrays['marker_places'].shape}")
    return MarkerSet(targets, float(arrays["marker_radius"]))


def of_body(body: BodyModel) -> BodyOf:
    """The stored description of a reference's body."""
    return BodyOf(kind=body.kind, gender=body.gender, hash=body.hash)
