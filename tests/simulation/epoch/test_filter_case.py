"""What an epoch reads of a case."""

from __future__ import annotations

from lvnav_trade.simulation.epoch.filter_case import OptionalState, case_of
from tests.building import case


def test_a_case_has_the_records_of_what_is_prepared_and_what_replaces_them():
    prepared = case()
    found = case_of(prepared)
    assert found.model is prepared.model
    assert found.signals is prepared.signals
    assert found.tick == prepared.unit.dt
    assert found.step == found.tick * prepared.model.strapdown.subsamples
    aside = prepared.model._replace(aided=False)
    assert case_of(prepared, model=aside).model is aside


def test_a_case_without_features_has_no_arrays_of_them():
    assert set(OptionalState()) == {None}
