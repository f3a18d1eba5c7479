"""The height that a radar altimeter measures: against geodetic coordinates, and its row against differences."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from lvnav_trade.kernels.strapdown import N_NAV, Q, R
from lvnav_trade.quantities.frames import ecef_from_geodetic
from lvnav_trade.sensors.altimeter import AltimeterCard, fill
from lvnav_trade.sensors.jacobian_row import H_ATT, H_CLOCK, H_POS, H_RATE, H_VEL, N_ENTRY

PLACES = [(lat, lon, h) for lat in (-90.0, -38.6, 0.0, 13.73, 45.0, 89.99) for lon, h in ((0.0, 10.0), (80.23, 5e3))]


def predicted(position, h=None):
    nav = np.zeros(N_NAV)
    nav[Q], nav[R : R + 3] = 1.0, position
    z = np.zeros(1)
    fill(np.zeros((1, N_ENTRY)) if h is None else h[None], z, 0, np.zeros(4), nav)
    return -z[0]


@pytest.mark.parametrize(("latitude", "longitude", "height"), PLACES)
def test_the_prediction_is_the_ellipsoidal_height(latitude, longitude, height):
    place = ecef_from_geodetic(np.radians(latitude), np.radians(longitude), height)
    assert predicted(place) == pytest.approx(height, abs=1e-6)  # m


@pytest.mark.parametrize(("latitude", "longitude", "height"), PLACES)
def test_the_row_is_the_derivative_with_respect_to_position_and_nothing_else(latitude, longitude, height):
    place = ecef_from_geodetic(np.radians(latitude), np.radians(longitude), height)
    h = np.full(N_ENTRY, np.nan)
    predicted(place, h)
    for axis in range(3):
        step = 100.0 * np.eye(3)[axis]
        slope = (predicted(place + step) - predicted(place - step)) / 200.0
        assert h[H_POS + axis] == pytest.approx(slope, abs=1e-7)
    assert np.linalg.norm(h[H_POS : H_POS + 3]) == pytest.approx(1.0, abs=1e-12)
    assert not np.any(h[[*range(H_ATT, H_ATT + 3), *range(H_VEL, H_VEL + 3), *range(H_RATE, H_RATE + 3), H_CLOCK]])


CARD = {"name": "test", "source": "none", "sigma": "1 m", "highest": "5 km"}


def test_units_are_read_and_what_is_not_said_is_zero():
    card = AltimeterCard.model_validate({**CARD, "share": "2 percent"})
    assert (card.sigma, card.share, card.highest, card.bias, card.lowest, card.bias_time) == (1, 0.02, 5000, 0, 0, None)


@pytest.mark.parametrize(
    ("field", "value", "reported"),
    [("sigma", "0 m", "greater than 0"), ("lowest", "6 km", "below highest"), ("highest", "0 m", "greater than 0")],
)
def test_what_cannot_be_is_refused(field, value, reported):
    with pytest.raises(ValidationError, match=reported):
        AltimeterCard.model_validate({**CARD, field: value})


def test_the_matched_model_has_the_cards_own_noise():
    model = AltimeterCard.model_validate({**CARD, "share": "2 percent"}).matched_model()
    assert (model.sigma, model.share) == (1.0, 0.02)
