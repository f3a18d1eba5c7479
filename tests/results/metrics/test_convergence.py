"""Convergence times as metrics, against the runs one by one."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.results.evaluate import evaluate

FINE, COARSE = {"imu": "fine"}, {"imu": "coarse"}


def case_of(tables, levels):
    return next(digest for digest, mine in tables.levels.items() if mine == levels)


def test_a_convergence_time_is_that_after_which_a_run_stays_below_the_limit(good):
    case = next(digest for digest, levels in good.levels.items() if levels == FINE)
    events = good.events[(good.events.case == case) & (good.events.kind == "event")].sort_values("t_s")
    runs = good.runs[good.runs.case == case]
    names = [name for name in runs.columns if name.startswith("velocity_") and name.endswith("_error_m_per_s")]
    end, times = float(events.t_s.iloc[-1]), []
    for _, run in runs.groupby("run_number"):
        flown = run.set_index("event").loc[list(events.event)]
        above = ~((np.sqrt((flown[names] ** 2).sum(axis=1)) < 0.25) & (flown.failure == ""))
        after = np.flatnonzero(above.to_numpy())
        later = [*events.t_s, end]
        times.append(later[after[-1] + 1] if len(after) else later[0])
    first, last = events.event.iloc[0], events.event.iloc[-1]
    term = {"metric": "velocity_convergence_time", "during": f"{first} to {last}", "below": "0.25 m/s", "case": FINE}
    found = evaluate(good, case, term, "s")
    assert found.monte_carlo == pytest.approx(np.median(times) - float(events.t_s.iloc[0]))
    assert len(set(times)) > 1
    assert evaluate(good, case, term, "min").monte_carlo == pytest.approx(found.monte_carlo / 60.0)


def test_a_limit_in_rms_is_the_root_mean_square_of_another_case(good):
    """The coarse case is three times the fine one at every event: above it times 2.9, below it times 3.1."""
    term = {"metric": "velocity_convergence_time", "during": "liftoff to injection", "sigma_of": FINE, "case": COARSE}
    small, large = (evaluate(good, case_of(good, COARSE), term | {"below": f"{n} rms"}, "s") for n in ("2.9", "3.1"))
    assert (small.true, large.true) == (99.5, 0.0)
    by_size = evaluate(good, case_of(good, COARSE), term | {"below": "1e7 m/s", "sigma_of": None}, "s")
    assert np.isnan(by_size.true)
    assert by_size.monte_carlo == 0.0
    assert evaluate(good, case_of(good, COARSE), term | {"below": "1e9 sigma"}, "s").monte_carlo == 0.0
