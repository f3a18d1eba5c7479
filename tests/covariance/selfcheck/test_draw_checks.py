"""Draws of IMU and start: numbers that are not the cards' are found."""

from __future__ import annotations

import pytest

from lvnav_trade.covariance.selfcheck.draw_checks import imu_checks, initial_error_checks
from tests.covariance.diagnostics.checked import SEED, failed, rich


@pytest.mark.parametrize(
    ("field", "factor", "found"),
    [
        ("sigma", 1.3, "gyro bias repeatability, variance"),
        ("walk", 1.3, "accelerometer rate random walk, variance"),
        ("decay", 0.99, "gyro bias instability, correlation"),
        ("white", 1.05, "gyro random walk, variance"),
    ],
)
def test_draws_of_the_imu_that_are_not_the_cards_are_found(field, factor, found):
    prepared_case = rich()
    unit = prepared_case.unit._replace(**{field: factor * getattr(prepared_case.unit, field)})
    assert found in {what for what, *_ in failed(imu_checks(prepared_case._replace(unit=unit), SEED))}


def test_a_start_that_is_not_the_cards_is_found():
    prepared_case = rich()
    roots = prepared_case.initial_state.roots.copy()
    roots[2] *= 1.3
    wrong = prepared_case._replace(initial_state=prepared_case.initial_state._replace(roots=roots))
    assert {what for what, *_ in failed(initial_error_checks(wrong, SEED))} == {"initial position, variance"}
