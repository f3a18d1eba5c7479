"""Units of work: all are done, each result is taken once, and what was open when workers died is done again."""

from __future__ import annotations

import inspect
import os
import re
import threading
import warnings

import pytest
from joblib.externals.loky import get_reusable_executor, process_executor
from joblib.externals.loky.process_executor import TerminatedWorkerError

from lvnav_trade.campaign.running import pool


def process_executor_says() -> str:
    """Return what loky says where it replaces a worker, from its source."""
    source = re.sub(r'"\s*\n\s*"', "", inspect.getsource(process_executor))
    (text,) = re.findall(r'"(A worker stopped [^"]*)"', source)
    return str(text)


def test_one_job_works_in_this_process_and_several_in_others() -> None:
    assert list(pool.map_items(1, os.getpid, [(), ()])) == [os.getpid()] * 2
    try:
        with warnings.catch_warnings(record=True) as said:
            assert os.getpid() not in pool.map_items(2, os.getpid, [(), ()], is_ordered=True)
            for text in (process_executor_says(), "another thing"):
                warnings.warn(text, UserWarning, stacklevel=1)
        assert [str(one.message) for one in said] == ["another thing"]
    finally:
        pool.end_workers(2)


def test_workers_end_in_time_though_one_died_with_a_lock_of_theirs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pool, "_LONGEST_END", 0.5)
    executor = get_reusable_executor(max_workers=2)
    list(executor.map(abs, [1, 2]))
    manager, workers = executor._executor_manager_thread, list(executor._processes.values())
    executor._processes_management_lock.acquire()  # as by a worker that is killed while it ends
    ending = threading.Thread(target=pool.end_workers, args=(2,), daemon=True)
    ending.start()
    ending.join(20.0)
    assert not ending.is_alive()
    assert not manager.is_alive()  # which this process would wait for when it ends
    for worker in workers:
        worker.join(10.0)
    assert not any(worker.is_alive() for worker in workers)
    assert get_reusable_executor(max_workers=2) is not executor
    pool.end_workers(2)


def test_units_whose_results_are_not_in_are_given_out_again_first() -> None:
    found = pool.WorkList([("a",), ("b",), ("c",)])
    taken = found.open()
    assert [next(taken), next(taken)] == [(0, ("a",)), (1, ("b",))]
    found.close(1)
    again = found.open()
    assert list(again) == [(0, ("a",)), (2, ("c",))]
    assert not found.is_done()
    found.close(0)
    found.close(2)
    assert found.is_done()


def test_a_cluster_that_gives_a_unit_up_is_a_pool_whose_worker_died(monkeypatch: pytest.MonkeyPatch) -> None:
    class GivenUp(Exception):
        pass

    def units():
        yield 1
        raise GivenUp("b was tried three times")

    monkeypatch.setattr(pool, "_cluster_errors", [GivenUp])
    found = pool._cluster_results(units())
    assert next(found) == 1
    with pytest.raises(TerminatedWorkerError, match="b was tried three times"):
        next(found)
