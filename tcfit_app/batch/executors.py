"""What fits the clips of a batch: processes of this computer, or a Ray cluster, in whose code alone ray is imported."""

import logging
import os
import socket
from collections.abc import Generator, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import partial
from typing import Any

from fitting_core.errors import InputError
from tcfit_app.batch.clip_fit import fit_clip
from tcfit_app.batch.manifest import ClipTask
from tcfit_app.batch.outcome import ClipOutcome, failure
from tcfit_app.fitting.process_queue import Ended, ProcessQueue, Work

_TRIES = 2
"""How often a clip's process may die: the first time may not be its fault, as when memory runs out."""
News = Generator[tuple[int, Work | ClipOutcome], None, None]
"""Of a task, by its index: its progress, and its end."""


def fitted_here(tasks: Sequence[ClipTask], jobs: int) -> News:
    """Fit clips in processes of this computer, `jobs` at a time; each ends exactly once. Closing the generator stops at
    once and leaves nothing half-done that matters."""
    with closing(ProcessQueue(processes=jobs, tries=_TRIES)) as processes:
        for index, task in enumerate(tasks):
            processes.add(index, partial(fit_clip, task))
        while processes.busy:
            for index, news in processes.news():
                if isinstance(news, Ended):
                    yield index, news.result or _died(tasks[index], news.died)
                else:
                    yield index, news


def _died(task: ClipTask, how: str) -> ClipOutcome:
    advice = "Memory may have run out: try fewer --jobs, or shorter clips."
    return failure(task, f"Its process ended {how}, {_TRIES} times. {advice}")


# --- Ray, which is an extra: pip install tcfit[ray] ---

LOCAL = "local"
"""The address that starts a Ray on this computer."""
_PATIENCE = 5.0
"""Seconds to wait for a cluster's answer."""
_AHEAD = 2
"""Tasks that are handed to Ray for each of the cluster's cores."""


def fitted_by_ray(tasks: Sequence[ClipTask], address: str | None, jobs: int | None) -> News:
    """Fit clips on a Ray cluster, as `fitted_here`. Its nodes have tcfit and see the same files under the same paths;
    Ray ends what runs for a driver that has died.

    Args:
        tasks: The clips.
        address: As Ray has it; None: the cluster that Ray finds here; "local": one that lives as long as the batch.
        jobs: Most clips at a time; None: as many as the cluster has cores.
    """
    with _connected(address, jobs) as ray:
        fit = ray.remote(num_cpus=1, max_retries=1)(fit_clip)
        room = jobs or _AHEAD * max(1, int(ray.cluster_resources().get("CPU", 1)))
        waiting, under_way = list(enumerate(tasks))[::-1], {}
        while waiting or under_way:
            while waiting and len(under_way) < room:
                index, task = waiting.pop()
                gpus = int(task.config.device.startswith("cuda"))
                under_way[fit.options(num_gpus=gpus).remote(task)] = index
                yield index, Work(step="reading", share=0.0)
            for ready in ray.wait(list(under_way), num_returns=1)[0]:
                index = under_way.pop(ready)
                yield index, _outcome(ray, ready, tasks[index])


def _outcome(ray: Any, ready: Any, task: ClipTask) -> ClipOutcome:
    try:
        return ray.get(ready)
    except ray.exceptions.RayError as error:
        reason = f"Ray could not fit it ({str(error).splitlines()[0]}). Does every node have tcfit and see the files?"
        return failure(task, reason)


def _check_answers(address: str | None) -> None:
    """Ask first, as Ray itself tries for minutes to reach a computer that is not there."""
    host, _, port = (address or "").removeprefix("ray://").rpartition(":")
    if not (host and port.isdigit()):
        return
    try:
        socket.create_connection((host, int(port)), timeout=_PATIENCE).close()
    except OSError as error:
        raise _silent(address, error) from error


def _silent(address: str | None, error: Exception) -> InputError:
    reason = (str(error).splitlines() or [type(error).__name__])[0]
    return InputError(
        f"--ray {address or ''}: no cluster answers ({reason}). Start one by `ray start --head`, give its address, or "
        "--ray local to start one on this computer."
    )


@contextmanager
def _connected(address: str | None, jobs: int | None) -> Iterator[Any]:
    # Ray reports its usage by default; this matters only if it is started here.
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    try:
        import ray
        import ray.exceptions
    except ImportError as error:
        raise InputError(
            f"--ray: Ray cannot be imported ({error}). Install it with `pip install tcfit[ray]`, or leave --ray out to "
            "fit on this computer."
        ) from error
    _check_answers(address)
    here: dict[str, Any] = {"num_cpus": jobs, "include_dashboard": False} if address == LOCAL else {}
    try:
        ray.init(address=address or "auto", log_to_driver=False, logging_level=logging.ERROR, **here)
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise _silent(address, error) from error
    try:
        yield ray
    finally:
        ray.shutdown()
