"""Readings of one table side by side: against the sample, and against it without bias, beside what is stated."""

from __future__ import annotations

import pytest

from lvnav_trade.metrics.published.interpretations import interpretations, short_names
from tests.vehicle_tables import DURING, RAW, SIGMA, tables


def test_every_case_that_is_held_against_raw_samples_stands_beside_what_is_stated_of_it():
    found = interpretations(tables())
    assert list(found.case) == ["1", "2"]
    assert list(found.stated_percent) == [88.0, 57.0]
    assert set(found.during) == {DURING}
    assert list(found.raw_percent) == pytest.approx([100.0 * (1.0 - SIGMA / RAW)] * 2)
    assert list(found.unbiased_percent) == pytest.approx([100.0 * (1.0 - SIGMA / RAW)] * 2)


def test_cases_are_named_by_what_sets_them_apart():
    found = tables()
    assert list(short_names(found, list(found.labels)).values()) == ["1", "2"]
    assert list(short_names(found, list(found.labels)[:1]).values()) == [next(iter(found.labels.values()))]


def test_a_campaign_that_holds_nothing_against_raw_samples_has_no_readings():
    found = tables()
    found.__dict__["campaign"] = {}
    assert interpretations(found).empty
