"""The report section on the injection: numbers, ends, pictures; none without guidance."""

from __future__ import annotations

from lvnav_trade.report.blocks import Picture, Table
from lvnav_trade.report.flight import injection
from lvnav_trade.results.tables.read import load
from tests import synthetic
from tests.injections import with_injections


def test_numbers_ends_and_a_picture_of_the_guided_case(tmp_path):
    plain = load(synthetic.results(tmp_path / "guided", n_run=8, size=8))
    assert injection(plain) == []
    blocks = injection(with_injections(plain))
    numbers, budget, ends, lost = (block for block in blocks if isinstance(block, Table))
    assert numbers.rows[1][:3] == ("imu=fine", "perigee", "km")
    assert budget.rows[-1][4] == "spread of the runs"
    assert {row[3] for row in budget.rows} == {"navigation", "vehicle", ""}
    row = dict(zip(ends.head, ends.rows[0], strict=True))
    assert (row["injected"], row["depleted"], row["failed"]) == ("6", "1", "1")
    assert [one[2] for one in lost.rows] == ["depleted", "navigation failed"]
    assert row["95 %"] == "0.00316 to 0.527"
    assert [block.name for block in blocks if isinstance(block, Picture)] == ["injection-1"]
