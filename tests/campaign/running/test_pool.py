"""Units of work: all are done, each result is taken once, and what was open when workers died is done again."""

from __future__ import annotations

import pytest
from joblib.externals.loky.process_executor import TerminatedWorkerError

from lvnav_trade.campaign.running import pool


def test_one_job_works_in_this_process_and_several_in_others() -> None:
    import os

    assert list(pool.each(1, os.getpid, [(), ()])) == [os.getpid()] * 2
    try:
        assert os.getpid() not in pool.each(2, os.getpid, [(), ()], ordered=True)
    finally:
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

    monkeypatch.setattr(pool, "_on_cluster", [GivenUp])
    found = pool._watched(units())
    assert next(found) == 1
    with pytest.raises(TerminatedWorkerError, match="b was tried three times"):
        next(found)
