"""Blocks of runs: the same numbers however they are cut, consistent statistics, failures distinguished."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from lvnav_trade.simulation import montecarlo as room
from lvnav_trade.simulation.montecarlo import replay, run_block
from tests.building import INERTIAL, LOOSE, MATCHED, case, flying, hop, loaded, prepare_hop, with_fields

SEED = 20260801
NUMBERS = ("err", "sigma", "nees", "nis", "n_row", "n_reject", "innovation", "failed", "t_failed")


def same(one, other):
    """Whether two blocks hold the same bits."""
    return all(np.array_equal(getattr(one, n), getattr(other, n), equal_nan=True) for n in NUMBERS)


def part(block, first, count):
    """Runs of a block, by their place in it."""
    at = slice(first, first + count)
    return block._replace(first_run=block.first_run + first, **{n: getattr(block, n)[at] for n in NUMBERS})


def largest_difference(one, other, prepared_case):
    """Largest difference of two blocks' errors and sigmas, in sigmas."""
    off = [np.abs(getattr(one, n) - getattr(other, n)) / one.sigma for n in ("err", "sigma")]
    return max(float(array.max()) for array in off)


# ------------------------------------------------------------------------------------------------------- determinism


@pytest.fixture(scope="module")
def block():
    return run_block(case(), SEED, 0, 24)


@pytest.mark.parametrize(("first", "count"), [(0, 24), (0, 8), (5, 1), (3, 13), (23, 1), (16, 7)])
def test_a_run_has_the_same_bits_alone_and_in_any_block_of_any_size(block, first, count):
    assert same(run_block(case(), SEED, first, count), part(block, first, count))


def test_blocks_have_the_shapes_that_their_record_promises(block):
    prepared_case = case()
    n_hist, n_epoch, n_out = prepared_case.t_hist.size, prepared_case.t_epoch.size, len(prepared_case.outputs)
    assert block.err.shape == block.sigma.shape == (24, n_hist, n_out)
    assert block.nees.shape == (24, n_hist)
    assert block.nis.shape == block.n_row.shape == block.n_reject.shape == (24, n_epoch)
    assert block.innovation.shape == (24, n_epoch, len(prepared_case.channel_names))
    assert (block.failed.dtype, block.n_row.dtype) == (np.int8, np.int32)
    assert not block.failed.any()
    assert np.isnan(block.t_failed).all()


def test_another_seed_gives_other_runs(block):
    assert not np.any(run_block(case(), SEED + 1, 0, 8).err[:, 1:] == block.err[:8, 1:])


def test_runs_differ_from_one_another(block):
    assert len({run.tobytes() for run in block.err}) == 24


@pytest.mark.parametrize("settings", [(), (LOOSE,), (INERTIAL,), ("base.filter=filters/tight_extended",)])
def test_lanes_are_one_run_at_a_time_below_1e_8_sigma(settings):
    prepared_case = case(*settings)
    assert largest_difference(
        run_block(prepared_case, SEED, 0, 8), run_block(prepared_case, SEED, 0, 8, uses_lanes=False), prepared_case
    ) < 1e-8  # fmt: skip


def gated(gate=1.5, **fields):
    scenario = loaded(MATCHED)
    return scenario.model_copy(update={"filter": with_fields(scenario.filter, gate=gate, **fields)})


def test_runs_may_differ_in_what_the_gate_decides():
    prepared_case = prepare_hop(gated())
    block, alone = run_block(prepared_case, SEED, 0, 8), run_block(prepared_case, SEED, 0, 8, uses_lanes=False)
    assert len({tuple(counts) for counts in block.n_reject}) == 8
    assert np.all(block.n_row + block.n_reject == 2 * prepared_case.signals.n_used)
    np.testing.assert_array_equal(block.n_reject, alone.n_reject)
    assert largest_difference(block, alone, prepared_case) < 1e-8
    assert same(run_block(prepared_case, SEED, 3, 2), part(block, 3, 2))


def test_a_gate_rejects_what_lies_beyond_it_and_nothing_else():
    prepared_case = prepare_hop(gated(2.0))
    block = run_block(prepared_case, SEED, 0, 8)
    beyond = np.abs(block.innovation) > 2.0
    np.testing.assert_array_equal(beyond.sum(axis=2), block.n_reject)
    inside = np.where(np.abs(block.innovation) <= 2.0, block.innovation, 0.0)
    np.testing.assert_allclose(np.sum(inside**2, axis=2), block.nis, rtol=1e-12)


