import numpy as np
import pytest

from lvnav_trade.results.evaluation.convergence import convergence_times, parse_multiple
from tests import synthetic

FINE, COARSE = (case.id for case, _ in synthetic.CASES)


@pytest.mark.parametrize(
    ("text", "found"), [("3 sigma", (3.0, "sigma")), ("2.5 rms", (2.5, "rms")), ("3 m", None), ("1 mrad", None)]
)
def test_a_limit_is_a_size_or_a_multiple_of_a_sigma_or_of_a_root_mean_square(text, found):
    assert parse_multiple(text) == found


def test_a_run_has_converged_when_it_stays_below_to_the_end_of_the_phase(good):
    found = convergence_times(good, FINE, "velocity", (0.0, 99.5), "0.35 m/s")
    assert (found.n_event, found.length) == (3, 99.5)
    runs = good.runs[good.runs.case == FINE].set_index(["run_number", "event"])
    names = [f"velocity_{axis}_error_m_per_s" for axis in ("north", "east", "down")]
    for run in range(20):
        mine = runs.loc[run].loc[list(synthetic.EVENTS)]
        below = (np.linalg.norm(mine[names], axis=1) < 0.35) & (mine.failure == "")
        at_end = int(np.cumprod(below[::-1]).sum())
        assert found.times[run] == [*synthetic.EVENTS.values(), 99.5][3 - at_end]


def test_without_events_in_the_phase_nothing_is_known(good):
    assert convergence_times(good, FINE, "velocity", (41.0, 60.0), "1 m/s") is None


def test_a_sigma_has_no_mean_and_a_root_mean_square_has_it(good):
    history = good.history.assign(lincov_mean_si=10.0 * good.history.lincov_true_si)
    tables = good.with_frames(history=history)
    found = [convergence_times(tables, FINE, "position", (0.0, 99.5), limit, FINE) for limit in ("1.01 rms", "9 sigma")]
    assert [one.lincov_time for one in found] == [0.0, 99.5]


def test_limits_are_those_of_the_other_case_at_each_event(good):
    """The coarse case is three times the fine one."""
    far, near = (convergence_times(good, COARSE, "position", (0.0, 99.5), f"{n} rms", FINE) for n in (2.9, 3.1))
    assert (far.lincov_time, near.lincov_time) == (99.5, 0.0)
    assert far.times.mean() > near.times.mean()


def test_a_run_that_is_below_at_the_last_event_alone_has_converged_at_the_end_of_the_phase(good):
    """The phase ends with its last event: the time alone cannot tell such a run from one that never converges."""
    runs = good.runs.copy()
    names = [f"velocity_{axis}_error_m_per_s" for axis in ("north", "east", "down")]
    last = max(synthetic.EVENTS, key=synthetic.EVENTS.__getitem__)
    run = int(runs[(runs.case == FINE) & (runs.event == last) & (runs.failure == "")].run_number.iloc[-1])
    runs.loc[runs.case == FINE, names] = 9.0
    runs.loc[(runs.case == FINE) & (runs.event == last) & (runs.run_number == run), names] = 0.0
    end = synthetic.EVENTS[last]
    found = convergence_times(good.with_frames(runs=runs), FINE, "velocity", (0.0, end), "1 m/s")
    assert np.unique(found.times).tolist() == [end]
    assert np.flatnonzero(found.has_converged).tolist() == [run]
