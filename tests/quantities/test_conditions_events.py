"""Times by the name of an event."""

from __future__ import annotations

import pytest

from lvnav_trade.quantities.conditions import resolve
from lvnav_trade.quantities.errors import InputError

EVENTS = {"liftoff": 0.0, "stage1_cutoff": 150.0, "injection": 540.0}


@pytest.mark.parametrize(
    ("text", "time"),
    [
        ("stage1_cutoff", 150.0),
        ("stage1_cutoff + 20 s", 170.0),
        ("stage1_cutoff+500 ms", 150.5),
        ("injection - 1 min", 480.0),
        ("100 s", 100.0),
        ("-30 s", -30.0),
    ],
)
def test_a_time_may_be_an_event_an_offset_from_it_or_a_duration(text, time):
    assert resolve(text, EVENTS) == pytest.approx(time, abs=1e-12)


def test_a_misspelt_event_is_answered_with_the_nearest_one():
    with pytest.raises(InputError, match=r"no event 'stage1_cutof'.*did you mean 'stage1_cutoff'"):
        resolve("stage1_cutof + 20 s", EVENTS)


def test_an_unknown_event_is_answered_with_all_there_are():
    with pytest.raises(InputError, match="the flight has liftoff, stage1_cutoff, injection"):
        resolve("xyz", EVENTS)


@pytest.mark.parametrize("text", ["100", "stage1_cutoff + 20", "injection + 3 m", "", "injection +"])
def test_a_time_without_its_unit_is_refused(text):
    with pytest.raises(InputError, match="is not a time"):
        resolve(text, EVENTS)