# ------------------------------------------------------------------------------------------------------------- replay


@pytest.mark.parametrize("rate", ["10 Hz", "3 Hz", "7 Hz", "200 Hz"])
@pytest.mark.parametrize("run", [0, 13])
def test_replay_is_the_block_bit_for_bit_with_every_covariance_step(rate, run):
    scenario = loaded()
    scenario = scenario.model_copy(update={"filter": with_fields(scenario.filter, covariance_rate=rate)})
    with flying(hop()):
        prepared_case = room.prepare(scenario)
        block = run_block(prepared_case, SEED, 8, 8)
        again = replay(prepared_case, SEED, run)
    if run < 8:
        block = run_block(prepared_case, SEED, 0, 8)
    place = run % 8
    shared = np.isin(np.round(again.t, 9), np.round(block.t, 9))
    assert shared.sum() == block.t.size
    assert again.t.size >= prepared_case.schedule.n_tick[prepared_case.schedule.n_tick > 0].size
    np.testing.assert_array_equal(again.err[0, shared], block.err[place])
    np.testing.assert_array_equal(again.sigma[0, shared], block.sigma[place])
    np.testing.assert_array_equal(again.nis[0], block.nis[place])
    np.testing.assert_array_equal(again.innovation[0], block.innovation[place])


# ------------------------------------------------------------------------------------- noise that does not depend on it


def drawn(prepared_case, run=3):
    """What is drawn in a run: last window's increments, true parameters, clock, and last ranges by satellite name."""
    work, _ = room._simulate(prepared_case, SEED, run, False)
    used = prepared_case.signals.satellite_by_slot[-1, : prepared_case.signals.n_used[-1]]
    ranges = {prepared_case.sky.names[s]: tuple(work.ranges[slot]) for slot, s in enumerate(used)}
    return work.increments.copy(), work.true_par.copy(), work.clock.copy(), ranges


def test_another_filter_leaves_every_draw_as_it_was():
    base = drawn(case())
    other = drawn(prepare_hop(gated(3.0, extra_states=["gyro_scale_factor"], covariance_rate="5 Hz").model_copy(
        update={"imu": loaded().imu}
    )))  # fmt: skip
    # windows are longer there; the filter takes its own estimate off the increments, the truth's part is in true_par
    np.testing.assert_array_equal(other[1], base[1])
    np.testing.assert_array_equal(other[2], base[2])
    assert other[3] == base[3]


@pytest.mark.parametrize("change", [{"mask": "40 deg"}, {"channels": 5}])
def test_another_mask_or_satellite_count_leaves_the_noise_of_the_others_as_it_was(change):
    scenario = loaded()
    other = prepare_hop(scenario.model_copy(update={"receiver": with_fields(scenario.receiver, **change)}))
    base, fewer = drawn(case()), drawn(other)
    assert 0 < len(fewer[3]) < len(base[3])
    np.testing.assert_array_equal(fewer[1], base[1])
    np.testing.assert_array_equal(fewer[2], base[2])
    for name, values in fewer[3].items():
        assert values == base[3][name]


def test_without_aiding_the_runs_fly_the_same_noise_whatever_the_receiver():
    scenario = loaded(INERTIAL)
    other = scenario.model_copy(
        update={"receiver": with_fields(scenario.receiver, pseudorange_sigma="9 m", channels=4)}
    )
    one, two = run_block(case(INERTIAL), SEED, 0, 8), run_block(prepare_hop(other), SEED, 0, 8)
    np.testing.assert_array_equal(one.err, two.err)


# -------------------------------------------------------------------------------------------------- matched statistics

N_RUN, ALPHA = 400, 1e-3


@pytest.mark.parametrize("settings", [(MATCHED,), (MATCHED, LOOSE)], ids=["tight", "loose"])
def test_a_matched_filter_is_consistent(settings):
    """NEES at ten times and NIS of all rows, within chi-square bounds of family-wise 1e-3, sigma from the filter."""
    prepared_case = case(*settings)
    block = run_block(prepared_case, SEED, 0, N_RUN)
    states, each = prepared_case.layout.n_estimated, ALPHA / 11.0
    for hist in np.linspace(0, prepared_case.t_hist.size - 1, 10).astype(int):
        low, high = stats.chi2.ppf([0.5 * each, 1.0 - 0.5 * each], N_RUN * states)
        assert low < block.nees[:, hist].sum() < high
    low, high = stats.chi2.ppf([0.5 * each, 1.0 - 0.5 * each], block.n_row.sum())
    assert low < block.nis.sum() < high


