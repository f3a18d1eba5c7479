"""Detection, isolation and recovery in flight: faults of known size, and flights without any."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy.stats import binom

from lvnav_trade.covariance.history import covariance
from lvnav_trade.quantities.records import OF_CHANNEL, OF_CLOCK, OF_INERTIAL
from lvnav_trade.simulation.montecarlo import run_block
from tests.building import LOOSE, MATCHED, loaded, prepare_hop, with_fields

RUNS, START = 200, 12.0
DURING = {"start": f"{START} s", "duration": "15 s"}
# More than eight sigmas of the predicted innovation (3 m).
FAULTS = {
    "none": ([], 0),
    "channel": ([{"kind": "range_bias", "size": "30 m", **DURING}], OF_CHANNEL),
    "clock": ([{"kind": "clock_jump", "start": f"{START} s", "size": "30 m"}], OF_CLOCK),
    "inertial": (
        [{"kind": "dead_axis", "sensor": "accelerometer", "axis": 1, "start": "10.4 s", "duration": "1.5 s"},
         {"kind": "satellite_outage", "start": "10.5 s", "duration": "1.4 s"}],
        OF_INERTIAL,
    ),
}  # fmt: skip


@lru_cache(maxsize=16)
def prepared_case(name, *settings):
    faults, _ = FAULTS[name]
    return prepare_hop(with_fields(loaded(MATCHED, *settings), faults=faults, **{"filter.integrity": {"hold": "20 s"}}))


@lru_cache(maxsize=16)
def simulate(name, *settings):
    return run_block(prepared_case(name, *settings), 3, 0, RUNS)


def first_decisions(block):
    """Return time and kind of the first decision of each run that has one, and which runs these are."""
    run, at = np.unique(block.decisions[:, 0], return_index=True)
    return run, block.decisions[at, 1], block.decisions[at, 2]


@pytest.mark.parametrize("settings", [(), (LOOSE,)], ids=["tight", "loose"])
def test_flights_without_a_fault_have_no_more_alarms_than_stated(settings):
    runs = np.unique(simulate("none", *settings).decisions[:, 0]).size
    assert runs <= binom.ppf(1.0 - 1e-4, RUNS, 1e-3)


@pytest.mark.parametrize("name", ["channel", "clock", "inertial"])
def test_what_failed_is_isolated_within_five_epochs(name):
    _, t, kind = first_decisions(simulate(name))
    right = (kind == FAULTS[name][1]) & (t >= START - 1e-9) & (t < START + 4.5)
    assert np.count_nonzero(right) >= 0.95 * RUNS


def test_the_excluded_channel_is_that_of_the_fault():
    block, case = simulate("channel"), prepared_case("channel")
    affected = np.flatnonzero(np.any(case.sky.is_tracked[12:], axis=0) & (case.sky.elevation[12] == np.max(
        np.where(case.sky.is_tracked[12], case.sky.elevation[12], -9.0))))  # fmt: skip
    _, at = np.unique(block.decisions[:, 0], return_index=True)
    named = [case.channel_names[int(c)].split()[0] for c in block.decisions[at, 3]]
    assert named.count(case.sky.names[int(affected[0])]) >= 0.95 * RUNS


@pytest.mark.parametrize("name", ["clock", "inertial"])
def test_inflation_brings_position_and_velocity_back_within_three_epochs(name):
    block, good = simulate(name), simulate("none")
    at = int(np.argmin(np.abs(block.t - (START + 2.0))))
    for states in (slice(3, 6), slice(6, 9)):
        sigma = np.sqrt(np.mean(np.sum(good.err[:, at, states] ** 2, axis=1)))
        assert np.median(np.linalg.norm(block.err[:, at, states], axis=1)) < 3.0 * sigma


def test_a_filter_without_the_tests_keeps_the_error():
    scenario = with_fields(loaded(MATCHED), faults=FAULTS["channel"][0])
    block, at = run_block(prepare_hop(scenario), 3, 0, 40), int(np.argmin(np.abs(simulate("channel").t - 14.0)))
    with_tests = np.linalg.norm(simulate("channel").err[:40, at, 6:9], axis=1)
    assert np.median(np.linalg.norm(block.err[:, at, 6:9], axis=1)) > 3.0 * np.median(with_tests)


@pytest.mark.slow  # the kernel of one run by itself
@pytest.mark.parametrize("name", ["channel", "inertial"])
def test_one_run_decides_as_it_does_among_eight(name):
    one = run_block(prepared_case(name), 3, 0, 2, uses_lanes=False)
    np.testing.assert_array_equal(one.decisions, simulate(name).decisions[simulate(name).decisions[:, 0] < 2])


@pytest.mark.parametrize("name", ["channel", "clock"])
def test_linear_covariance_decides_on_the_mean_and_agrees(name):
    block, history = simulate(name), covariance(prepared_case(name))
    at = [int(np.argmin(np.abs(block.t - t))) for t in (11.0, 13.0, 16.0, 20.0)]
    size = history.true_sigma[at, 3:9]
    off = np.abs(block.err[:, at, 3:9].mean(axis=0) - history.mean[at, 3:9])
    assert np.all(off < 5.0 * size / np.sqrt(RUNS) + 0.05 * np.abs(history.mean[at, 3:9]))
    ratio = block.err[:, at, 3:9].std(axis=0) / size
    assert np.all((ratio > 0.8) & (ratio < 1.25)), ratio.round(2)


@pytest.mark.parametrize("name", ["none", "channel", "clock", "inertial"])
def test_linear_covariance_logs_what_most_runs_decide(name):
    found, (_, t, kind) = covariance(prepared_case(name)).decisions, first_decisions(simulate(name))
    assert len(found) == 0 if name == "none" else len(found) > 0
    if len(found):
        assert found[0, 1] == np.median(t)
        assert found[0, 2] == np.median(kind)
    if name == "channel":
        _, at = np.unique(simulate(name).decisions[:, 0], return_index=True)
        assert found[0, 3] == np.median(simulate(name).decisions[at, 3])


def held(faults, hold="5 s"):
    """Return the flight with faults from 12 s to its end, and a short hold time."""
    during = {"start": f"{START} s", "duration": "60 s"}
    faults = [{**fault, **during} for fault in faults]
    return prepare_hop(with_fields(loaded(MATCHED), faults=faults, **{"filter.integrity": {"hold": hold}}))


def late_errors(block, states):
    """Return the norm of each run's error over the last ten seconds, (n_run, n)."""
    return np.linalg.norm(block.err[:, block.t > block.t[-1] - 10.0][..., states], axis=2)


