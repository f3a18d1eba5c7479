"""Protection levels: their equation, the separation of filters, and 3000 runs with a satellite failed or not."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy.stats import binom

from lvnav_trade.covariance.diagnostics.protection import (
    exclude_satellite,
    output_columns,
    protection,
    protection_level,
    quantile,
    thresholds,
)
from lvnav_trade.covariance.history import covariance
from lvnav_trade.gnss.fault_cards import RangeBias
from lvnav_trade.quantities.records import ProtectionRisks
from lvnav_trade.simulation.montecarlo import run_block
from tests.building import loaded, prepare_hop

RUNS, SEED, RISK = 3000, 11, 1e-3
SURE = ProtectionRisks(RISK, 1e-3, 1.0)
AT = (5, 15, 30)  # s


@lru_cache(maxsize=8)
def case(*faults):
    scenario = loaded("base.imu=imu/tactical_fog_matched", "base.filter=filters/tight", "base.filter.gate=null")
    return prepare_hop(scenario.model_copy(update={"faults": faults}))


@lru_cache(maxsize=4)
def levels(asked):
    return protection(case(), covariance(case()), asked)


@lru_cache(maxsize=8)
def errors(prior_fault, satellite):
    """Errors (n_run, n_time, 2, 3) of the filter, or of the sub-filter without a satellite, from the same draws."""
    prepared_case = case(*prior_fault)
    chosen = prepared_case if satellite is None else exclude_satellite(prepared_case, satellite)
    return run_block(chosen, SEED, 0, RUNS).err[:, AT][:, :, output_columns(prepared_case)]


@lru_cache(maxsize=1)
def bank():
    """Formal sigmas (n_filter, n_time, 2, 3) of the sub-filters, each without one of the satellites that are named."""
    columns, names = output_columns(case()), case().sky.names
    without = [exclude_satellite(case(), names.index(name)) for name in levels(SURE).satellites]
    return np.array([covariance(one).formal_sigma[:, columns] for one in without])


def test_without_faults_the_level_is_the_quantile_of_a_gaussian():
    sigma = np.array([[1.0, 2.0]])
    found = protection_level(sigma, np.zeros((0, 1, 2)), np.zeros((0, 1, 2)), 2.7e-3, 1e-4)
    assert found == pytest.approx(3.0 * sigma, rel=1e-3)  # 0.27 % are beyond three sigmas


def test_with_one_satellite_failed_for_certain_it_is_the_limit_and_the_quantile_of_the_sub_filter():
    found = protection_level(np.array([1e-9]), np.array([[2.0]]), np.array([[5.0]]), 2.7e-3, 1.0)
    assert found == pytest.approx(5.0 + 3.0 * 2.0, rel=1e-3)


def test_limits_are_of_the_difference_of_the_variances():
    found = thresholds(np.array([3.0]), np.array([[5.0], [3.0]]), 2.0 * 2.7e-3)
    assert found[:, 0] == pytest.approx([3.0 * 4.0, 0.0], rel=1e-3)


def test_a_filter_and_its_sub_filter_are_as_far_apart_as_their_variances():
    """Var(x_0 - x_k) = Var(x_k) - Var(x_0), over the runs, which have the same draws."""
    satellite = int(case().signals.satellite_by_slot[10, 0])
    columns = output_columns(case())
    sigma, without = (
        covariance(one).formal_sigma[list(AT)][:, columns] for one in (case(), exclude_satellite(case(), satellite))
    )
    apart = errors((), None) - errors((), satellite)
    expected = np.sqrt(without**2 - sigma**2)
    clear = expected > 0.05 * sigma  # what a satellite hardly adds is rounding
    assert clear.sum() >= 6
    assert apart.std(axis=0)[clear] == pytest.approx(expected[clear], rel=5.0 / np.sqrt(2.0 * RUNS))


def fault_of(size):
    """Return a step of the range of the satellite that comes first among those in use."""
    name = case().sky.names[int(case().signals.satellite_by_slot[10, 0])]
    return RangeBias(satellites=[name], size=size, **{"from": "2 s"})


def few_enough(count):
    """Whether so many of the runs are no more than the risk allows, but for one chance in 10,000."""
    return binom.sf(count - 1, RUNS, RISK) > 1e-4


def test_without_a_fault_runs_exceed_their_level_as_rarely_as_stated():
    found = levels(SURE._replace(satellite_fault=1e-4))
    size = np.abs(errors((), None))
    for number, at in enumerate(AT):
        for quantity in range(2):
            level = found.level[at, quantity]
            assert few_enough((size[:, number, quantity] > level).any(axis=1).sum())
            assert not few_enough((size[:, number, quantity] > 0.6 * level).any(axis=1).sum())


@pytest.mark.parametrize("size", ["4 m", "8 m", "16 m"])
def test_a_failed_satellite_takes_runs_beyond_their_level_only_with_an_alarm(size):
    """The largest separation that makes no alarm is hit by one of these steps; without alarms many runs are beyond."""
    prepared_case, found = case(), levels(SURE)
    satellite = int(prepared_case.signals.satellite_by_slot[10, 0])
    fault = (fault_of(size),)
    limits = thresholds(found.sigma, np.maximum(bank(), found.sigma), SURE.false_alarm / 6.0)
    own = found.satellites.index(prepared_case.sky.names[satellite])
    whole, apart = errors(fault, None), errors(fault, None) - errors(fault, satellite)
    for number, at in enumerate(AT):
        for quantity in range(2):
            silent = (np.abs(apart[:, number, quantity]) <= limits[own, at, quantity]).all(axis=1)
            out = (np.abs(whole[:, number, quantity]) > found.level[at, quantity]).any(axis=1)
            assert few_enough((silent & out).sum())


def test_an_error_beyond_any_level_of_position_and_velocity_is_as_rare_as_stated():
    risk = 0.1
    found, size = levels(SURE._replace(integrity_risk=risk, satellite_fault=0.0)), np.abs(errors((), None))
    for number, at in enumerate(AT):
        beyond = (size[:, number] > found.level[at]).any(axis=(1, 2)).sum()
        assert binom.sf(beyond - 1, RUNS, risk) > 1e-4
        assert binom.cdf(beyond, RUNS, 0.4 * risk) > 1e-4  # the union bound is not far from the truth


def test_a_false_alarm_on_any_axis_of_position_or_velocity_is_as_rare_as_stated():
    """Separations are Gaussian: with variances of the bank and correlations of 400 runs, 400,000 draws count alarms."""
    found, columns, few = levels(SURE), output_columns(case()), 400
    others = [exclude_satellite(case(), case().sky.names.index(name)) for name in found.satellites]
    whole, *without = (run_block(one, SEED, 0, few).err[:, AT][:, :, columns] for one in (case(), *others))
    variance = bank()[:, list(AT)] ** 2
    sigma = np.sqrt(variance - covariance(case()).formal_sigma[list(AT)][:, columns] ** 2)
    generator = np.random.default_rng(3)
    for number in (1, 2):
        apart = np.stack([whole[:, number] - one[:, number] for one in without], axis=1).reshape(few, -1)
        values, vectors = np.linalg.eigh(np.corrcoef(apart, rowvar=False))
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        ratio = (sigma[:, number] / found.limits[:, AT[number]]).ravel()
        alarms = 0
        for _ in range(400):  # a thousand draws at once stay in the processor's cache
            draws = generator.standard_normal((1000, len(values))) @ root.T
            alarms += np.count_nonzero((np.abs(draws) * ratio > 1.0).any(axis=1))
        share = alarms / 400_000
        assert 0.3 * SURE.false_alarm < share <= SURE.false_alarm


def test_a_large_fault_without_alarms_is_beyond_the_level():
    found, fault = levels(SURE), (fault_of("60 m"),)
    assert (np.abs(errors(fault, None)[:, 2, 0]) > found.level[AT[2], 0]).any(axis=1).mean() > 0.5


def test_levels_name_the_satellite_that_asks_for_most_and_grow_with_what_is_feared():
    cautious, calm = levels(SURE), levels(SURE._replace(satellite_fault=1e-4))
    assert np.all(cautious.level[1:] >= calm.level[1:])
    assert np.all(calm.level >= calm.fault_free_level * (1.0 - 1e-9))
    assert calm.fault_free_level == pytest.approx(quantile(RISK / 6.0) * calm.sigma)
    assert cautious.worst_satellite[-1, 0] >= 0
    assert (
        len(cautious.satellites)
        == np.unique(case().signals.satellite_by_slot[case().signals.satellite_by_slot >= 0]).size
    )
