"""Draws of vehicles: their moments, the vehicle that they make, and a Gauss-Markov wind."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.trajectory.guided.draws import WIND_STEP, deviations, draw, numbers, run_vehicle
from tests.trajectory.guided.cases import guided


@pytest.fixture(scope="module")
def card():
    return guided(dispersion={"draw": "all"})


def test_draws_are_standard_normals_that_depend_on_seed_and_run_alone(card):
    many = [draw(card, 3, run) for run in range(400)]
    assert {name: values.size for name, values in many[0].items()} == numbers(card)
    for name in many[0]:
        values = np.concatenate([one[name] for one in many])
        assert abs(values.mean()) < 4.0 / np.sqrt(values.size)
        assert abs(values.std() - 1.0) < 4.0 / np.sqrt(2.0 * values.size)
    again = draw(card, 3, 7)
    np.testing.assert_array_equal(again["wind"], many[7]["wind"])
    assert draw(card, 4, 7)["thrust"][0] != again["thrust"][0]


def test_what_is_not_asked_for_is_not_drawn_and_fixed_values_add():
    fixed = draw(guided(dispersion={"sigmas": {"drag": -2.0}}), 1, 5)
    assert set(fixed) == {"drag"}
    np.testing.assert_array_equal(fixed["drag"], [-2.0])
    both = draw(guided(dispersion={"draw": ["drag"], "sigmas": {"drag": -2.0}}), 1, 5)
    alone = draw(guided(dispersion={"draw": ["drag"]}), 1, 5)
    np.testing.assert_allclose(both["drag"], alone["drag"] - 2.0)


def test_the_vehicle_has_the_drawn_numbers(card):
    spreads, nominal = card.vehicle.dispersions, card.vehicle
    sigmas = {name: np.arange(1.0, 1.0 + n) for name, n in numbers(card).items()}
    flown = run_vehicle(card, sigmas).vehicle
    for k, (stage, before) in enumerate(zip(flown.stages, nominal.stages, strict=True), start=1):
        assert stage.full_thrust == pytest.approx(before.full_thrust * (1.0 + k * spreads.thrust))
        assert stage.specific_impulse == pytest.approx(before.specific_impulse * (1.0 + k * spreads.specific_impulse))
        assert stage.propellant == pytest.approx(before.propellant * (1.0 + k * spreads.propellant))
        assert stage.dry == pytest.approx(before.dry * (1.0 + k * spreads.dry_mass))
    assert flown.stages[1].ignition_delay == pytest.approx(nominal.stages[1].ignition_delay + spreads.ignition_delay)
    air = (1.0 + spreads.drag) * (1.0 + spreads.density)
    np.testing.assert_allclose(flown.drag_coefficient, air * np.array(nominal.drag_coefficient))


def test_a_motor_of_known_burn_time_burns_as_long_as_its_propellant_lasts():
    card = guided("electron_leo", dispersion={"draw": "all"})
    sigmas = {"thrust": np.array([2.0, 0.0]), "propellant": np.array([0.0, -3.0])}
    spreads, stages = card.vehicle.dispersions, run_vehicle(card, sigmas).vehicle.stages
    assert stages[0].full_burn == pytest.approx(card.vehicle.stages[0].full_burn / (1.0 + 2.0 * spreads.thrust))
    assert stages[1].full_burn == pytest.approx(card.vehicle.stages[1].full_burn * (1.0 - 3.0 * spreads.propellant))


def test_common_factors_of_a_mission_come_first():
    card = guided(dispersion={"thrust": 0.98, "draw": ["thrust"]})
    flown = run_vehicle(card, {"thrust": np.array([1.0, 0.0])}).vehicle
    wanted = card.vehicle.stages[0].thrust * 0.98 * (1.0 + card.vehicle.dispersions.thrust)
    assert flown.stages[0].thrust == pytest.approx(wanted)


def test_the_wind_is_a_stationary_gauss_markov_process_over_height(card):
    spreads, draws = card.vehicle.dispersions, np.random.default_rng(1)
    wind = np.stack(
        [deviations(card, {"wind": draws.standard_normal(numbers(card)["wind"])}).wind.speed for _ in range(3000)]
    )
    assert wind.std(axis=0) == pytest.approx(np.full(wind.shape[1:], spreads.wind), rel=0.07)
    lag = 10
    for axis in range(2):
        found = np.mean(wind[:, 5, axis] * wind[:, 5 + lag, axis]) / spreads.wind**2
        assert found == pytest.approx(np.exp(-lag * WIND_STEP / spreads.wind_length), abs=0.08)
