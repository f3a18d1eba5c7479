"""Worker processes: they receive work items one at a time, and results are collected in order of completion."""

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

from lvnav_trade.campaign.interrupts import raise_if_interrupted
from lvnav_trade.campaign.running import work


class WorkList:
    """Work items of a stage; an item is open from its start until its result arrives."""

    def __init__(self, items: Iterable[tuple[Any, ...]]) -> None:
        self._items = enumerate(items)
        self._open: dict[int, tuple[Any, ...]] = {}
        self._lock = threading.Lock()  # a pool that is ending may still take items while the next pool takes them
        self._ended = False

    def open(self) -> Iterator[tuple[int, tuple[Any, ...]]]:
        """Yield number and arguments of items: first those started without a result, then new items."""
        yield from list(self._open.items())
        while True:
            with self._lock:
                item = next(self._items, None)
                if item is None:
                    self._ended = True
                    return
                self._open[item[0]] = item[1]
            yield item

    def close(self, number: int) -> None:
        """Record that the result of an item has arrived."""
        self._open.pop(number, None)

    def is_done(self) -> bool:
        """Whether the results of all items have arrived."""
        return self._ended and not self._open


def numbered_result(function: Callable[..., Any], number: int, item: tuple[Any, ...]) -> tuple[int, Any]:
    """Return the number of a work item, and its result."""
    return number, function(*item)


_LONGEST_END = 20.0  # s, longest wait for workers to end
_UNORDERED = {"return_as": "generator_unordered", "batch_size": 1, "pre_dispatch": "2 * n_jobs"}
# Warning of loky when it replaces a worker whose memory has grown by 300 MB, which compiled code and tables may need
_REPLACED = "A worker stopped while some jobs were given to the executor"
# Warning of joblib where an error in one case ends a stage: the error is reported, the other cases are not needed
_CANCELLED = r"\d+ tasks which were still being processed by the workers have been cancelled"
_cluster_errors: list[type[Exception]] = []  # not empty while a cluster is in use: its exception for workers that die


@contextmanager
def dask_workers(client: Any) -> Iterator[None]:
    """Make `map_items` use the workers of a Dask cluster, within a ``with`` block."""
    from distributed import KilledWorker

    with parallel_config(backend="dask", client=client):
        _cluster_errors.append(KilledWorker)
        try:
            yield
        finally:
            _cluster_errors.pop()


def map_items(
    jobs: int, function: Callable[..., Any], items: Iterable[tuple[Any, ...]], is_ordered: bool = False
) -> Any:
    """Call a function for every work item, by worker processes or a cluster.

    With one job and no cluster the calls are made in this process.

    Parameters
    ----------
    jobs : int
        Number of worker processes.
    function : callable
        Function to call.
    items : iterable of tuple
        Arguments of each call.
    is_ordered : bool
        Wait for all results and return them in the order of the items.

    Returns
    -------
    list or iterator
        Results in the order of the items if `is_ordered`, otherwise an iterator in the order of completion.
    """
    if jobs == 1 and not _cluster_errors:
        return _serial_results(function, items)
    for message in (_REPLACED, _CANCELLED):
        warnings.filterwarnings("ignore", message, UserWarning)
    # Arrays are sent directly: joblib would write large arrays to files, of which some remain when a worker is killed
    options: dict[str, Any] = {} if _cluster_errors else {"initializer": work.begin_worker, "max_nbytes": None}
    results = Parallel(n_jobs=jobs, **options, **({} if is_ordered else _UNORDERED))(
        delayed(_call)(function, *item) for item in items
    )
    return _cluster_results(results) if _cluster_errors and not is_ordered else results


def _serial_results(function: Callable[..., Any], items: Iterable[tuple[Any, ...]]) -> Iterator[Any]:
    for item in items:
        result = function(*item)
        raise_if_interrupted()
        yield result


def _cluster_results(results: Any) -> Iterator[Any]:
    """Yield results; dead workers of a cluster raise the same exception as dead workers of this machine."""
    try:
        yield from results
    except tuple(_cluster_errors) as error:
        raise TerminatedWorkerError(str(error)) from error


def _call(function: Callable[..., Any], *item: Any) -> Any:
    work.begin_worker()
    return function(*item)


def end_workers(jobs: int) -> None:
    """End the worker processes of this machine at once; files that they have stored are complete."""
    if jobs > 1 and not _cluster_errors and (executor := reusable_executor._executor) is not None:
        reusable_executor._executor = None  # so that the next pool does not wait for this one
        _end(executor)


def _end(executor: Any) -> None:
    """End an executor within twice `_LONGEST_END`.

    If a worker died while it had the lock shared by all workers, the thread that manages them waits forever. In this
    case the workers are killed and the lock is released here, because no other process can release it.
    """
    manager, workers = executor._executor_manager_thread, list((executor._processes or {}).values())
    ending = threading.Thread(target=executor.shutdown, kwargs={"wait": False, "kill_workers": True}, daemon=True)
    ending.start()
    end_time = time.monotonic() + _LONGEST_END
    ending.join(_LONGEST_END)
    if manager is None:
        return
    manager.join(max(0.0, end_time - time.monotonic()))
    if manager.is_alive():
        for worker in workers:
            with suppress(OSError):  # it has ended meanwhile
                kill_process_tree(worker)
        with suppress(ValueError):  # no process has the lock
            manager.processes_management_lock.release()
        manager.join(_LONGEST_END)
    process_executor._threads_wakeups.pop(manager, None)  # otherwise loky waits for this thread when the process ends
