"""Which filter takes Jacobians and which takes points; what is compared with a stored state takes Jacobians."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from lvnav_trade.filter.policies import linearise
from lvnav_trade.filter.policies.delay import DelayProcessing
from lvnav_trade.filter.policies.linearise import is_receiver_stored, is_sensor_stored


def delays(extrapolated, receiver, *of_sensor):
    nothing = np.zeros(1)
    return DelayProcessing(
        is_extrapolated=extrapolated, receiver_line=receiver, line=np.array([receiver]),
        sensor_line=np.array(of_sensor), n_ring=np.array([1]), first=np.array([0]),
        is_buffered=np.array([not extrapolated]), state_epochs=np.zeros((1, 1, 2), dtype=np.int64),
        velocity_epochs=np.zeros((1, 1, 2), dtype=np.int64),
        delay=nothing, offset=np.zeros((1, 1)), base=nothing, interval=1.0, delay_variance=0.0,
        acceleration_variance=0.0,
    )  # fmt: skip


BUFFERED, EXTRAPOLATED, OF_SENSOR = delays(False, 0, -1, -1), delays(True, 0, -1, 1), delays(False, -1, -1, 0)


def test_a_stored_state_is_that_of_a_buffered_line_and_an_extrapolated_receiver_has_none():
    assert [is_receiver_stored(one) for one in (None, BUFFERED, EXTRAPOLATED, OF_SENSOR)] == [False, True, False, False]
    assert [is_sensor_stored(one, 1) for one in (None, BUFFERED, EXTRAPOLATED, OF_SENSOR)] == [False, False, True, True]
    assert not is_sensor_stored(OF_SENSOR, 0)


@pytest.fixture
def called(monkeypatch):
    """Names of the steps that are called, in their order."""
    found = []
    for name in (
        "fill_receiver", "fill_sensor_at_state", "clear_residual_variance", "regress_receiver", "regress_sensor",
        "predict_window", "propagate_by_points",
    ):  # fmt: skip
        monkeypatch.setattr(linearise, name, lambda *given, name=name: found.append(name))
    monkeypatch.setattr(linearise, "receiver_row_count", lambda model, signals, epoch: 6)
    monkeypatch.setattr(linearise, "sensor_row", lambda model, work, channel: 6)
    return found


CASE = SimpleNamespace(
    model=None, signals=None, options=SimpleNamespace(differences=None),
    sensors=SimpleNamespace(channel=[6, 7], scalars=[1, 2]),
    schedule=SimpleNamespace(length_index=[0], injection=[-1]),
)  # fmt: skip
PARTS = SimpleNamespace(previous_epoch=None)


@pytest.mark.parametrize(
    ("sigma_points", "settings", "receiver", "sensor"),
    [
        (None, None, ["fill_receiver"], ["fill_sensor_at_state"]),
        (None, BUFFERED, ["fill_receiver"], ["fill_sensor_at_state"]),
        (True, None, ["regress_receiver"], ["regress_sensor"]),
        (True, BUFFERED, ["fill_receiver", "clear_residual_variance"], ["regress_sensor"]),
        (True, EXTRAPOLATED, ["regress_receiver"], ["fill_sensor_at_state", "clear_residual_variance"]),
        (True, OF_SENSOR, ["regress_receiver"], ["fill_sensor_at_state", "clear_residual_variance"]),
    ],
)
def test_rows_are_by_points_but_where_they_are_compared_with_a_stored_state(
    called, sigma_points, settings, receiver, sensor
):
    linearise.fill_receiver_rows.py_func(None, PARTS, CASE, sigma_points, settings, 0)
    assert called == receiver
    called.clear()
    linearise.fill_sensor_rows.py_func(None, PARTS, CASE, sigma_points, settings, 1, 0)
    assert called == sensor


def test_a_window_is_propagated_by_the_transition_or_by_points(called):
    for sigma_points in (None, True):
        linearise.propagate_estimate.py_func(None, CASE, sigma_points, None, 0)
    assert called == ["predict_window", "propagate_by_points"]
