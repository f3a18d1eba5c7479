"""What an epoch reads of a case."""

from __future__ import annotations

import numba

from lvnav_trade.simulation.epoch.filter_case import OptionalState, case_of
from tests.both_engines.modelled import modelled
from tests.building import case


def test_a_case_has_the_records_of_what_is_prepared_and_what_replaces_them():
    prepared_case = case()
    found = case_of(prepared_case)
    assert found.model is prepared_case.model
    assert found.signals is prepared_case.signals
    assert found.tick == prepared_case.unit.dt
    assert found.step == found.tick * prepared_case.model.strapdown.subsamples
    aside = prepared_case.model._replace(has_epochs=False)
    assert case_of(prepared_case, model=aside).model is aside


def test_a_case_without_features_has_no_arrays_of_them():
    assert set(OptionalState()) == {None}


def test_a_filter_of_imu_samples_needs_the_same_kernels_with_and_without_sensors():
    aided, alone = modelled(), modelled(filter__measurements=("imu",))
    assert aided.sensors is not None
    assert alone.sensors is None
    assert case_of(alone).sensors.code.size == 0
    assert numba.typeof(case_of(alone)) == numba.typeof(case_of(aided))
    assert case_of(case()).sensors is None  # the kernels of most cases have no code of sensors
