"""Sequences of the suite, fitted and measured; what is done stays in a folder and is not done again."""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from multiprocessing import get_context
from pathlib import Path
from typing import TypeVar

import msgspec
import numpy as np
import torch

from evaluation.synthetic.suite import SEQUENCES, SuiteClip, make_sequence
from fitting_core.body.files.reading import load_body
from fitting_core.body.files.registry import find_body
from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.clip import Clip
from fitting_core.config.schema import PRESETS, FitConfig, without_collisions
from fitting_core.config.toml import as_plain
from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.fit.fitting import fit_clip
from fitting_core.fit.fused import ready
from fitting_core.io.result_files import SUMMARY_NAME, read_fit, write_result
from fitting_core.io.summary import versions
from fitting_core.io.truth import Truth
from fitting_core.measure.comparison import Comparison, compare
from fitting_core.measure.pairing import PosedMotion
from fitting_core.measure.records import BASELINE, Record
from fitting_core.measure.references.bodies import reference_of
from fitting_core.measure.references.reference import Reference
from fitting_core.results.fit_result import FitResult
from fitting_core.shipped import FREE_FOLDER, LIFTER

PHASE_1 = ", phase 1"
"""Ends the names of methods' first phases."""
MEASURES = 2
"""To be raised whenever figures are measured differently: then stored fits are measured again."""
Task = TypeVar("Task")
Done = TypeVar("Done")
_RECORDS = "records.json"
_FIT_KEY = "fit.key"


@dataclass(frozen=True, kw_only=True)
class SuiteTask:
    """One sequence to be fitted in one way."""

    sequence: str
    variant: str
    """Name of the way of fitting; its records are named after it."""
    config: FitConfig
    folder: Path
    """Where the fit and its measures stay."""
    every: int = 1


class _Stored(msgspec.Struct, frozen=True, kw_only=True):
    key: str
    records: tuple[Record, ...]


def sequences_named(names: Sequence[str]) -> list[str]:
    """Sequences of the suite by name or motion; all without any.

    Raises:
        InputError: One is neither.
    """
    chosen: list[str] = []
    for name in names:
        found = [own for own, sequence in SEQUENCES.items() if name in (own, sequence.motion)]
        if not found:
            motions = ", ".join(dict.fromkeys(sequence.motion for sequence in SEQUENCES.values()))
            raise InputError(
                f"--sequences: the suite has no {name}; expected {', '.join(SEQUENCES)}, or a motion ({motions})."
            )
        chosen += found
    return list(dict.fromkeys(chosen)) or list(SEQUENCES)


def preset_tasks(
    folder: Path, presets: Sequence[str], sequences: Sequence[str], *, every: int, collisions: bool = True
) -> list[SuiteTask]:
    """A task for each sequence and preset; of SMPLify-X only phase 1, as it fits single images.

    Without `collisions` no preset has the term of self-collision.

    Raises:
        InputError: There is no such preset.
    """
    if unknown := [name for name in presets if name not in PRESETS]:
        raise InputError(f"--presets: there is no {unknown[0]}; expected some of {', '.join(PRESETS)}.")
    return [
        SuiteTask(
            sequence=sequence,
            variant=preset,
            config=_config(preset, collisions=collisions),
            folder=folder / "fits" / preset / sequence,
            every=every,
        )
        for sequence in sequences
        for preset in presets
    ]


def _config(preset: str, *, collisions: bool) -> FitConfig:
    config = PRESETS[preset] if collisions else without_collisions(PRESETS[preset])
    return replace(config, last_phase=1) if preset == "smplifyx" else config


