"""Geometry of several inertial units: least squares, what is refused, and the unit that a set is like."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from lvnav_trade.imu.array import ImuSet, list_triads
from lvnav_trade.imu.differences import difference, relative_errors
from lvnav_trade.kernels.transition import GYRO

CARD: dict[str, Any] = {
    "name": "x", "source": "x", "rate": "100 Hz",
    "gyro": {"random_walk": "1e-5 rad/s**0.5", "bias_repeatability": "2e-6 rad/s", "scale_factor": "100 ppm",
             "misalignment": "0.1 mrad", "bias_instability": "1e-6 rad/s", "instability_time": "50 s"},
    "accel": {"random_walk": "1e-3 m/s**1.5", "bias_repeatability": "0.01 m/s**2", "misalignment": "0.3 mrad"},
}  # fmt: skip
GOLDEN = 0.5 * (1.0 + math.sqrt(5.0))
DODECAHEDRON = [(0, 1, GOLDEN), (0, 1, -GOLDEN), (1, GOLDEN, 0), (1, -GOLDEN, 0), (GOLDEN, 0, 1), (-GOLDEN, 0, 1)]


def cone(n: int, half_angle: float = math.acos(1.0 / math.sqrt(3.0))) -> list[tuple[float, ...]]:
    """Return n axes around x, evenly on a cone; of the default half angle (rad) the geometry is isotropic."""
    turn = 2.0 * np.pi * np.arange(n) / n
    c, s = math.cos(half_angle), math.sin(half_angle)
    return [(c, s * math.cos(a), s * math.sin(a)) for a in turn]


def of_units(*units: dict[str, Any], **fields: Any) -> ImuSet:
    """Return a set of units that differ from the card as stated."""
    return ImuSet.model_validate({"units": [{**CARD, **unit} for unit in units], **fields})


def test_least_squares_gives_the_rate_back_and_weights_the_better_unit():
    other = {"gyro": {"random_walk": "3e-5 rad/s**0.5"}, "accel": {"random_walk": "2e-3 m/s**1.5"}}
    first, second = list_triads(of_units({}, other))
    assert first.gyro + second.gyro == pytest.approx(np.eye(3))
    assert np.diag(first.gyro) == pytest.approx(0.9 * np.ones(3))
    assert np.diag(first.accel) == pytest.approx(0.8 * np.ones(3))
    assert np.diag(list_triads(of_units({}, other, weights="equal"))[0].gyro) == pytest.approx(0.5 * np.ones(3))
    rate = np.array([0.1, -0.2, 0.3])
    skewed = of_units({"axes": cone(4)}, {"orientation": ["10 deg", "20 deg", "30 deg"]}, other)
    assert sum(t.gyro @ t.frames[:, 0] @ rate for t in list_triads(skewed)) == pytest.approx(rate)


def test_a_frame_of_each_axis_is_orthonormal_and_begins_with_it():
    for triad in list_triads(of_units({"axes": DODECAHEDRON}, {})):
        for frame in triad.frames[: triad.n_axis]:
            assert frame @ frame.T == pytest.approx(np.eye(3), abs=1e-12)
            assert np.linalg.det(frame) == pytest.approx(1.0)
    assert list_triads(of_units({}))[0].frames[1] == pytest.approx(np.roll(np.eye(3), -1, axis=0))


@pytest.mark.parametrize(
    ("units", "fields", "message"),
    [
        ([{"axes": [[1, 0, 0], [0, 1, 0]]}], {}, "the sensing axes span 2 of 3 dimensions"),
        ([{"axes": [[1, 0, 0], [0, 1, 0], [1, 1, 0]]}], {}, "the sensing axes span 2 of 3 dimensions"),
        ([{"axes": [[1, 2, 3]]}] * 4, {}, "the sensing axes span 1 of 3 dimensions"),
        ([{}, {"axes": [[0, 0, 0]]}], {}, "axes: a direction of length zero"),
        ([{}, {"rate": "200 Hz"}], {}, "units.1.rate: 200 Hz, the first unit has 100 Hz"),
        ([{}, {"gyro": {}}], {}, "weights: random_walk: units.1.gyro has none; weight them equally"),
        ([{"accel": {}}, {}], {"weights": "bias"}, "weights: bias: units.0.accel has none"),
        ([], {}, "units: there is none"),
        ([{"axes": []}], {}, "axes: no direction to sense along"),
    ],
)
def test_a_set_that_makes_no_sense_is_refused_in_one_line(units, fields, message):
    with pytest.raises(ValidationError, match=message.replace("(", "\\(")) as caught:
        of_units(*units, **fields)
    assert len(caught.value.errors()) == 1


def test_what_two_units_differ_by_is_free_of_the_noise_of_their_average():
    """Weighted by noise, A R D' = 0 for any geometry; like units have biases that the difference tells nothing of."""
    card = of_units({"axes": cone(4)}, {"axes": DODECAHEDRON, "gyro": {"random_walk": "3e-5 rad/s**0.5"}}, {})
    triads, columns = list_triads(card), difference(card, 0, 1)
    noise = [card.units[triad.unit].gyro.random_walk ** 2 for triad in triads]
    shared = sum(q * t.gyro @ D[GYRO].T for q, t, D in zip(noise, triads, columns, strict=True))
    assert shared == pytest.approx(np.zeros((3, 3)), abs=1e-12 * max(noise))
    rate = np.array([0.1, -0.2, 0.3])  # and of what is sensed
    assert sum(D[GYRO] @ t.frames[:, 0] @ rate for t, D in zip(triads, columns, strict=True)) == pytest.approx(
        np.zeros(3), abs=1e-12
    )


def test_relative_errors_of_two_triads_are_root_sums_of_squares():
    """b1 - b2 has s1^2 + s2^2, and with (b1 + b2) / 2 the covariance (s1^2 - s2^2) / 2."""
    found = relative_errors(of_units({}, {"gyro": {**CARD["gyro"], "bias_repeatability": "6e-6 rad/s",
                                                   "bias_instability": 0}}), GYRO, 0, 1)  # fmt: skip
    one, two = 2e-6**2 + 1e-6**2, 6e-6**2
    assert found.random_walk == pytest.approx(math.sqrt(2.0) * 1e-5)
    assert found.bias == pytest.approx(math.sqrt(one + two))
    assert found.correlation == pytest.approx((one - two) / (one + two))
    assert found.walk == pytest.approx(math.sqrt(1e-12 * 2.0 / 50.0))
