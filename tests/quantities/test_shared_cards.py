"""Factors on the noise of a receiver over altitude, specific force or jerk."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from lvnav_trade.quantities.shared_cards import Dynamics, NoiseFactor, idle_tables, noise_factor

AT = Dynamics(np.array([-1e3, 0.0, 15e3, 30e3, 90e3]), np.array([0.0, 10.0, 20.0, 30.0, 80.0]), np.full(5, 5.0))
BY_ALTITUDE = {"altitude": ["0 km", "30 km", "60 km"], "factor": [1.0, 4.0, 2.0]}
BY_FORCE = {"specific_force": ["10 m/s^2", "30 m/s^2"], "factor": [1.0, 3.0], "of": ["velocity"]}
BY_JERK = {"jerk": ["0 m/s^3", "10 m/s^3"], "factor": [1.0, 2.0]}


def tables(*fields):
    return [NoiseFactor.model_validate(one) for one in fields]


def test_straight_lines_join_the_entries_and_the_ends_hold():
    np.testing.assert_allclose(noise_factor(tables(BY_ALTITUDE), "position", AT), [1.0, 1.0, 2.5, 4.0, 2.0])


def test_factors_multiply_and_each_is_of_the_measurements_it_names():
    all_three = tables(BY_ALTITUDE, BY_FORCE, BY_JERK)
    of_range = 1.5 * np.array([1.0, 1.0, 2.5, 4.0, 2.0])
    np.testing.assert_allclose(noise_factor(all_three, "pseudorange", AT), of_range)
    np.testing.assert_allclose(noise_factor(all_three, "velocity", AT), of_range * [1.0, 1.0, 2.0, 3.0, 3.0])


def test_a_table_of_what_nobody_takes_is_idle():
    assert idle_tables(tables(BY_ALTITUDE, BY_FORCE), ("pseudorange", "range_rate")) == [1]
    assert idle_tables(tables(BY_ALTITUDE, BY_FORCE), ()) == [0, 1]


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"factor": [1.0, 2.0]}, "one of altitude, specific_force, jerk is stated, not none"),
        ({**BY_ALTITUDE, **BY_JERK}, "one of altitude, specific_force, jerk is stated, not altitude and jerk"),
        ({**BY_ALTITUDE, "factor": [1.0, 2.0]}, "3 values of altitude but 2 factors"),
        ({"altitude": ["9 km", "8 km"], "factor": [1.0, 2.0]}, "altitude must rise from entry to entry"),
        ({"altitude": ["8 km", "9 km"], "factor": [1.0, 0.0]}, "greater than 0"),
    ],
)
def test_a_table_that_makes_no_sense_is_refused(fields, message):
    with pytest.raises(ValidationError, match=message):
        NoiseFactor.model_validate(fields)