def test_satellites_that_have_failed_do_not_return_into_the_fit_of_the_sound_ones():
    sky = prepared_case("none").sky
    names = [sky.names[int(k)] for k in np.flatnonzero(sky.is_tracked[12])[:2]]
    ramps = [{"kind": "range_bias", "drift": rate, "satellites": [name]}
             for name, rate in zip(names, ("4 m/s", "-6 m/s"), strict=True)]  # fmt: skip
    case = held(ramps)
    block = run_block(case, 3, 0, 80)
    excluded = {case.channel_names[int(c)].split()[0] for c in block.decisions[:, 3] if c >= 0}
    assert excluded == set(names)
    again = block.decisions[block.decisions[:, 1] > START + 6.0]
    assert np.unique(again[:, 0]).size == 80  # their hold time was over, and they were excluded anew
    sound = np.median(late_errors(simulate("none"), slice(6, 9)))
    assert np.median(late_errors(block, slice(6, 9))) < 2.0 * sound


def test_a_unit_that_stays_wrong_is_learned_after_three_inertial_decisions():
    block = run_block(held([{"kind": "accel_bias_step", "size": ["200 mg", "0 mg", "0 mg"]}]), 3, 0, 80)
    _, _, kind = first_decisions(block)
    assert np.count_nonzero(kind == OF_INERTIAL) >= 0.95 * 80
    _, counts = np.unique(block.decisions[:, 0], return_counts=True)
    assert np.median(counts) < 6  # it is not decided epoch after epoch
    sound = np.median(late_errors(simulate("none"), slice(3, 6)))
    assert np.median(late_errors(block, slice(3, 6))) < 3.0 * sound


def test_a_solution_is_left_out_for_the_hold_time():
    scenario = loaded(MATCHED, LOOSE)
    faults = [{"kind": "spoofing", "velocity": ["40 m/s", "0 m/s", "0 m/s"], "start": "12 s", "duration": "5 s"}]
    case = prepare_hop(with_fields(scenario, faults=faults, **{"filter.integrity": {"hold": "20 s"}}))
    block = run_block(case, 3, 0, 40)
    assert np.unique(block.decisions[:, 0]).size == 40
    assert set(block.decisions[:, 2]) == {OF_CHANNEL}
    at = int(np.argmin(np.abs(block.t - 16.0)))
    assert np.linalg.norm(block.err[:, at, 6:9].mean(axis=0)) < 20.0  # the place is 160 m away
