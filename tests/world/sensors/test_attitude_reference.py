"""The card of an attitude reference: a sigma above zero, in an angle's unit."""

from __future__ import annotations

import math

import pytest

from lvnav_trade.world.sensors.attitude_reference import AttitudeReferenceCard


def test_the_sigma_is_read_with_its_unit():
    assert AttitudeReferenceCard(name="a", source="b", sigma="1 deg").sigma == pytest.approx(math.radians(1.0))


@pytest.mark.parametrize("sigma", ["0 deg", "-1 deg", "1 m", 1.0])
def test_no_noise_or_no_angle_is_refused(sigma):
    with pytest.raises(ValueError, match="sigma"):
        AttitudeReferenceCard(name="a", source="b", sigma=sigma)
