"""Axes of the Earth in the rows of the pad's sensors, and when they measure."""

from __future__ import annotations

import numpy as np

from lvnav_trade.quantities.frames import rotation_i_e
from lvnav_trade.sensors.family import SENSORS
from lvnav_trade.sensors.jacobian_row import H_VEL, N_ENTRY
from lvnav_trade.sensors.pad.standing import PadSensorCard, begin_rows, earth_components
from tests.sensors.pad.rows import VIEW

THETA = 2.1
PAD = [card for card in SENSORS if card.is_on_pad]


def test_rows_begin_with_the_matrix_to_the_axes_of_the_earth():
    H = np.full((5, N_ENTRY), np.nan)
    begin_rows(H, 1, H_VEL, THETA)
    np.testing.assert_allclose(H[1:4, H_VEL : H_VEL + 3], rotation_i_e(THETA), atol=1e-15)
    assert np.isnan(H[[0, 4]]).all()
    assert np.count_nonzero(H[1:4]) == 5


def test_a_vector_is_brought_to_the_axes_of_the_earth():
    np.testing.assert_allclose(
        earth_components(THETA, 3.0, -4.0), (rotation_i_e(THETA) @ [3.0, -4.0, 5.0])[:2], atol=1e-15
    )


def test_the_sensors_of_the_pad_measure_while_the_vehicle_stands():
    assert PAD
    assert all(issubclass(card, PadSensorCard) for card in PAD)
    for card in PAD:
        sizes = {name: 1e-3 for name in ("sigma",) if name in card.model_fields}
        one = card.model_construct(**sizes)
        assert one.is_available(VIEW).tolist() == [True]
        assert one.is_available(VIEW._replace(is_at_rest=np.array([False]))).tolist() == [False]
