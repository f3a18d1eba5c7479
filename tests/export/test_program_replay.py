"""The filter in C, compiled, is the filter of the simulation: recorded runs are replayed."""

from __future__ import annotations

import pytest

from lvnav_trade.export.code import translate_filter
from lvnav_trade.export.program_replay import LIMIT, flight_bytes, run_bytes
from tests.both_engines.combinations import scenario_of
from tests.both_engines.covering import covering, refusal
from tests.both_engines.short_flights import flight
from tests.building import prepare_hop, with_fields
from tests.export.cases import FIRST, build, compiled, prepared_of, replay, write
from tests.export.translation.compiled import needs_compiler

TIGHT = {"measurements": "ranges", "correction": "closed"}
FLOWN = [number for number, case in enumerate(covering()) if not refusal(case)]


@needs_compiler
def test_ten_runs_replay_to_a_billionth_of_the_state(tmp_path, record_property):
    prepared_case = prepared_of(TIGHT)
    write(tmp_path, prepared_case, translate_filter(prepared_case, "Tight."), 10)
    build(tmp_path)
    code, table = replay(tmp_path, 10)
    assert code == 0
    assert table.run.nunique() == 10
    assert set(table.estimate) == {"attitude", "velocity", "position", "x", "par", "clock_hat", "variance", "sigmas"}
    assert table.times.min() >= prepared_case.t_epoch.size
    assert table.difference.max() <= LIMIT
    record_property("largest difference of ten replayed runs", table.difference.max())

    # and what differs is found: the Earth's mass off by a millionth
    source = tmp_path / "nav_filter.c"
    assert source.read_text().count("398600441800000.0") > 0
    source.write_text(source.read_text().replace("398600441800000.0", "398600841800000.0"))
    build(tmp_path)
    code, table = replay(tmp_path, 10)
    assert code == 1
    assert 1e-12 < table[table.estimate == "position"].difference.max() < 1e-7


@needs_compiler
def test_the_reported_covariance_of_a_solution_is_replayed(tmp_path):
    prepared_case = prepared_of({"measurements": "solution", "receiver": "filtered"})
    assert prepared_case.model.has_reported_covariance
    code, table = compiled(tmp_path, {"measurements": "solution", "receiver": "filtered"})
    assert code == 0
    assert table.difference.max() <= LIMIT


def test_a_recording_has_what_varies_and_nothing_else():
    prepared_case = prepared_of(TIGHT)
    made = translate_filter(prepared_case, "Tight.")
    n_epoch, n_sat, n_slot = (
        prepared_case.t_epoch.size,
        len(prepared_case.sky.names),
        prepared_case.signals.satellite_by_slot.shape[1],
    )
    assert set(made.inputs["epoch"]) == {"satellite_by_slot", "n_used", "satellite_position", "satellite_velocity"}
    windows = prepared_case.schedule.n_tick.size * (3 + len(made.inputs["window"]))
    assert len(flight_bytes(prepared_case, made)) == 8 * (1 + windows + n_epoch * (n_slot + 1 + 6 * n_sat))
    n_state = prepared_case.layout.n_state
    compared = 10 + 2 * n_state + 6 + 2
    times = (prepared_case.schedule.epoch >= 0).sum() + (prepared_case.schedule.epoch[-1] < 0)
    measured = n_epoch * prepared_case.signals.satellite_by_slot.shape[1] * 2
    size = 10 + 6 * len(prepared_case.unit.dtheta) + measured + compared * times
    assert len(run_bytes(prepared_case, made, 4, 0)) == 8 * size


@pytest.mark.slow
@needs_compiler
@pytest.mark.parametrize("number", FLOWN)
def test_every_case_of_the_matrix_replays(tmp_path, number):
    code, table = compiled(tmp_path, covering()[number])
    assert code == 0, table
    assert table.difference.max() <= LIMIT


@needs_compiler
def test_a_strapdown_in_local_axes_with_savages_recursion_replays(tmp_path):
    scenario, kind, _ = scenario_of(FIRST | TIGHT)
    form = {"strapdown": {"algorithm": "recursive", "ratio": 2}, "mechanisation": "ned"}
    prepared_case = prepare_hop(
        scenario.model_copy(update={"filter": with_fields(scenario.filter, **form)}), flight(kind)
    )
    write(tmp_path, prepared_case, translate_filter(prepared_case, "Local axes."), 1)
    build(tmp_path)
    code, table = replay(tmp_path, 1)
    assert code == 0, table
    assert table.difference.max() <= LIMIT