@pytest.mark.parametrize("settings", [(MATCHED,), (MATCHED, LOOSE)], ids=["tight", "loose"])
def test_innovations_of_a_matched_filter_are_white(settings):
    prepared_case = case(*settings)
    z = run_block(prepared_case, SEED, 0, N_RUN).innovation
    seen = np.isfinite(z[0]).all(axis=0)
    n_channel = int(seen.sum())
    limit = stats.norm.isf(0.5 * ALPHA / (2 * n_channel))
    for channel in np.flatnonzero(seen):
        now, before = z[:, 1:, channel].ravel(), z[:, :-1, channel].ravel()
        assert abs(np.mean(now * before)) * np.sqrt(now.size) < limit
        assert abs(np.mean(now)) * np.sqrt(now.size) < limit


# -------------------------------------------------------------------------------------------- outages, failures, limits


def outage(start, duration, *settings, **fields):
    faults = [{"kind": "satellite_outage", "start": start, "duration": duration, **fields}]
    scenario = loaded(MATCHED, *settings)
    return prepare_hop(type(scenario).model_validate(scenario.model_dump(mode="json") | {"faults": faults}))


def test_an_outage_takes_the_rows_away_for_its_time_and_the_filter_knows_it():
    prepared_case = outage("9.5 s", "8 s")
    block = run_block(prepared_case, SEED, 0, 8)
    without = (prepared_case.t_epoch >= 9.5) & (prepared_case.t_epoch < 17.5)
    assert np.all(block.n_row[:, without] == 0)
    assert np.all(block.n_row[:, ~without] > 0)
    assert np.isnan(block.innovation[:, without]).all()
    at = {t: int(np.flatnonzero(prepared_case.t_hist == t)[0]) for t in (9.0, 17.0, 18.0)}
    assert np.all(block.sigma[:, at[17.0], 3:9] > block.sigma[:, at[9.0], 3:9])
    assert np.all(block.sigma[:, at[18.0], 6:9] < block.sigma[:, at[17.0], 6:9])
    assert not block.failed.any()


def test_a_loose_filter_has_no_row_below_four_satellites_and_a_tight_one_has_them_all():
    loose, tight = (outage("9.5 s", "8 s", *settings, keep=3) for settings in ((LOOSE,), ()))
    without = (loose.t_epoch >= 9.5) & (loose.t_epoch < 17.5)
    rows = run_block(loose, SEED, 0, 8).n_row
    assert np.all(rows[:, without] == 0)
    assert np.all(rows[:, ~without] == 6)
    assert np.all(run_block(tight, SEED, 0, 8).n_row[:, without] == 6)
    assert np.all(run_block(outage("9.5 s", "8 s", LOOSE, keep=4), SEED, 0, 8).n_row == 6)


def test_a_run_beyond_the_limit_is_flagged_as_diverged_with_the_time_when_it_first_was():
    scenario = loaded(INERTIAL)
    prepared_case = prepare_hop(with_fields(scenario, diverged="4 m"))
    block = run_block(prepared_case, SEED, 0, 24)
    distance = np.linalg.norm(block.err[:, :, 6:9], axis=2)
    beyond = distance > 4.0
    assert 0 < beyond.any(axis=1).sum()
    np.testing.assert_array_equal(block.failed == 2, beyond.any(axis=1))
    for run in np.flatnonzero(beyond.any(axis=1)):
        assert block.t_failed[run] == prepared_case.t_hist[np.argmax(beyond[run])]
    assert np.isnan(block.t_failed[~beyond.any(axis=1)]).all()


def test_a_run_that_is_no_longer_a_number_is_flagged_when_its_position_is_none():
    prepared_case = case(MATCHED)
    start = prepared_case.initial_state
    beyond_floats = np.array([1e160, 1.0, 1.0])[:, None, None]  # of the attitude: its square overflows
    block = run_block(
        prepared_case._replace(initial_state=start._replace(roots=start.roots * beyond_floats)), SEED, 0, 8
    )
    assert np.all(block.failed == 1)
    assert np.all(block.t_failed == prepared_case.t_hist[1])
    assert not run_block(prepared_case, SEED, 0, 8).failed.any()
