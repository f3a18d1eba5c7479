"""The filter card: what it accepts and refuses."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from lvnav_trade.filter.card import FilterCard

PLAIN = {"name": "f", "source": "test", "measurements": ["pseudorange", "range_rate"]}


def test_a_plain_card_is_matched_second_order_at_ten_hertz_and_one_hertz_without_a_gate():
    card = FilterCard(**PLAIN)
    assert (card.imu, card.receiver, card.initial) == ("matched", "matched", "matched")
    assert (card.covariance_rate, card.update_rate, card.transition_order, card.gate) == (10.0, 1.0, 2, None)


@pytest.mark.parametrize(
    "wrong",
    [
        {"measurements": ["unscented"]},
        {"extra_states": ["gyro_bias_bias"]},
        {"consider": ["clock"]},
        {"neglect": ["gyro_scale_factor"]},
        {"neglect": ["gyro_bias"], "consider": ["gyro_bias"]},
        {"update": "square root"},
        {"transition_order": 3},
        {"gate": 0.0},
        {"gate": -3.0},
        {"gravity": "j6"},
        {"imu": "unmatched"},
        {"covariance_rate": 10},
        {"covariance_rate": "10 s"},
        {"colour": "red"},
    ],
    ids=str,
)
def test_what_no_filter_understands_is_refused(wrong):
    with pytest.raises(ValidationError):
        FilterCard(**{**PLAIN, **wrong})


@pytest.mark.parametrize(
    ("listed", "reason"),
    [
        (["carrier_phase", "tdcp"], "tdcp is the change of carrier_phase: information would be counted twice"),
        (["pseudorange", "delta_pseudorange"], "delta_pseudorange is the change of pseudorange"),
        (["position", "tdcp"], "the receiver's solution is computed from the same ranges"),
    ],
)
def test_the_same_information_twice_is_refused(listed, reason):
    with pytest.raises(ValidationError, match=reason):
        FilterCard(**PLAIN | {"measurements": listed})


@pytest.mark.parametrize("listed", [["tdcp"], ["delta_pseudorange"], ["carrier_phase", "range_rate"],
                                    ["pseudorange", "range_rate", "tdcp"], ["tdcp", "delta_pseudorange"]])  # fmt: skip
def test_any_other_observables_go_together(listed):
    card = FilterCard(**PLAIN | {"measurements": listed})
    assert card.tight
    assert set(card.differences) == set(listed) & {"tdcp", "delta_pseudorange"}


def test_no_inverse_transition_leads_back_through_samples_that_are_measurements():
    with pytest.raises(ValidationError, match="samples of the IMU are updates between epochs"):
        FilterCard(**PLAIN | {"measurements": ["tdcp", "imu"], "delayed_state": "back_propagated"})
    assert FilterCard(**PLAIN | {"measurements": ["tdcp", "imu"]}).models_vehicle


@pytest.mark.parametrize("state", ["ambiguity", "phase_noise", "code_noise"])
def test_states_that_a_filter_has_by_what_it_measures_are_not_named(state):
    for field in ("extra_states", "consider"):
        with pytest.raises(ValidationError):
            FilterCard(**PLAIN | {field: [state]})
