"""Redundant inertial units in both engines: selection, test against each other, exclusion."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import binomtest

from lvnav_trade.covariance.history import covariance
from lvnav_trade.gnss.fault_cards import AccelBiasStep, DeadAxis, GyroBiasStep
from lvnav_trade.quantities.records import OF_INERTIAL, OF_UNIT
from lvnav_trade.simulation.montecarlo import run_block
from tests.both_engines.test_closed_forms import NOWHERE, SECONDS, thrusting
from tests.building import INERTIAL, loaded, prepare_hop, with_fields, with_units

RUNS = 240
STEP = GyroBiasStep(unit=2, size=["60 deg/h", "0 deg/h", "0 deg/h"], **{"from": "10 s"})
DEAD = DeadAxis(unit=3, sensor="accelerometer", axis=1, **{"from": "10 s"})


def three(*faults, **fields):
    """Three like units on the hop, tightly coupled; `fields` of the set."""
    scenario = loaded("base.imu=imu/tactical_fog_matched", "base.filter=filters/tight")
    return prepare_hop(with_units(scenario, [{}] * 3, **fields).model_copy(update={"faults": faults}))


def two(*faults, **fields):
    """Two like units on the hop, tightly coupled; `fields` of the set."""
    scenario = loaded("base.imu=imu/tactical_fog_matched", "base.filter=filters/tight")
    return prepare_hop(with_units(scenario, [{}] * 2, **fields).model_copy(update={"faults": faults}))


@pytest.mark.slow  # kernels of their own
def test_two_units_detect_a_failure_that_they_cannot_isolate_and_go_on_with_the_mean():
    reporting, silent = two(STEP, parity={"after_detection": "report"}), two(STEP)
    found, other = run_block(reporting, 5, 0, RUNS), run_block(silent, 5, 0, RUNS)
    run, t, kind, channel = found.decisions.T
    assert np.array_equal(run, np.arange(RUNS))
    assert set(kind) == {OF_INERTIAL}
    assert set(channel) == {-1.0}
    assert np.all(t >= 10.0)
    assert np.median(t) < 14.0
    np.testing.assert_array_equal(found.err, other.err)
    assert not len(other.decisions)
    np.testing.assert_array_equal(covariance(reporting).true_sigma, covariance(silent).true_sigma)


def test_two_units_without_a_fault_raise_as_few_alarms_as_stated():
    level = 0.05
    block = run_block(two(parity={"after_detection": "report", "false_alarm": level}), 5, 0, 2 * RUNS)
    assert binomtest(len(block.decisions), 2 * RUNS, level, "greater").pvalue > 1e-3


def walks(fields, faults=()):
    """Three units with random walk alone, without aiding, on 100 s of thrust along x."""
    scenario = loaded(INERTIAL)
    noise = {"gyro": {"random_walk": "1e-5 rad/s**0.5"}, "accel": {"random_walk": "1e-4 m/s**1.5"}}
    scenario = scenario.model_copy(
        update={
            "imu": with_fields(scenario.imu, rate="100 Hz", **noise),
            "initial": with_fields(scenario.initial, **NOWHERE),
            "frame": "inertial",
        }
    )
    scenario = with_units(scenario, [{}] * 3, **fields).model_copy(update={"faults": faults})
    return prepare_hop(scenario, thrusting())


@pytest.mark.parametrize(
    ("fields", "faults"),
    [
        ({"parity": {}}, (STEP,)),
        ({"parity": {"window": "0.5 s"}, "selection": "mid_value"}, (DEAD,)),
        ({"selection": "mid_value"}, ()),
        ({"selection": "mid_value"}, (STEP,)),
    ],
    ids=["tested, gyro", "middle and tested, dead axis", "middle", "middle, gyro"],
)
def test_runs_are_what_linear_covariance_says(fields, faults):
    prepared_case = three(*faults, **fields)
    found, block = covariance(prepared_case), run_block(prepared_case, 5, 0, RUNS)
    spread, mean = block.err.std(axis=0), block.err.mean(axis=0)
    at = [hist for hist in range(1, prepared_case.t_hist.size) if abs(prepared_case.t_hist[hist] - 10.0) > 1.5]
    sigma = found.true_sigma[at, :9]
    ratio = spread[at, :9] / sigma
    assert np.all(np.abs(ratio - 1.0) < 5.0 / math.sqrt(2.0 * RUNS))
    assert np.abs(ratio - 1.0).mean() < 0.06
    assert np.all(np.abs(mean[at, :9] - found.mean[at, :9]) < 5.0 * sigma / math.sqrt(RUNS))
    if "parity" in fields:
        units = prepared_case.options.imu_array
        when = prepared_case.unit.start + prepared_case.unit.dt * int(
            np.argmax(units.stage != units.stage_without_exclusion)
        )
        run, t, kind, code = block.decisions.T
        assert len(block.decisions) == RUNS == np.unique(run).size
        assert set(kind) == {OF_UNIT}
        assert set(code) == {-2.0 - (faults[0].unit - 1)}
        assert np.all(np.abs(t - when) < prepared_case.scenario.imu.parity.window + 1e-9)


def test_a_random_walk_after_an_exclusion_is_that_of_the_units_that_are_left():
    """N^2 (t / 3 + (T - t) / 2), by source: all of it of the first, of the third what it put in before."""
    fault = AccelBiasStep(unit=3, size=["1 g", "0 g", "0 g"], **{"from": "39.5 s"})
    found = covariance(walks({"parity": {}}, (fault,)))
    before = 40.0
    variance = 1e-10 * (before / 3.0 + (SECONDS - before) / 2.0)
    assert found.true_sigma[-1, 0] == pytest.approx(math.sqrt(variance), rel=1e-3)
    third = found.budget[-1, found.sources.index("unit 3 gyro random walk"), 0]
    assert third == pytest.approx(1e-10 * before / 9.0, rel=1e-3)
    # what the accelerometer put in before: a third of 1 g for half a second
    assert found.mean[-1, 3] == pytest.approx(-9.80665 / 3.0 * 0.5, rel=0.25)


def test_a_random_walk_of_the_middle_reading_is_the_published_one():
    found = covariance(walks({"selection": "mid_value"}))
    assert found.true_sigma[-1, 0] == pytest.approx(math.sqrt(0.448671 * 1e-10 * SECONDS), rel=0.01)


def test_alarms_without_a_fault_are_as_many_as_stated():
    """Tests of white noise are independent: 1 - (1 - a / n)^n of the runs have an alarm."""
    block = run_block(walks({"parity": {"false_alarm": 0.3}}), 7, 0, 400)
    share = binomtest(np.unique(block.decisions[:, 0]).size, 400).proportion_ci(0.999, method="exact")
    assert share.low < 1.0 - math.exp(-0.3) < share.high


@pytest.mark.parametrize("fault", [STEP, DEAD], ids=["gyro", "accelerometer"])
def test_a_filter_knows_what_the_mean_of_the_units_left_is_worth(fault):
    """Formal and true covariance are one for a filter that models everything, before and after an exclusion."""
    prepared_case, whole = three(fault, parity={}), three(parity={})
    history, without = covariance(prepared_case), covariance(whole)
    after = (history.t > 11.5) & (history.t < 40.0)
    np.testing.assert_allclose(history.formal_sigma[after], history.true_sigma[after], rtol=2e-3)
    sensor = "gyro_bias" if fault is STEP else "accel_bias"
    states = [k for k, output in enumerate(prepared_case.outputs) if output.quantity == sensor]
    assert np.all(history.formal_sigma[after][:, states] > 1.05 * without.formal_sigma[after][:, states])
    block = run_block(prepared_case, 5, 0, 16)
    np.testing.assert_allclose(
        block.sigma[:, after].mean(axis=0), history.formal_sigma[after], rtol=5e-2
    )  # a dead axis moves what runs are linearised at


PRIME = {"selection": "prime", "hand_over": "20 s"}


def spread_over_sigma(prepared_case, skipped=()):
    """Standard deviation of the runs over the true sigma at the history times, those near a fault left out."""
    found, block = covariance(prepared_case), run_block(prepared_case, 5, 0, RUNS)
    away = [k for k, t in enumerate(prepared_case.t_hist) if k and all(abs(t - at) > 1.5 for at in skipped)]
    sigma = found.true_sigma[away, :9]
    assert np.all(np.abs(block.err.mean(axis=0)[away, :9] - found.mean[away, :9]) < 5.0 * sigma / math.sqrt(RUNS))
    return block, block.err.std(axis=0)[away, :9] / sigma


def test_a_prime_unit_is_the_unit_alone_until_its_hand_over():
    alone = prepare_hop(loaded("base.imu=imu/tactical_fog_matched", "base.filter=filters/tight"))
    prime = two(**PRIME)
    one, other = run_block(alone, 5, 0, 8), run_block(prime, 5, 0, 8)
    before = alone.t_hist < 20.0
    np.testing.assert_array_equal(other.err[:, before], one.err[:, before])
    np.testing.assert_array_equal(other.sigma[:, before], one.sigma[:, before])
    after = alone.t_hist > 25.0
    assert np.abs(other.err[:, after] - one.err[:, after]).max() > 0.0
    run, t, kind, code = other.decisions.T
    assert (run.tolist(), set(t), set(kind), set(code)) == (list(range(8)), {20.0}, {OF_UNIT}, {-2.0})


def test_both_engines_hand_over_at_a_time():
    _, ratio = spread_over_sigma(two(**PRIME))
    assert np.all(np.abs(ratio - 1.0) < 5.0 / math.sqrt(2.0 * RUNS))
    assert np.abs(ratio - 1.0).mean() < 0.06


@pytest.mark.parametrize("unit", [1, 2], ids=["prime fails", "redundant unit fails"])
def test_both_engines_hand_over_at_a_detected_failure_whichever_unit_has_failed(unit):
    """Two units do not show which of them has failed, so a failure of the redundant unit hands over to it."""
    fault = STEP.model_copy(update={"unit": unit})
    block, ratio = spread_over_sigma(
        two(fault, selection="prime", parity={"after_detection": "hand_over"}), skipped=(10.0, 11.0, 12.0)
    )
    assert np.abs(ratio - 1.0).mean() < 0.06
    assert block.decisions[:, 0].tolist() == list(range(RUNS))
    assert set(block.decisions[:, 3]) == {-2.0}
    at_end = np.abs(block.err[:, -1, 0]).mean()
    healthy = np.abs(run_block(two(**PRIME), 5, 0, RUNS).err[:, -1, 0]).mean()
    assert (at_end > 3.0 * healthy) == (unit == 2)


def test_a_random_walk_with_a_hand_over_is_that_of_the_unit_in_use():
    """N^2 T in all: of the prime until the hand-over, of the redundant unit from then on, nothing of a third."""
    found = covariance(walks({"selection": "prime", "hand_over": "40 s"}))
    assert found.true_sigma[-1, 0] == pytest.approx(math.sqrt(1e-10 * SECONDS), rel=1e-6)
    by_source = dict(zip(found.sources, found.budget[-1, :, 0], strict=True))
    assert by_source["unit 1 gyro random walk"] == pytest.approx(1e-10 * 40.0, rel=1e-6)
    assert by_source["unit 2 gyro random walk"] == pytest.approx(1e-10 * (SECONDS - 40.0), rel=1e-6)
    assert by_source["unit 3 gyro random walk"] == pytest.approx(0.0, abs=1e-24)


def test_a_filter_knows_what_a_hand_over_does_to_its_biases():
    """Formal and true covariance are one for a filter that models everything, before and after the hand-over."""
    history = covariance(two(**PRIME))
    away = (np.abs(history.t - 20.0) > 0.5) & (history.t > 0.0)
    np.testing.assert_allclose(history.formal_sigma[away], history.true_sigma[away], rtol=5e-3)
