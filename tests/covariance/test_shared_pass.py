"""Cases that differ in true sigmas share passes: the same numbers as a pass of their own."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.campaign.definition.axes import cases, with_value
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.search.point import frozen_filter, with_filter
from lvnav_trade.covariance.history import covariance
from lvnav_trade.covariance.shared_pass import covariance_of, is_same_filter, largest_difference, shared_pass
from lvnav_trade.quantities.records import CovHistory
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.preparation.prepare import prepare

STEPS = (
    "imu.gyro.bias_repeatability",
    "imu.accel.random_walk",
    "initial.heading",
    "receiver.pseudorange_sigma",
)
UNITS = ("rad/s", "m/s**1.5", "rad", "m")


def scenario(base: Scenario, sigmas: tuple[float, ...]) -> Scenario:
    data = base.model_dump(mode="json")
    for path, unit, sigma in zip(STEPS, UNITS, sigmas, strict=True):
        data = with_value(data, path.split("."), f"{sigma!r} {unit}")
    return with_filter(Scenario.model_validate(data), base.filter)


@pytest.fixture(scope="module")
def base() -> Scenario:
    """A case whose filter has numbers of its own and no model that follows the truth."""
    found = cases(load("smoke"))[0].scenario
    return with_filter(found, frozen_filter(found))


def passed(base: Scenario, sigmas: tuple[float, ...]) -> CovHistory:
    return covariance(prepare(scenario(base, sigmas), 60.0))


LEAST = (1e-7, 1e-4, 1e-4, 0.5)
LARGEST = (1e-5, 1e-2, 1e-2, 5.0)


def test_a_shared_pass_equals_a_pass_of_its_own(base, record_property) -> None:
    gate = prepare(scenario(base, LEAST), 60.0).model.gate_squared
    raised = [
        passed(base, tuple(LARGEST[k] if k == axis else LEAST[k] for k in range(len(LEAST))))
        for axis in range(len(LEAST))
    ]
    shared = shared_pass(gate, LEAST, LARGEST, passed(base, LEAST), raised)
    rng, worst = np.random.default_rng(5), 0.0
    for _ in range(6):
        sigmas = tuple(np.exp(rng.uniform(np.log(LEAST), np.log(LARGEST))).tolist())
        found, alone = covariance_of(shared, sigmas), passed(base, sigmas)
        worst = max(worst, largest_difference(found, alone))
        np.testing.assert_allclose(found.true_sigma[:, :9], alone.true_sigma[:, :9], rtol=1e-12, atol=0.0)
        # a bias that the filter finds to a thousandth: a pass of its own rounds as much
        np.testing.assert_allclose(found.true_sigma[:, 9:], alone.true_sigma[:, 9:], rtol=1e-11, atol=0.0)
        np.testing.assert_allclose(found.false_rejection, alone.false_rejection, rtol=1e-9, atol=1e-30)
        np.testing.assert_array_equal(found.formal_sigma, alone.formal_sigma)
        assert found.sources == alone.sources
    record_property("largest difference of a shared pass from one of its own", worst)
    assert worst < 1e-11


def test_guided_ascents_share_their_injection() -> None:
    """A guided ascent whose gyro bias varies: the injection's covariance is shared, its other sources stay."""
    guidance = "{card: trajectories/electron_leo, guidance: explicit, dispersion: {draw: [thrust]}}"
    found = cases(load("smoke", (f"base.trajectory={guidance}",)))[0].scenario
    guided = with_filter(found, frozen_filter(found))

    def covariance_with(sigma: float) -> CovHistory:
        data = with_value(guided.model_dump(mode="json"), ["imu", "gyro", "bias_repeatability"], f"{sigma!r} rad/s")
        return covariance(prepare(with_filter(Scenario.model_validate(data), guided.filter), 60.0))

    shared = shared_pass(np.inf, [1e-7], [1e-4], covariance_with(1e-7), [covariance_with(1e-4)])
    mixed, alone = covariance_of(shared, [3e-5]).injection, covariance_with(3e-5).injection
    assert mixed is not None
    assert alone is not None
    assert mixed.sources == alone.sources
    sizes = np.sqrt(np.diagonal(alone.covariance.sum(axis=0)))
    known = np.flatnonzero(np.isfinite(sizes) & (sizes > 0.0))
    scale = np.outer(sizes[known], sizes[known])
    difference = mixed.covariance.sum(axis=0) - alone.covariance.sum(axis=0)
    np.testing.assert_allclose(difference[np.ix_(known, known)] / scale, 0.0, atol=1e-9)
    np.testing.assert_allclose(mixed.knowledge.sum(axis=0), alone.knowledge.sum(axis=0), rtol=1e-9)
    assert not np.allclose(
        alone.knowledge.sum(axis=0), shared.base.injection.knowledge.sum(axis=0), rtol=1e-3, atol=0.0
    )


def test_a_filter_that_follows_the_truth_is_another_filter(base) -> None:
    followed = cases(load("smoke"))[0].scenario
    least, more = (passed(followed, sigmas) for sigmas in (LEAST, (LARGEST[0], *LEAST[1:])))
    assert not is_same_filter(least, more)
    with pytest.raises(ValueError, match="filter is not the same"):
        shared_pass(9.0, LEAST, LARGEST, least, [more])


def test_a_difference_is_found(base) -> None:
    one, other = passed(base, LEAST), passed(base, (2 * LEAST[0], *LEAST[1:]))
    assert largest_difference(one, one) == 0.0
    assert largest_difference(one, other) > 1e-6
