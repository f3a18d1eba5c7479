"""A magnetometer in both engines, against closed forms: what one vector tells of attitude, and what its iron costs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.covariance.history import covariance
from lvnav_trade.quantities.frames import matrices, unit
from lvnav_trade.trajectory.flight import motion
from tests.both_engines.test_stellar import QUIET
from tests.building import INERTIAL, LOOSE, MATCHED, flight, loaded, prepare_hop, turning, with_fields
from tests.simulation.preparation.test_sensors import agree

MAGNETOMETER = {"kind": "magnetometer", "name": "test", "source": "none", "sigma": "100 nT"}
COARSE = {"initial.tilt": "1 deg", "initial.heading": "1 deg"}


def magnetic(*settings, measurements=("magnetic_field",), sensor=None, **fields):
    base = loaded(MATCHED, *(settings or (INERTIAL,)))
    card = {**MAGNETOMETER, **(sensor or {})}
    return with_fields(base, **{"sensors": {"one": card}, "filter.measurements": list(measurements), **fields})


@pytest.mark.parametrize("n", [1, 16])
def test_attitude_is_known_across_the_field_and_not_about_it(n):
    # in a coast: position, which the field depends on too, does not move with the attitude
    prepared_case = prepare_hop(magnetic(**QUIET, **COARSE), flight([(20.0, lambda t: np.zeros(3))], turning))
    cov, t = covariance(prepared_case), prepared_case.t_epoch[:n]
    start = math.radians(1.0) ** -2
    information = start * np.eye(3)
    for time, measured in zip(t, prepared_case.devices[0].truth[:, :3], strict=False):
        C_b_i = matrices(motion(prepared_case.trajectory, np.array([time])).q_b_i)[0]
        field = C_b_i @ measured
        across = field @ field * np.eye(3) - np.outer(field, field)  # z = B x att
        information = information + across / 100e-9**2
    at = int(np.argmin(np.abs(cov.t - t[-1])))
    expected = C_b_i.T @ np.linalg.inv(information) @ C_b_i
    np.testing.assert_allclose(cov.formal_cov[at, :3, :3], expected, atol=2e-4 * np.abs(expected).max())
    about = unit(measured)
    sigma = [math.sqrt(axis @ cov.formal_cov[at, :3, :3] @ axis) for axis in (about, np.cross(about, [1.0, 0.0, 0.0]))]
    if n == 1:
        assert sigma[0] == pytest.approx(math.radians(1.0), rel=1e-3)
        across = 100e-9 / np.linalg.norm(measured)  # 4.4 mrad at the equator
        assert sigma[1] == pytest.approx((start + across**-2) ** -0.5, rel=1e-3)


IRON = {"hard_iron": "300 nT", "soft_iron": "0.3 percent"}


@pytest.mark.parametrize("states", [(), ("hard_iron", "soft_iron")], ids=["neglected", "estimated"])
def test_both_engines_agree_on_what_iron_does(states):
    measurements = ("position", "velocity", "magnetic_field")
    prepared_case = prepare_hop(
        magnetic(LOOSE, measurements=measurements, sensor=IRON, **{"filter.extra_states": states})
    )
    cov, _ = agree(prepared_case, [0, 1, 2, 3, 4, 5])
    budget = dict(zip(cov.sources, cov.budget[-1], strict=True))
    assert {"hard iron", "soft iron", "magnetometer noise"} < set(budget)
    assert len(prepared_case.layout.extras) == (12 if states else 0)
    if states:
        np.testing.assert_allclose(cov.formal_sigma[-1, :3], cov.true_sigma[-1, :3], rtol=1e-3)
    else:
        assert np.any(cov.formal_sigma[-1, :3] < 0.7 * cov.true_sigma[-1, :3])


def test_a_filter_that_computes_less_of_the_field_is_wrong_in_both_engines_alike():
    measurements = ("position", "velocity", "magnetic_field")
    own = {"filter.sensor_models": {"magnetic_field": {"sigma": "300 nT", "degree": 6}}}
    cov, _ = agree(prepare_hop(magnetic(LOOSE, measurements=measurements, **own)), [0, 1, 2])
    whole = covariance(prepare_hop(magnetic(LOOSE, measurements=measurements)))
    assert np.linalg.norm(cov.mean[-1, :3]) > 1e-4  # rad
    assert np.linalg.norm(whole.mean[-1, :3]) < 1e-8
