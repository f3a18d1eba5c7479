"""Lines of sight of several antennas, what ranges put into a solution, and what the filter is reported."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lvnav_trade.covariance.history import covariance
from lvnav_trade.gnss.constellation import RinexConstellation
from lvnav_trade.gnss.fault_cards import DegradedNoise
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.preparation.signals.lines_of_sight import lines_of
from lvnav_trade.simulation.preparation.signals.receiver_measurements import _solution_shifts
from tests.building import LOOSE, MATCHED, case, hop, loaded, prepare_hop, with_fields

T = np.array([3.0, 12.0, 25.0])
PATCHES = [
    {"name": name, "lever_b": lever, "boresight": boresight, "pattern": {"kind": "cosine", "peak": "4 dBi"}}
    for name, lever, boresight in (
        ("left", ["1 m", "-1 m", "0 m"], [0.0, -1.0, 0.0]), ("right", ["1 m", "1 m", "0 m"], [0.0, 1.0, 0.0]),
    )
]  # fmt: skip


def with_patches(*settings):
    scenario = loaded(MATCHED, *settings)
    return scenario.model_copy(update={"receiver": with_fields(scenario.receiver, antennas=PATCHES)})


def test_the_filter_knows_which_antenna_it_was():
    prepared_case = prepare_hop(with_patches())
    assert prepared_case.model.lever_arms.shape == (2, 3)
    np.testing.assert_array_equal(prepared_case.signals.antenna, prepared_case.sky.antenna)
    loose = prepare_hop(with_patches(LOOSE))
    assert loose.model.lever_arms.shape == (1, 3)


def test_a_common_error_of_all_ranges_is_the_clocks_and_moves_no_solution():
    prepared_case = case(MATCHED, LOOSE)
    line = lines_of(hop(), np.zeros(3), prepared_case.sky)
    shift = _solution_shifts(line, prepared_case.sky.is_tracked, np.full(prepared_case.sky.is_tracked.shape, 30.0))
    np.testing.assert_allclose(shift, 0.0, atol=1e-9)


def test_an_error_along_the_lines_of_sight_moves_the_solution_by_itself():
    prepared_case = case(MATCHED, LOOSE)
    line, wanted = lines_of(hop(), np.zeros(3), prepared_case.sky), np.array([3.0, -5.0, 2.0])
    shift = _solution_shifts(line, prepared_case.sky.is_tracked, -line.sight.direction @ wanted)
    np.testing.assert_allclose(shift, np.tile(wanted, (len(shift), 1)), atol=1e-9)


def test_latency_that_grows_with_satellites_makes_the_measurement_older():
    scenario = loaded(MATCHED)
    receiver = with_fields(scenario.receiver, latency="20 ms", latency_per_satellite="5 ms")
    prepared_case = prepare_hop(scenario.model_copy(update={"receiver": receiver}))
    age = prepared_case.t_epoch - prepared_case.sky.t
    np.testing.assert_allclose(age, 0.02 + 0.005 * case(MATCHED).sky.is_tracked.sum(axis=1), atol=1e-9)


def test_the_variances_of_rows_are_the_squares_of_the_assumed_sigmas():
    matched, own = loaded(MATCHED), loaded(MATCHED)
    model = {
        "pseudorange_sigma": "3 m", "range_rate_sigma": "0.2 m/s", "position_sigma": "5 m", "velocity_sigma": "0.4 m/s",
        "clock_h0": 2e-20, "clock_h_minus2": 3e-23,
    }  # fmt: skip
    own = own.model_copy(update={"filter": with_fields(own.filter, receiver=model)})
    reported, stated = prepare_hop(matched).signals.variance, prepare_hop(own).signals.variance
    np.testing.assert_allclose(reported[:, 0::2], matched.receiver.pseudorange_sigma**2)
    np.testing.assert_allclose(reported[:, 1::2], matched.receiver.range_rate_sigma**2)
    np.testing.assert_allclose(stated[:, 0::2], 9.0)
    np.testing.assert_allclose(stated[:, 1::2], 0.04)


@pytest.mark.parametrize("settings", [(MATCHED,), (MATCHED, LOOSE)], ids=["tight", "loose"])
def test_noise_that_a_fault_has_grown_is_true_and_not_assumed(settings):
    fault = DegradedNoise(factor=5.0, start="5 s", duration="10 s")
    healthy = prepare_hop(loaded(*settings)).signals
    ill = prepare_hop(loaded(*settings).model_copy(update={"faults": (fault,)})).signals
    assert np.nanmax(ill.sigma / healthy.sigma) == pytest.approx(5.0)
    np.testing.assert_array_equal(ill.variance, healthy.variance)


def test_an_ignored_offset_of_a_systems_time_is_in_every_range_of_it_and_in_the_mean_of_both_engines(refdata):
    """A filter that estimates the offset finds it; linear covariance has the same mean as the runs."""
    path = refdata / "gnss/rinex3/VILL00ESP_R_20181700000_01D_MN.rnx.gz"
    flown = replace(hop(), epoch="2018-06-19T12:00:00Z")
    prepared_case = []
    for what in ("applied", "ignored"):
        scenario = loaded(MATCHED)
        card = RinexConstellation(rinex=str(path), systems=["GPS", "Galileo"], time_correction=what)
        prepared_case.append(prepare_hop(scenario.model_copy(update={"constellation": card}), flown))
    applied, ignored = (one.signals for one in prepared_case)
    galileo = np.array(prepared_case[0].sky.systems) == "E"
    off = ignored.range - applied.range
    assert np.count_nonzero(prepared_case[1].sky.is_tracked[:, galileo]) > 0
    np.testing.assert_allclose(off[:, galileo], -6.825, atol=2e-3)
    np.testing.assert_array_equal(off[:, ~galileo], 0.0)
    runs = [run_block(one, 7, 0, 8).err.mean(axis=0)[:, 6:9] for one in prepared_case]
    means = [covariance(one).mean[:, 6:9] for one in prepared_case]
    moved = np.linalg.norm(means[1][-1])
    assert moved > 0.5
    np.testing.assert_allclose(runs[1] - runs[0], means[1] - means[0], atol=5e-3 * moved)


def test_slots_hold_the_tracked_satellites_and_nothing_else():
    prepared_case = case()
    for epoch, slots in enumerate(prepared_case.signals.satellite_by_slot):
        used = slots[: prepared_case.signals.n_used[epoch]]
        np.testing.assert_array_equal(np.sort(used), np.flatnonzero(prepared_case.sky.is_tracked[epoch]))
