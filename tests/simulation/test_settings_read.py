"""What of a scenario has an effect: what its preparation reads, and the little that is read after it."""

from __future__ import annotations

from pathlib import Path

import pytest

from lvnav_trade.campaign.definition.axes import Case
from lvnav_trade.covariance.diagnostics.case_diagnostics import diagnose, flight_events
from lvnav_trade.covariance.history import covariance
from lvnav_trade.quantities.reads import FieldReads
from lvnav_trade.quantities.records import CovarianceRequest
from lvnav_trade.results.tables.write import open_results
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.preparation.initial_draws import start_draws
from lvnav_trade.simulation.settings_read import effective_settings
from lvnav_trade.simulation.statistics import summarise
from tests.building import LOOSE, MATCHED, loaded, prepare_hop, with_fields

RADAR = {"radar": {"kind": "altimeter", "name": "a", "source": "b", "sigma": "1 m", "highest": "500 km"}}
LATE = {"kind": "buffered"}


@pytest.mark.parametrize(
    ("settings", "fields"),
    [
        ((MATCHED,), {}),
        ((MATCHED, LOOSE), {"filter.feedback": "open"}),
        ((MATCHED, LOOSE, "base.receiver.latency=0.3 s"), {"filter.delay_compensation": LATE}),
        ((LOOSE,), {"sensors": RADAR, "filter.measurements": ["position", "velocity", "altitude"], "filter.gate": 4.0}),
    ],
    ids=["tight", "open loop", "late", "sensor"],
)
def test_after_its_preparation_a_flight_reads_what_is_said_of_it_and_nothing_else(settings, fields, tmp_path: Path):
    scenario = with_fields(loaded(*settings), **fields)
    reads = FieldReads(scenario)
    prepared_case = prepare_hop(reads.card)
    before = frozenset(reads.paths)
    reads.paths.clear()
    history = covariance(prepared_case)
    runs = run_block(prepared_case, 1, 0, 8)
    summary = summarise(runs, flight_events(prepared_case), history.true_sigma, prepared_case.outputs)
    behind = diagnose(
        reads.card, prepared_case, history, CovarianceRequest(error_bound="sensors" not in fields, window=10.0)
    )
    results = open_results(tmp_path / "results", "study", "", {}, "fresh")
    case = Case("0" * 12, "base", {}, reads.card)
    results.write_case(case, prepared_case, history, [summary], behind, start_draws(prepared_case, 1, 8))
    after = frozenset(reads.paths)
    found = effective_settings(prepared_case, before)
    later = {path for path in after - before if path.rpartition(".")[2] not in ("kind", "name", "source")}
    assert "filter.feedback" in after
    assert later <= set(found.complete_settings)
