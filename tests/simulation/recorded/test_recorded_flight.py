"""Recorded ranges: satellite clocks, modelled delays and the receiver's own clock at the start are taken off."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.recorded_log import read_card
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.recorded.alignment import align
from lvnav_trade.simulation.recorded.navigation_log import read_recording
from lvnav_trade.simulation.recorded.recorded_flight import log_replay
from tests import recorded_log

TIGHT = (
    "base.filter.measurements=[pseudorange, range_rate]", "base.filter.receiver.clock_h0=2e-21",
    "base.filter.receiver.clock_h_minus2=3e-24",
)  # fmt: skip


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drive")
    file, _ = recorded_log.write(folder, ranges=True)
    card = read_card(file)
    log = read_recording(card, folder)
    return cases(load(folder / "drive.yaml", TIGHT))[0].scenario, log, card, align(log, card)


def test_what_is_left_of_ranges_is_their_noise(drive):
    scenario, log, card, aligned = drive
    prepared_case = log_replay(scenario, log, card, aligned).prepared_case
    sky, signals = prepared_case.sky, prepared_case.signals
    epoch = 100
    on = signals.satellite_by_slot[epoch, : signals.n_used[epoch]]
    assert on.size >= 5
    truth = prepared_case.signals.position[epoch]  # the log's solution: a third of a metre off
    off = signals.range[epoch, on] - np.linalg.norm(sky.r_i[epoch, on] - truth, axis=1)
    assert np.std(off) < 4.0 * recorded_log.SIGMA_RANGE
    assert abs(np.mean(off)) < 4.0  # 50 km and 30 m/s of the clock are taken off at the start
    line = sky.r_i[epoch, on] - truth
    rate = np.einsum("ij,ij->i", line, sky.v_i[epoch, on] - signals.velocity[epoch]) / np.linalg.norm(line, axis=1)
    assert np.max(np.abs(signals.rate[epoch, on] - rate)) < 0.5


def test_a_tight_filter_follows_the_drive_by_ranges_alone(drive):
    scenario, log, card, aligned = drive
    prepared_case = log_replay(scenario, log, card, aligned).prepared_case
    assert prepared_case.signals.sigma.max() == 0.0
    run = run_block(prepared_case, 0, 0, 1)
    late = run.t > 30.0
    error, sigma = run.err[0, late, 6:9], np.hypot(run.sigma[0, late, 6:9], recorded_log.SIGMA_P)
    assert np.mean(error**2 / sigma**2) < 2.0
    assert 0.7 < run.nis[0, 50:].sum() / run.n_row[0, 50:].sum() < 1.3
    assert run.failed[0] == 0


def test_satellites_that_the_case_does_not_know_are_named(drive):
    scenario, log, card, aligned = drive
    other = log.ranges._replace(satellites=tuple(f"E{name}" for name in log.ranges.satellites))
    with pytest.raises(InputError, match="at no epoch of the case 4 satellites that it tracks; it has A1, "):
        log_replay(scenario, log._replace(ranges=other), card, aligned)


def test_a_tight_filter_without_ranges_is_refused(drive):
    scenario, log, card, aligned = drive
    with pytest.raises(InputError, match="the filter takes pseudorange, range_rate; the log has position, velocity"):
        log_replay(scenario, log, card.model_copy(update={"ranges": None}), aligned)


def changed(log, values=None, **ranges):
    return log._replace(ranges=log.ranges._replace(values=log.ranges.values if values is None else values, **ranges))


@pytest.mark.parametrize(
    ("factor", "hint"),
    [(-1.0, "its sign is reversed: is it a Doppler shift"), (-1.0 / 0.190294, "a Doppler shift in Hz")],
)
def test_range_rates_of_another_sign_or_unit_are_refused_with_what_they_may_be(drive, factor, hint):
    scenario, log, card, aligned = drive
    values = log.ranges.values * [1.0, factor]
    with pytest.raises(
        InputError, match=rf"range_rate_m_s contradicts the solutions: .* off by more than .*; .*{hint}"
    ):
        log_replay(scenario, changed(log, values), card, aligned)


def test_ranges_to_satellites_of_another_time_are_refused_with_the_time(drive):
    scenario, log, card, aligned = drive
    early = log._replace(epoch="2026-06-01T09:59:42+00:00")  # 18 s of leap seconds
    with pytest.raises(
        InputError, match=r"pseudorange_m contradicts the solutions: .* km; the satellites fit 18\.0 s later"
    ):
        log_replay(scenario, early, card, aligned)


def test_a_wild_range_is_left_out_by_name(drive):
    scenario, log, card, aligned = drive
    values = log.ranges.values.copy()
    values[500, 0] += 3e5
    found, notes = log_replay(scenario, changed(log, values), card, aligned)
    (note,) = notes
    name = log.ranges.satellites[500]
    assert "1 of" in note
    assert f"contradict the solutions, by up to 300 km: left out, by satellite: {name.replace('0', '')} (1)" in note
    whole = log_replay(scenario, log, card, aligned)
    assert whole.notes == ()
    assert found.signals.n_used.sum() == whole.prepared_case.signals.n_used.sum() - 1


def test_satellites_that_the_constellation_lacks_are_named(drive):
    scenario, log, card, aligned = drive
    names = tuple("C05" if k % 9 == 0 else name for k, name in enumerate(log.ranges.satellites))
    _, (note,) = log_replay(scenario, changed(log, satellites=names), card, aligned)
    assert note == f"rows of 1 satellites that the constellation lacks are left out: C05 ({names.count('C05')})"


def test_a_filter_of_ranges_alone_needs_no_rates(drive):
    scenario, log, card, aligned = drive
    alone = scenario.model_copy(
        update={"filter": scenario.filter.model_copy(update={"measurements": ("pseudorange",)})}
    )
    values = log.ranges.values * [1.0, np.nan]
    found = log_replay(alone, changed(log, values), card, aligned).prepared_case
    assert found.signals.n_used.max() >= 5
    assert np.isfinite(found.signals.rate).all()