def done_tasks(do: Callable[[Task], Done], tasks: Sequence[Task], *, jobs: int) -> Iterator[tuple[Task, Done]]:
    """Do tasks, several at once if there are several jobs; yields each as it is done."""
    if jobs == 1 or len(tasks) < 2:
        for task in tasks:
            yield task, do(task)
        return
    # Spawned, not forked: torch's threads do not survive a fork.
    with ProcessPoolExecutor(min(jobs, len(tasks)), mp_context=get_context("spawn")) as pool:
        waiting = {pool.submit(do, task): task for task in tasks}
        try:
            for done in as_completed(waiting):
                yield waiting[done], done.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def run_task(task: SuiteTask) -> tuple[Record, ...]:
    """The records of a task: from its folder if it was done with the same settings, else fitted and measured now."""
    torch.set_num_threads(1)
    ready.use(threads=1)
    made, body = make_sequence(SEQUENCES[task.sequence]), fitted_body()
    key = fit_key(task.config, made.clip, made.truth, body)
    measured_key = f"{key} {task.every} {MEASURES}"
    if (stored := _stored(task.folder / _RECORDS)) is not None and stored.key == measured_key:
        return stored.records
    keep_fit(task.folder, key, lambda: fit_clip(made.clip, body, task.config), made.clip, body)
    records = _measured(task, made, body)
    content = msgspec.json.encode(_Stored(key=measured_key, records=records))
    with replacing(task.folder / _RECORDS) as draft:
        draft.write_bytes(content)
    return records


@lru_cache(maxsize=1)
def fitted_body() -> BodyModel:
    """The free neutral body: who is filmed is not known to a fit."""
    return load_body(find_body(search=FREE_FOLDER))


def fit_key(config: FitConfig, clip: Clip, truth: Truth, body: BodyModel) -> str:
    """Stands for all that a fit depends on: settings, detections, truth, body, lifter, and the packages' versions."""
    digest = hashlib.sha256(msgspec.json.encode([as_plain(config), versions(), body.hash, truth.body_hash]))
    digest.update(LIFTER.read_bytes())
    for array in (clip.keypoints.xy, clip.keypoints.confidence):
        digest.update(np.ascontiguousarray(array).tobytes())
    for f in fields(BodyParams):
        digest.update(getattr(truth.params, f.name).numpy().tobytes())
    return digest.hexdigest()


def method_names(task: SuiteTask, last_phase: int) -> tuple[str, str | None]:
    """What phase 1 and the final result of a task are called; None: there is only phase 1."""
    if last_phase == 1:
        return (BASELINE if task.variant == "smplifyx" else f"{task.variant}{PHASE_1}"), None
    return f"{task.variant}{PHASE_1}", task.variant


def keep_fit(folder: Path, key: str, fit: Callable[[], FitResult], clip: Clip, body: BodyModel) -> None:
    """Fit, and keep the result in a folder, unless it has a fit that the same key stands for."""
    kept = folder / _FIT_KEY
    if not kept.is_file() or kept.read_text() != key:
        write_result(folder, fit(), clip, body)
        with replacing(kept) as draft:
            draft.write_text(key)


def _measured(task: SuiteTask, made: SuiteClip, body: BodyModel) -> tuple[Record, ...]:
    found, truth = read_fit(task.folder), made.truth
    reference = reference_of(
        task.sequence, "truth of the suite", made.body, truth.params, frame_rate=truth.frame_rate, in_camera=True
    )
    seconds = fit_seconds(task.folder)
    first, final = method_names(task, found.last_phase)
    phases = [(first, found.phase1, seconds["phase1"])]
    if final is not None:
        phases.append((final, found.params, seconds["total"]))
    return tuple(
        Record(
            sequence=task.sequence,
            motion=made.sequence.motion,
            method=method,
            frames=len(params),
            frame_rate=found.frame_rate,
            seconds=spent,
            comparison=_compared(task, made, body, reference, params),
        )
        for method, params, spent in phases
    )


def _compared(
    task: SuiteTask, made: SuiteClip, body: BodyModel, reference: Reference, params: BodyParams
) -> Comparison:
    estimate = PosedMotion(
        body=body, params=params, camera=made.clip.camera, frame_rate=made.clip.frame_rate, clip=made.clip
    )
    return compare(estimate, reference, truth_body=made.body, every=task.every)


def fit_seconds(folder: Path) -> dict[str, float]:
    """What each phase of a fit took, and all together, by its summary."""
    return msgspec.json.decode((folder / SUMMARY_NAME).read_bytes())["seconds"]


def _stored(path: Path) -> _Stored | None:
    """What was measured before; None if nothing was, or an older version wrote it."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=_Stored)
    except (FileNotFoundError, msgspec.DecodeError):
        return None
