"""How rows depend on what they share: every partial against a finite difference of the measurement itself."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.gnss.visibility import sky
from lvnav_trade.quantities.line_of_sight import lever_partials
from lvnav_trade.sensors.receiver_observables import LEVER_AXES, Channels, MeasurementGeometry, members, partial
from lvnav_trade.simulation.preparation.signals.lines_of_sight import lines_of
from tests.building import hop, loaded, with_fields

T = np.array([3.0, 12.0, 25.0])


def line(t=T, lever=(1.0, 0.5, -0.3)):
    scenario = loaded()
    receiver = with_fields(scenario.receiver, lever_b=[f"{x} m" for x in lever])
    return lines_of(hop(), np.array(lever), sky(scenario.constellation, receiver, hop(), t))


def geometry(of):
    shape = (*of.sight.rate.shape, 2)
    troposphere, ionosphere = np.full(shape, 2.0), np.full(shape, 3.0)
    solution = np.ones((of.sight.rate.shape[0], 6))
    return MeasurementGeometry(
        of.sight.rate,
        of.acceleration,
        of.velocity,
        of.vehicle_acceleration,
        troposphere,
        ionosphere,
        solution,
        2.0 * solution,
        lever_partials(of.sight, of.C_b_i, of.motion.w_ib_b),
    )


def channels(of, tight=True):
    names = tuple(f"G{k:02d}" for k in range(of.sight.rate.shape[1]))
    return Channels(tight, names, ("G",) * len(names), (True,) * len(names))


def test_a_late_measurement_is_that_of_before():
    middle, before, after = line(), line(T - 0.01), line(T + 0.01)
    found = partial("timing", geometry(middle), channels(middle))
    ranges, rates = (
        -(a - b) / 0.02
        for a, b in ((after.sight.distance, before.sight.distance), (after.sight.rate, before.sight.rate))
    )
    np.testing.assert_allclose(found[:, 0::2], ranges, atol=1e-3)
    # the derivative leaves out the swing of the lever arm and the satellite's own jerk: cm/s^2 of 30 m/s^2
    np.testing.assert_allclose(found[:, 1::2], rates, atol=5e-2)


def test_a_late_solution_is_that_of_before():
    middle, before, after = line(), line(T - 0.01), line(T + 0.01)
    found = partial("timing", geometry(middle), channels(middle, tight=False))
    np.testing.assert_allclose(found[:, :3], -(after.position - before.position) / 0.02, atol=1e-3)
    np.testing.assert_allclose(found[:, 3:], -(after.velocity - before.velocity) / 0.02, atol=5e-2)


@pytest.mark.parametrize("axis", range(3))
def test_an_antenna_elsewhere_changes_range_and_rate(axis):
    lever, step = np.array([1.0, 0.5, -0.3]), 1e-2
    plus, minus = (line(lever=tuple(lever + sign * step * np.eye(3)[axis])) for sign in (1.0, -1.0))
    middle = line()
    found = partial(LEVER_AXES[axis], geometry(middle), channels(middle))
    np.testing.assert_allclose(found[:, 0::2], (plus.sight.distance - minus.sight.distance) / (2 * step), atol=1e-5)
    np.testing.assert_allclose(found[:, 1::2], (plus.sight.rate - minus.sight.rate) / (2 * step), atol=1e-5)


def test_a_scale_factor_of_a_delay_is_worth_the_delay():
    middle = line()
    np.testing.assert_array_equal(partial("troposphere_scale", geometry(middle), channels(middle)), 2.0)
    np.testing.assert_array_equal(partial("ionosphere_scale", geometry(middle), channels(middle)), 3.0)
    loose = channels(middle, tight=False)
    np.testing.assert_array_equal(partial("troposphere_scale", geometry(middle), loose), 1.0)
    np.testing.assert_array_equal(partial("ionosphere_scale", geometry(middle), loose), 2.0)


def test_a_bias_of_a_range_is_none_of_its_rate():
    middle = line()
    found = partial("range_bias", geometry(middle), channels(middle))
    assert np.all(found[:, 0::2] == 1.0)
    assert np.all(found[:, 1::2] == 0.0)


def test_a_kind_that_enters_no_row_of_a_coupling_has_no_component():
    middle = line()
    assert members("range_bias", channels(middle, tight=False))[0] == ()
    assert members("position_bias", channels(middle))[0] == ()
    assert members("timing", channels(middle, tight=False))[0] == ("",)
