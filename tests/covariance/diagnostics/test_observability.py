"""What the rows of a stretch can tell of the states: against theory on the pad, and against the filter's covariance."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.covariance.diagnostics.case_diagnostics import diagnose
from lvnav_trade.covariance.diagnostics.observability import TOLERANCE, add_row, direction_text, observability
from lvnav_trade.covariance.history import covariance
from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.kernels.transition import ATT
from lvnav_trade.quantities.frames import matrices
from lvnav_trade.quantities.records import CovarianceRequest
from lvnav_trade.scenario.filter_models import filter_models
from tests.both_engines.modelled import BASELINE, modelled
from tests.building import INERTIAL, LOOSE, MATCHED, ascent, assumed_receiver, case, loaded, prepare_hop

PAD = np.array([-60.0, 0.0])


def test_without_a_measurement_nothing_is_observable():
    (stretch,) = observability(ascent(MATCHED, INERTIAL), PAD)
    assert (stretch.rank, stretch.measurement_count) == (0, 0)
    assert not stretch.singular_values.any()


def test_on_the_pad_three_directions_are_unobservable_and_heading_takes_longer_than_a_minute():
    """Three states of a stationary unit are unobservable, whatever the time (Bar-Itzhack and Berman, Control Theoretic
    Approach to Inertial Navigation Systems, 1988): both tilts from level accelerometer biases, heading from the east
    gyro's. Heading itself shows as the tilt that Earth's rate turns it into: 3e-3 of it in a minute.
    """
    (stretch,) = observability(ascent(MATCHED, LOOSE), PAD)
    assert np.sum(stretch.singular_values < 1e-6) == 3
    assert 1e-5 < stretch.singular_values[11] < TOLERANCE
    assert stretch.rank == 15 - 3 - 1
    assert stretch.measurement_count == 60 * 6


def test_a_turn_about_the_vertical_that_follows_the_earth_is_unobservable_on_the_pad():
    """The east gyro's bias keeps the turn about the vertical, which moves with the Earth: no force ever shows it."""
    prepared_case = ascent(MATCHED, LOOSE)
    (stretch,) = observability(prepared_case, PAD)
    C_b_i = matrices(prepared_case.reference.q_b_i[:1])[0]
    force = C_b_i @ prepared_case.reference.dvel[0]
    up = force / np.linalg.norm(force)
    turn = np.zeros(prepared_case.layout.n_state)
    turn[ATT : ATT + 3] = up
    turn[9:12] = -C_b_i.T @ np.cross([0.0, 0.0, OMEGA], up)
    turn /= np.sqrt(np.diag(prepared_case.initial_state.P))
    share = np.linalg.lstsq(stretch.directions[-3:].T, turn)[0] @ stretch.directions[-3:]
    np.testing.assert_allclose(share, turn, rtol=0, atol=1e-4 * np.linalg.norm(turn))
    np.testing.assert_array_equal(stretch.weakest_direction, stretch.directions[-1])


def test_thrust_makes_every_state_observable():
    (stretch,) = observability(ascent(MATCHED, LOOSE), np.array([0.0, 150.0]))
    assert stretch.rank == 15


@pytest.mark.parametrize("settings", [(), (LOOSE,)], ids=["tight", "loose"])
def test_the_singular_values_say_how_far_the_filter_s_own_covariance_shrinks(settings):
    """Without process noise P+ = Phi S (I + A'A)^-1 S Phi' with A the scaled rows, so that the determinant falls by the
    product of 1 + s^2: the forward filter and the stacked rows reach it by different ways.
    """
    scenario = loaded(*settings)
    imu, _, initial = filter_models(scenario)
    quiet = dict.fromkeys(("gyro_random_walk", "accel_random_walk", "gyro_bias_walk", "accel_bias_walk"), 0.0)
    update = {
        "imu": imu.model_copy(update=quiet),
        "receiver": assumed_receiver(scenario, clock_h0=0.0, clock_h_minus2=0.0),
        "initial": initial.model_copy(update={"clock_bias": 100.0, "clock_drift": 1.0}),
    }
    prepared_case = prepare_hop(scenario.model_copy(update={"filter": scenario.filter.model_copy(update=update)}))
    (stretch,) = observability(prepared_case, np.array([0.0, 30.0]))
    after = covariance(prepared_case).formal_cov[-1]
    fallen = np.linalg.slogdet(prepared_case.initial_state.P)[1] - np.linalg.slogdet(after)[1]
    assert fallen == pytest.approx(np.sum(np.log1p(stretch.singular_values**2)), rel=1e-6)


