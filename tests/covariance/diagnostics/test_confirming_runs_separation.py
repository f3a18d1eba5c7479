"""Alarms of solution separation: where they begin, which satellite they name, and in which runs."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.covariance.diagnostics.confirming_runs import add_alarms, add_nominal_alarms, alarms, separation_ratio
from lvnav_trade.covariance.diagnostics.protection import Protection, protection
from lvnav_trade.covariance.history import covariance
from lvnav_trade.quantities.records import OF_SEPARATION, ProtectionRisks
from lvnav_trade.simulation.montecarlo import run_block
from tests.covariance.diagnostics.test_protection import SEED, case, fault_of

RUNS, START = 64, 2.0
ASKED = ProtectionRisks(1e-3, 1e-3, 1.0, alarms=True)


def of_limits(limits):
    nothing = np.zeros((3, 2, 3))
    return Protection(np.arange(3.0), nothing, nothing, nothing, nothing, ("G01", "G02"), limits, 0.0 * limits, True)


def test_a_separation_is_compared_with_the_limit_of_its_own_axis_and_time():
    apart = np.zeros((2, 3, 2, 3))
    apart[1, 2, 0, 1], apart[0, 1, 1, 2] = -6.0, 1.0
    assert separation_ratio(apart, of_limits(np.full((2, 3, 2, 3), 4.0))) == pytest.approx(
        np.array([[0, 0.25, 0], [0, 0, 1.5]])
    )
    assert separation_ratio(np.full((2, 3, 2, 3), np.nan), of_limits(np.ones((2, 3, 2, 3)))).max() == 0.0


def test_an_alarm_is_logged_where_it_begins_or_names_another_satellite():
    ratio = np.zeros((2, 2, 6))
    ratio[0, 0] = [0.0, 1.2, 1.3, 1.1, 0.9, 1.5]
    ratio[0, 1] = [0.0, 0.0, 1.1, 1.4, 0.0, 0.0]
    found = alarms(ratio, np.arange(6.0), np.array([0.0, 7.0]), 40)
    assert found.tolist() == [[40.0, 1.0, OF_SEPARATION, 0.0], [40.0, 3.0, OF_SEPARATION, 7.0],
                              [40.0, 5.0, OF_SEPARATION, 0.0]]  # fmt: skip
    assert alarms(ratio[:, :0], np.arange(6.0), np.zeros(0), 0).shape == (0, 4)


def test_both_engines_name_the_failed_satellite_at_the_same_time_and_none_without_a_fault():
    failed = case(fault_of("60 m"))
    satellite = failed.scenario.faults[0].satellites[0]
    history, nominal = covariance(failed), covariance(case())
    found, silent = (protection(one, other, ASKED) for one, other in ((failed, history), (case(), nominal)))
    block = add_alarms(run_block(failed, SEED, 0, RUNS), failed, found, SEED)
    named = [failed.channel_names[int(channel)].split()[0] for channel in block.decisions[:, 3]]
    run, first = np.unique(block.decisions[:, 0], return_index=True)
    assert run.size == RUNS
    assert np.mean([named[at] == satellite for at in first]) > 0.9
    own = add_nominal_alarms(history, failed, found).decisions
    assert own[0, 1] == np.median(block.decisions[first, 1]) > START - 1e-9
    assert failed.channel_names[int(own[0, 3])].split()[0] == satellite
    assert not len(add_nominal_alarms(nominal, case(), silent).decisions)
    quiet = add_alarms(run_block(case(), SEED, 0, RUNS), case(), silent, SEED)
    assert np.unique(quiet.decisions[:, 0]).size <= 3  # of 64, at 1e-3 at any one time
    assert add_alarms(block, failed, found._replace(alarms=False), SEED) is block
