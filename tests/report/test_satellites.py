"""Sections on satellites: what is empty, recovery and losses, delays, latency, signals."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.report.blocks import Picture, Table
from lvnav_trade.report.satellites import delays, satellites, tracking
from lvnav_trade.results.tables.read import load
from tests import synthetic


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    return load(synthetic.results(tmp_path_factory.mktemp("reception"), n_run=0))


def bare(tables, **columns):
    """Return the tables of receivers without channels in a flight without faults, columns of satellites replaced."""
    other = type(tables)(tables.folder)
    every = {"tracked": True, "cn0_db_hz": np.nan, "latency_s": 0.0}
    other._read["satellites"] = tables.satellites.assign(**{**every, **columns})
    other._read["transitions"] = tables.transitions.iloc[:0]
    other._read["events"] = tables.events[tables.events.kind == "event"]
    return other


NONE = {"troposphere_m": 0.0, "troposphere_left_m": 0.0, "ionosphere_m": 0.0, "ionosphere_left_m": 0.0}


def test_where_there_is_nothing_to_show_there_is_no_section(tables):
    assert tracking(bare(tables)) == []
    assert delays(bare(tables, **NONE)) == []
    assert not any(isinstance(block, Table) for block in satellites(bare(tables)))


def test_latency_alone_is_shown_without_delays(tables):
    blocks = delays(bare(tables, **NONE, latency_s=0.2))
    assert [block.name for block in blocks if isinstance(block, Picture)] == ["latency-1"]


def test_recovery_and_losses_are_reported_in_tables(tables):
    fixes, losses, recovery = [block for block in tracking(tables) if isinstance(block, Table)]
    assert losses.rows[0] == ("both cases", "fault", "8", "8", "60.0", "60.0")
    assert recovery.rows[0] == ("both cases", "satellite outage 1", "60.0", "75.0", "8", "0", "8", "3", "7", "0")
    assert fixes.rows[0][-2:] == ("18", "8")


def test_delays_are_reported_with_what_is_left(tables):
    rows = {row[1]: row for row in next(block for block in delays(tables) if isinstance(block, Table)).rows}
    assert rows["ionosphere"][2:7] == ("5.00 to 5.00", "5.00", "2.50", "2.50", "2.50")
    assert rows["troposphere"][7].startswith("G01 at 1 s")


def test_satellites_are_reported_with_noise_and_antennas(tables):
    shown = next(block for block in satellites(tables) if isinstance(block, Table))
    assert shown.rows[1][0] == "G02"
    assert shown.rows[1][4:] == ("2", "39.0", "2.00", "0.100")