def test_a_stretch_holds_the_rows_that_fall_into_it_and_all_stretches_hold_them_all():
    prepared_case = case(MATCHED, LOOSE)
    parts = observability(prepared_case, np.array([0.0, 7.5, 20.0, 30.0]))
    assert [part.measurement_count for part in parts] == [7 * 6, 13 * 6, 10 * 6]
    assert [(part.start, part.end) for part in parts] == [(0.0, 7.5), (7.5, 20.0), (20.0, 30.0)]
    assert observability(prepared_case, np.array([0.0, 30.0]))[0].measurement_count == 30 * 6


def test_more_rows_never_tell_less():
    prepared_case = case(MATCHED)
    short, long = (observability(prepared_case, np.array([0.0, end]))[0].singular_values for end in (10.0, 30.0))
    assert np.all(long >= short * (1.0 - 1e-9))
    assert np.all(np.diff(long) <= 0.0)


def test_edges_outside_the_flight_are_moved_to_its_ends():
    prepared_case = case(MATCHED, LOOSE)
    (stretch,) = observability(prepared_case, np.array([-100.0, 0.0, 30.0, 500.0]))
    assert (stretch.start, stretch.end) == (0.0, 30.0)


def test_a_direction_is_said_by_its_largest_states_first():
    names = ("roll", "pitch", "gyro bias x")
    assert direction_text(np.array([-0.5, 0.1, 1.0]), names) == "+1.00 gyro bias x, -0.50 roll"


def test_folding_rows_in_one_by_one_is_the_factorisation_of_all():
    generator = np.random.default_rng(7)
    rows = generator.standard_normal((50, 6)) * [1e3, 1.0, 1e-3, 1.0, 1.0, 1.0]
    triangle = np.zeros((6, 6))
    for row in rows:
        add_row(triangle, row.copy())
    np.testing.assert_array_equal(triangle, np.triu(triangle))
    np.testing.assert_allclose(np.abs(triangle), np.abs(np.linalg.qr(rows)[1]), rtol=1e-11, atol=1e-13)


def test_a_state_that_the_filter_is_certain_of_is_not_counted_among_those_to_be_observed():
    # The unit's card names no scale factor, so the extended filter carries its nine states at sigma zero.
    flight = case("base.imu=imu/kvh1750_003", "base.filter=filters/tight_extended")
    certain = int(np.sum(np.diag(flight.initial_state.P) == 0.0))
    assert certain > 0
    (stretch,) = observability(flight, flight.t_hist[[0, -1]])
    assert stretch.singular_values.size == flight.layout.n_state - certain
    assert np.all(np.isfinite(stretch.weakest_direction))


@pytest.mark.slow  # a kernel of its own, most of half a minute to compile
def test_rate_and_acceleration_add_six_observable_directions_to_the_baseline():
    edges = np.array([0.0, 20.0, 30.0])
    ours, base = observability(modelled(), edges), observability(modelled(BASELINE), edges)
    for with_model, without in zip(ours, base, strict=True):
        assert with_model.rank == without.rank + 6
        assert with_model.singular_values.size == 24
        # numerically every direction is seen: none is lost to rounding
        assert with_model.singular_values[-1] > 1e-10 * with_model.singular_values[0]
    assert ours[0].measurement_count == 20 * (200 * 6 + 9)


def test_a_position_bias_without_a_time_constant_cannot_be_reported_from_position():
    # What is left are the gradient of gravity and the rounding of a position's own drift: next to nothing in 20 s.
    reported = [_apart(modelled(**{"receiver__solution__bias_time": time})) for time in ("60 s", "1e15 s")]
    assert reported[0] > 0.1
    assert reported[1] < 0.02 * reported[0]


def _apart(prepared_case):
    """The largest singular value among directions in which a position's bias replaces the position."""
    found = observability(prepared_case, np.array([0.0, 20.0]))[0]
    position, bias = slice(6, 9), slice(15, 18)
    reported = [
        value
        for value, d in zip(found.singular_values, found.directions, strict=True)
        if np.abs(d[position]).max() > 0.5 and np.abs(d[bias]).max() > 0.5 and d[position] @ d[bias] < 0.0
    ]
    assert len(reported) == 3
    return max(reported)


def test_an_explanation_holds_the_windows_that_were_asked_for():
    prepared_case = modelled()
    found = diagnose(prepared_case.scenario, prepared_case, covariance(prepared_case), CovarianceRequest(window=10.0))
    assert [phase.name for phase in found.phases] == ["0 s to 10 s", "10 s to 20 s", "20 s to 30 s"]
    assert found.adjoint is not None
