"""Fits clips on a Ray cluster. The only import of ray, which is an extra: pip install tcfit[ray]."""

import logging
import os
import socket
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fitting_core.errors import InputError
from tcfit_app.batch.clip_fit import failure, fit_clip, one_thread
from tcfit_app.batch.inputs import inputs_of
from tcfit_app.batch.local import News, TaskEnded, TaskUnderway
from tcfit_app.batch.manifest import ClipTask
from tcfit_app.batch.records import Record

LOCAL = "local"
"""The address that starts a Ray on this computer."""
_PATIENCE = 5.0
"""Seconds to wait for a cluster's answer."""
_AHEAD = 2
"""Tasks that are handed to Ray for each of the cluster's cores."""


class RayCluster:
    """A Ray cluster whose nodes have tcfit and see the same files under the same paths.

    Args:
        address: As Ray has it; None: the cluster that Ray finds here; "local": one that lives as long as the batch.
        jobs: Most clips at a time; None: as many as the cluster has cores.
    """

    def __init__(self, address: str | None, jobs: int | None) -> None:
        self.address, self.jobs = address, jobs

    def run(self, tasks: Sequence[ClipTask], folder: Path) -> Generator[News, None, None]:
        """See `Crew.run`. Ray ends what runs for a driver that has died."""
        with _connected(self.address, self.jobs) as ray:
            fit = ray.remote(num_cpus=1, max_retries=1)(_fit)
            room = self.jobs or _AHEAD * max(1, int(ray.cluster_resources().get("CPU", 1)))
            waiting, under_way = list(enumerate(tasks))[::-1], {}
            while waiting or under_way:
                while waiting and len(under_way) < room:
                    index, task = waiting.pop()
                    gpus = int(task.config.device.startswith("cuda"))
                    under_way[fit.options(num_gpus=gpus).remote(task, folder)] = index
                    yield TaskUnderway(index=index)
                for ready in ray.wait(list(under_way), num_returns=1)[0]:
                    index = under_way.pop(ready)
                    yield TaskEnded(index=index, record=_record(ray, ready, tasks[index]))


def _fit(task: ClipTask, folder: Path) -> Record:
    one_thread()
    return fit_clip(task, folder)


def _record(ray: Any, ready: Any, task: ClipTask) -> Record:
    try:
        return ray.get(ready)
    except ray.exceptions.RayError as error:
        reason = f"Ray could not fit it ({str(error).splitlines()[0]}). Does every node have tcfit and see the files?"
        return failure(inputs_of(task), reason, trace=str(error))


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
