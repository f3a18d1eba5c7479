"""Worker processes: work items are given to them one by one, results are taken as they come."""

import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from joblib import Parallel, delayed, parallel_config
from joblib.externals.loky import process_executor, reusable_executor
from joblib.externals.loky.backend.utils import kill_process_tree
from joblib.externals.loky.process_executor import TerminatedWorkerError

from lvnav_trade.campaign.running import work
from lvnav_trade.interrupts import raise_if_interrupted


class WorkList:
    """The units of a stage, taken one by one, each open until its result is in."""

    def __init__(self, units: Iterable[tuple[Any, ...]]) -> None:
        self._coming = enumerate(units)
        self._open: dict[int, tuple[Any, ...]] = {}
        self._taking = threading.Lock()  # a pool that ends may still take units while the next one does
        self._ended = False

    def open(self) -> Iterator[tuple[int, tuple[Any, ...]]]:
        """Yield (number, unit): first those that were taken and never done, then new ones."""
        yield from list(self._open.items())
        while True:
            with self._taking:
                taken = next(self._coming, None)
                if taken is None:
                    self._ended = True
                    return
                self._open[taken[0]] = taken[1]
            yield taken

    def close(self, number: int) -> None:
        """Take the result of a unit as in."""
        self._open.pop(number, None)

    def is_done(self) -> bool:
        """Whether all results are in."""
        return self._ended and not self._open


def numbered(function: Callable[..., Any], number: int, unit: tuple[Any, ...]) -> tuple[int, Any]:
    """Return the number of a work item, and its result."""
    return number, function(*unit)


_LONGEST_END = 20.0  # s for workers to end
_UNORDERED = {"return_as": "generator_unordered", "batch_size": 1, "pre_dispatch": "2 * n_jobs"}
# What loky says where it replaces a worker whose memory has grown by 300 MB, as with compiled code and tables of a case
_REPLACED = "A worker stopped while some jobs were given to the executor"
_on_cluster: list[type[Exception]] = []  # while a cluster does the work: what it raises where its workers die


@contextmanager
def on_dask(client: Any) -> Iterator[None]:
    """Let `each` hand its units to the workers of a cluster, through a client of Dask."""
    from distributed import KilledWorker

    with parallel_config(backend="dask", client=client):
        _on_cluster.append(KilledWorker)
        try:
            yield
        finally:
            _on_cluster.pop()


def each(jobs: int, function: Callable[..., Any], units: Iterable[tuple[Any, ...]], ordered: bool = False) -> Any:
    """Return function(*unit) of all units in their order, else a generator of them in the order in which the workers
    finish; in this process for one job, unless a cluster does the work.
    """
    if jobs == 1 and not _on_cluster:
        return _one_by_one(function, units)
    warnings.filterwarnings("ignore", _REPLACED, UserWarning)
    # Arrays are sent as they are: of the files that joblib makes of large ones, some outlive a worker that is killed
    how: dict[str, Any] = {} if _on_cluster else {"initializer": work.begin_worker, "max_nbytes": None}
    found = Parallel(n_jobs=jobs, **how, **({} if ordered else _UNORDERED))(
        delayed(_worked)(function, *unit) for unit in units
    )
    return _watched(found) if _on_cluster and not ordered else found


def _one_by_one(function: Callable[..., Any], units: Iterable[tuple[Any, ...]]) -> Iterator[Any]:
    for unit in units:
        found = function(*unit)
        raise_if_interrupted()
        yield found


def _watched(found: Any) -> Iterator[Any]:
    """Yield results; where a cluster gives a unit up, its workers having died, it is as with those of this machine."""
    try:
        yield from found
    except tuple(_on_cluster) as error:
        raise TerminatedWorkerError(str(error)) from error


def _worked(function: Callable[..., Any], *unit: Any) -> Any:
    work.begin_worker()
    return function(*unit)


def end_workers(jobs: int) -> None:
    """End the worker processes of this machine at once; what they have stored is whole."""
    if jobs > 1 and not _on_cluster and (executor := reusable_executor._executor) is not None:
        reusable_executor._executor = None  # the next pool waits for nothing of this one
        _end(executor)


def _end(executor: Any) -> None:
    """End an executor within twice `_LONGEST_END`.

    The thread that manages its workers waits for ever where one of them died with the lock that they share. The workers
    are then killed here, and the lock is given back: nobody is left who could.
    """
    manager, workers = executor._executor_manager_thread, list((executor._processes or {}).values())
    ending = threading.Thread(target=executor.shutdown, kwargs={"wait": False, "kill_workers": True}, daemon=True)
    ending.start()
    until = time.monotonic() + _LONGEST_END
    ending.join(_LONGEST_END)
    if manager is None:
        return
    manager.join(max(0.0, until - time.monotonic()))
    if manager.is_alive():
        for worker in workers:
            with suppress(OSError):  # gone already
                kill_process_tree(worker)
        with suppress(ValueError):  # nobody has it
            manager.processes_management_lock.release()
        manager.join(_LONGEST_END)
    process_executor._threads_wakeups.pop(manager, None)  # what would wait for it when this process ends
