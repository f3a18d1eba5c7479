"""The self-check of a configuration: it passes where all is well, whatever is measured."""

from __future__ import annotations

import pytest

from lvnav_trade.covariance.selfcheck.case_checks import check_prepared
from lvnav_trade.covariance.selfcheck.check import set_bounds
from tests.both_engines.combinations import scenario_of
from tests.both_engines.covering import DIMENSIONS
from tests.both_engines.short_flights import flight
from tests.building import prepare_hop
from tests.covariance.diagnostics.checked import SEED, failed, rich

FIRST = {name: next(iter(levels)) for name, levels in DIMENSIONS.items()}


@pytest.fixture(scope="module")
def checks():
    return set_bounds(check_prepared(rich(), SEED))


def test_a_sound_configuration_passes_every_check(checks):
    assert failed(checks) == []
    assert {check.check_type for check in checks} == {
        "error definition",
        "Jacobian",
        "propagation",
        "innovations",
        "draws",
    }


def test_each_quantity_measurement_and_source_has_its_checks(checks):
    of = {
        kind: {check.quantity for check in checks if check.check_type == kind}
        for kind in ("error definition", "Jacobian")
    }
    assert of["error definition"] >= {"attitude", "velocity", "position", "gyro_bias", "clock_bias", "range_bias"}
    assert of["Jacobian"] == {"pseudorange", "range_rate"}
    drawn = {check.quantity.partition(",")[0] for check in checks if check.check_type == "draws"}
    assert drawn >= {"gyro bias instability", "accelerometer rate random walk", "gyro random walk", "multipath",
                     "pseudorange noise", "step of clock drift", "initial heading"}  # fmt: skip
    assert "refused by the gate" in {check.quantity for check in checks}


def test_the_same_seed_gives_the_same_figures(checks):
    again = set_bounds(check_prepared(rich(), SEED))
    assert [check.figure for check in again] == [check.figure for check in checks]


LEVELS = [
    pytest.param(  # its kernels take a minute to compile
        {"measurements": "ranges, star tracker", "states": "of sensors", "latency": "buffered"}, marks=pytest.mark.slow
    ),
    {"measurements": "none", "vehicle": "spinning"},
]


@pytest.mark.parametrize("levels", LEVELS, ids=str)
def test_it_passes_whatever_is_measured_and_whatever_the_policy(levels):
    scenario, kind, _ = scenario_of(FIRST | levels)
    checks = check_prepared(prepare_hop(scenario, flight(kind)), SEED)
    assert failed(check for check in checks if check.check_type != "propagation") == []
