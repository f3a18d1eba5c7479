"""The rules in numbers, and which samples pass the checks at the input."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.quantities.records import REASONS
from lvnav_trade.simulation.preparation.mode_rules import failed_checks, mode_rules_of, used_satellite_count
from tests.building import LOOSE, case, loaded, prepare_hop, with_fields


def test_a_card_without_logic_has_no_rules_and_its_signals_stay():
    prepared_case = case(LOOSE)
    assert prepared_case.options.rules is None
    assert case().options.rules is None


def test_a_card_is_turned_into_numbers_and_rules_left_out_let_everything_pass():
    scenario = loaded(LOOSE)
    logic = {"wild_position": "150 m", "start_after": 5, "correct_after": "0 s", "restart_after": ["residual"]}
    card = with_fields(scenario.filter, logic=logic)
    faults = [{"kind": "satellite_outage", "start": "12 s", "duration": "3 s"}]
    prepared_case = prepare_hop(with_fields(scenario.model_copy(update={"filter": card}), faults=faults))
    rules = prepared_case.options.rules
    np.testing.assert_array_equal(rules.residual_limits, [150.0] * 3 + [math.inf] * 3)
    np.testing.assert_array_equal(rules.variance_limits, math.inf)
    np.testing.assert_array_equal(rules.restarts, [0.0, 1.0, 0.0])
    assert (rules.start_after, rules.stop_after, rules.from_gnss) == (5.0, math.inf, False)
    assert prepared_case.t_epoch[~rules.is_good].tolist() == [12.0, 13.0, 14.0]
    np.testing.assert_array_equal(rules.start_covariance, prepared_case.initial_state.P)


def test_a_start_from_the_receiver_is_a_logic_that_lets_everything_pass():
    scenario = loaded(LOOSE)
    card = with_fields(scenario.filter, init="from_gnss")
    faults = [{"kind": "invalid_output", "start": "12 s", "duration": "3 s"}]
    prepared_case = prepare_hop(with_fields(scenario.model_copy(update={"filter": card}), faults=faults))
    assert prepared_case.options.rules.is_good.all()
    assert prepared_case.options.rules.from_gnss


def test_where_a_sample_fails_the_checks_linear_covariance_has_no_row():
    prepared_case = case(LOOSE)
    card = with_fields(prepared_case.scenario.filter, logic={"pdop_below": 2.0})
    dilution = np.where(np.arange(prepared_case.t_epoch.size) % 2, 1.5, 3.0)
    failed = type("Failed", (), {"is_frozen": np.zeros(30, dtype=bool), "raised_flags": np.zeros((30, 3), dtype=bool)})
    check = failed_checks(card, failed, prepared_case.signals.n_used, prepared_case.channels, lambda: dilution)
    assert [REASONS[number] for number in check[:2]] == ["dilution of precision", ""]
    rules = mode_rules_of(card, check, prepared_case.channels, prepared_case.initial_state.P)
    n_used = used_satellite_count(rules, prepared_case.signals.n_used, None)
    np.testing.assert_array_equal(rules.is_good, dilution < 2.0)
    np.testing.assert_array_equal(n_used > 0, dilution < 2.0)


def test_of_ranges_the_limits_stand_by_channel_and_one_satellite_is_a_sample():
    scenario = loaded("base.filter=filters/tight")
    logic = {"wild_position": "150 m", "wild_velocity": "3 m/s"}
    card = with_fields(scenario.filter, logic=logic)
    faults = [
        {"kind": "satellite_outage", "start": "12 s", "duration": "3 s"},
        {"kind": "satellite_outage", "start": "18 s", "duration": "2 s", "keep": 1},
    ]
    prepared_case = prepare_hop(with_fields(scenario.model_copy(update={"filter": card}), faults=faults))
    rules = prepared_case.options.rules
    np.testing.assert_array_equal(rules.residual_limits, [150.0, 3.0] * len(prepared_case.sky.names))
    assert prepared_case.t_epoch[~rules.is_good].tolist() == [12.0, 13.0, 14.0]


FLAGGED = {"checksum": 10, "hardware": 14, "time_sync": 18}


@pytest.mark.parametrize("checked", [("checksum",), ("hardware",), ("time_sync",), ("fresh",), ()])
def test_every_flag_is_left_out_by_its_own_check_alone(checked):
    scenario = loaded(LOOSE)
    raised = [{"kind": "invalid_output", "flag": f, "start": f"{t} s", "duration": "2 s"} for f, t in FLAGGED.items()]
    raised.append({"kind": "frozen_output", "start": "22 s", "duration": "2 s"})
    card = with_fields(scenario.filter, logic={"check_flags": checked})
    prepared_case = prepare_hop(with_fields(scenario.model_copy(update={"filter": card}), faults=raised))
    at = [(FLAGGED | {"fresh": 22})[name] for name in checked]
    assert prepared_case.t_epoch[~prepared_case.options.rules.is_good].tolist() == [
        float(t + k) for t in at for k in range(2)
    ]
