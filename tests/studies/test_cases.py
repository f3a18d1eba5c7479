"""The cases that the terms of a statement stand for: one each, for every choice of the axes left open."""

from __future__ import annotations

from lvnav_studies.cases import readings

FINE, COARSE = {"imu": "fine"}, {"imu": "coarse"}


def test_a_reading_needs_one_case_for_each_term():
    known = [{"imu": i, "start": s} for i in ("fine", "coarse") for s in ("a", "b")]
    found = readings(known, {"x": FINE, "y": COARSE})
    assert found == [({"start": "a"}, {"x": 0, "y": 2}), ({"start": "b"}, {"x": 1, "y": 3})]
    assert readings(known, {"x": FINE, "y": {"start": "a"}}) == []


def test_axes_that_vary_together_need_not_all_be_named():
    known = [
        {"imu": imu, "tilt": tilt, "start": start}
        for imu, own in (("fine", "1 mrad"), ("coarse", "3 mrad"))
        for start, tilt in (("own", own), ("same", "2 mrad"))
    ]
    found = readings(known, {"x": FINE, "y": COARSE})
    assert found == [({"start": "own"}, {"x": 0, "y": 2}), ({"start": "same"}, {"x": 1, "y": 3})]
    assert readings(known, {"x": FINE}) == [({"tilt": "1 mrad"}, {"x": 0}), ({"tilt": "2 mrad"}, {"x": 1})]


def test_one_axis_varied_at_a_time_is_read_case_by_case():
    known = [{"a": "base", "b": "base"}, {"a": "1", "b": "base"}, {"a": "base", "b": "1"}, {"a": "base", "b": "2"}]
    assert [one.levels for one in readings(known, {"x": {}})] == known
    assert readings([], {"x": {}}) == []


def test_two_axes_that_vary_together_are_read_as_one():
    known = [{"a": "1", "b": "p"}, {"a": "2", "b": "q"}]
    assert [one.levels for one in readings(known, {"x": {}})] == [{"a": "1"}, {"a": "2"}]
