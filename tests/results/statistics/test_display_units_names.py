"""Cases are named by the names of the cards that distinguish them."""

from __future__ import annotations

import json
from typing import Any

import pandas as pd
import pytest

from lvnav_trade.imu.array import ImuSet
from lvnav_trade.results.statistics.display_units import _NAMELESS, case_names, with_case_names
from lvnav_trade.results.tables.read import Tables

IMU = {"labels": ["fog", "mems"], "values": [{"name": "Fibre-optic gyro"}, {"name": "MEMS gyro"}]}
FILTER = {"labels": ["loose", "tight"], "values": [{"name": "Loose coupling"}, {"name": "Tight coupling"}]}


def tables(axes: dict[str, Any], levels: list[dict[str, str]]) -> Tables:
    rows = {
        "case": [f"{k}" * 12 for k in range(len(levels))],
        "label": [", ".join(f"{axis}={level}" for axis, level in one.items()) for one in levels],
        "axes": [json.dumps(one) for one in levels],
    }
    found = Tables.from_arrow({}, {"axes": [{"path": name, **axis} for name, axis in axes.items()]})
    return found.with_frames(cases=pd.DataFrame(rows))


def test_a_case_is_named_by_its_cards():
    found = tables(
        {"imu": IMU, "filter": FILTER}, [{"imu": "fog", "filter": "loose"}, {"imu": "mems", "filter": "tight"}]
    )
    assert list(case_names(found).values()) == ["Fibre-optic gyro · Loose coupling", "MEMS gyro · Tight coupling"]
    assert list(with_case_names(found).labels.values()) == list(case_names(found).values())


def test_an_axis_with_one_level_among_the_cases_does_not_distinguish_them():
    found = tables(
        {"imu": IMU, "filter": FILTER}, [{"imu": "fog", "filter": "loose"}, {"imu": "mems", "filter": "loose"}]
    )
    assert list(case_names(found).values()) == ["Fibre-optic gyro", "MEMS gyro"]


def test_numbers_stay_with_the_name_of_their_axis():
    rate = {"labels": ["1 Hz", "2 Hz"], "values": ["1.0 Hz", "2.0 Hz"]}
    found = tables({"imu": IMU, "rate": rate}, [{"imu": "fog", "rate": "1 Hz"}, {"imu": "mems", "rate": "2 Hz"}])
    assert list(case_names(found).values()) == ["Fibre-optic gyro · rate=1 Hz", "MEMS gyro · rate=2 Hz"]


def test_an_array_of_imus_that_is_written_in_the_campaign_has_no_title():
    assert ImuSet.model_fields["name"].default == _NAMELESS


@pytest.mark.parametrize(
    "axis",
    [
        {"labels": ["fog", "mems"], "values": ["1.0 m", "2.0 m"]},
        {"labels": ["Our FOG", "Our MEMS"], "values": IMU["values"]},
        {"labels": ["fog", "mems"], "values": [{"name": "The same"}, {"name": "The same"}]},
        {"labels": ["alone", "redundant"], "values": [{"name": "Fibre-optic gyro"}, {"name": "several units"}]},
        {"labels": ["fog", "mems"], "values": [{"name": "Fibre-optic gyro"}, {"name": "x" * 200}]},
    ],
)
def test_labels_stay_where_the_user_gave_them_or_names_do_not_distinguish(axis):
    found = tables({"imu": axis}, [{"imu": label} for label in axis["labels"]])
    assert list(case_names(found).values()) == list(found.labels.values())
    assert with_case_names(found) is found
