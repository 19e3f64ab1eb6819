"""Hands independent pieces of work to processes of this machine, or of a Dask cluster; results come in order.

Every piece runs on one BLAS thread wherever it runs: a sum split over threads rounds differently, and a result
must not depend on where it was computed. A cluster's worker that dies is no loss: the scheduler gives its work to
another.
"""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from importlib.metadata import version
from typing import Any, TypeVar

from drivers.base.errors import BenchError, ConfigurationError
from drivers.base.system import processors

Item = TypeVar("Item")
Result = TypeVar("Result")
LOCAL = "local"
_ANSWER_S = 10.0
_SCHEMES, _PORT = ("tcp", "tls", "ws", "wss"), 8786
_AHEAD = 4
"""Pieces handed out ahead, for every processor."""


class FanOut:
    """Where work goes; made by `fan_out`, or `ALONE`: this process."""

    def __init__(self, jobs: int = 1, client: Any = None) -> None:
        self._jobs, self._client = jobs, client

    @property
    def jobs(self) -> int:
        """How many pieces run at the same time."""
        return self._jobs if self._client is None else max(1, sum(self._client.ncores().values()))

    def each(self, function: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """Yield `function` of every item, in the items' order. What it raises is raised here.

        Function, items and results travel between processes. BenchError if a cluster lost its workers.
        """
        if self._jobs == 1 and self._client is None:
            return (_one(function, (item,)) for item in items)
        return self._elsewhere(function, items)

    def map(self, function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
        """Return `function` of every item, in order."""
        return list(self.each(function, items))

    def _elsewhere(self, function: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        import joblib

        # In a tuple: joblib would place large arguments on one worker, whose death would then lose them.
        calls = (joblib.delayed(partial(_one, function))((item,)) for item in items)
        backend = {"backend": "loky"} if self._client is None else {"backend": _backend(self._client)}
        with joblib.parallel_config(**backend, n_jobs=self._jobs if self._client is None else -1):
            work = joblib.Parallel(return_as="generator", batch_size=1, pre_dispatch=f"{_AHEAD}*n_jobs")
            results = work(calls)
        try:
            yield from results
        except Exception as error:
            if type(error).__name__ in ("KilledWorker", "CommClosedError", "FutureCancelledError"):
                raise BenchError(
                    "the cluster did not finish the work",
                    found=f"{type(error).__name__}: {error}",
                    expected="workers that live, or another that takes over",
                    remedy="look into the workers' logs: work that kills every worker needs more memory",
                ) from error
            raise
        finally:
            results.close()


ALONE = FanOut()
"""In this process, one piece after the other."""


@contextmanager
def fan_out(jobs: int | None = None, cluster: str | None = None) -> Iterator[FanOut]:
    """Open a fan-out: `jobs` processes of this machine (default 1), or the workers of a Dask `cluster`.

    `cluster` is "local" (a cluster of `jobs` workers, default one a processor, for as long as this lasts) or a
    scheduler's address such as tcp://10.0.0.5:8786. ConfigurationError for an address that does not answer, has
    no workers, or has workers with another version of gyrobench.
    """
    if jobs is not None and jobs < 1:
        raise ConfigurationError(
            "no processes to work in", where="--jobs", found=str(jobs), expected="at least 1"
        )
    if cluster is None:
        yield FanOut(jobs or 1)
        return
    with _connected(cluster, jobs) as client:
        _check_workers(client, cluster)
        yield FanOut(client=client)


@contextmanager
def _connected(cluster: str, jobs: int | None) -> Iterator[Any]:
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise ConfigurationError(
            "no cluster without Dask",
            where="--cluster",
            found=str(error),
            remedy="pip install 'gyrobench[scale]'",
        ) from error
    if cluster == LOCAL:
        workers = jobs or processors()
        with (
            # the profiler of workers keeps an hour of call trees, hundreds of MiB each
            dask.config.set({"distributed.worker.profile.enabled": False}),
            LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as own,
            Client(own, set_as_default=False) as client,
        ):
            yield client
        return
    try:
        _knock(cluster)
        client = Client(cluster, timeout=_ANSWER_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise ConfigurationError(
            "no Dask scheduler answers",
            where="--cluster",
            found=f"{cluster}: {error or type(error).__name__}",
            expected="local, or an address such as tcp://10.0.0.5:8786",
            remedy="`dask scheduler` and `dask worker` start a cluster; docs/scale.md",
        ) from error
    with client:
        yield client


def _knock(cluster: str) -> None:
    """Raise OSError or ValueError for an address where nothing listens: a Client of it may never be closed."""
    from distributed.comm.addressing import parse_address, parse_host_port

    scheme, place = parse_address(cluster)
    if scheme not in _SCHEMES:
        raise ValueError(f"{scheme}:// is no scheme of Dask, {', '.join(_SCHEMES)} are")
    socket.create_connection(parse_host_port(place, _PORT), timeout=_ANSWER_S).close()


def _check_workers(client: Any, cluster: str) -> None:
    try:
        client.wait_for_workers(1, timeout=_ANSWER_S)
        found = set(client.run(_software).values())
    except Exception as error:  # whatever a worker without our code answers
        raise ConfigurationError(
            "the cluster has no worker that can take work",
            where=f"--cluster {cluster}",
            found=f"{type(error).__name__}: {error}",
            expected="workers with gyrobench installed",
            remedy="start `dask worker` from an environment with gyrobench",
        ) from error
    if found != {_software()}:
        raise ConfigurationError(
            "workers run another version: results would differ",
            where=f"--cluster {cluster}",
            found=", ".join(sorted(found)),
            expected=_software(),
        )


def _software() -> str:
    return ", ".join(f"{name} {version(name)}" for name in ("gyrobench", "numpy", "scipy", "torch"))


def _backend(client: Any) -> Any:
    from joblib._dask import DaskDistributedBackend

    class Cluster(DaskDistributedBackend):  # type: ignore[misc]
        """joblib would run the work here if the cluster has but one processor."""

        def effective_n_jobs(self, n_jobs: int) -> int:
            return max(2, int(super().effective_n_jobs(n_jobs)))

    return Cluster(client=client)


def _one(function: Callable[[Item], Result], packed: tuple[Item]) -> Result:
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1, user_api="blas"):
        return function(packed[0])
