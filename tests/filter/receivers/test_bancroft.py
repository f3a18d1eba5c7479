"""Point solutions against a published example, converged least squares and Monte Carlo; none from three satellites."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from lvnav_trade.filter.receivers.bancroft import fix, slot_measurement, solution
from lvnav_trade.filter.receivers.receiver import (
    CONSISTENT,
    FIX_BIAS,
    FIX_DRIFT,
    INCONSISTENT,
    NO_FIX,
    UNTESTED,
    ReportedCovariance,
    new_receiver,
    point_model,
)
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import view
from lvnav_trade.kernels.vector import WIDTH
from tests.filter.receivers.scenes import ascending, clocks, errors, measure, point_runs, scene, standing, true_ranges

OWN = ReportedCovariance()
MODEL = point_model(OWN, 2.0, 0.1)
CLOSED = point_model(OWN, 2.0, 0.1, refinements=0)

# A worked example of four satellites, Earth-fixed at reception: position, pseudorange (m), and its answer.
SATELLITES = np.array([
    [-12005459.353, 22848755.674, 5796967.796], [-26293588.245, -625514.504, -4190661.860],
    [-6559774.102, 22208149.128, 13685049.829], [3709341.143, 24439380.765, 9629909.454],
])  # fmt: skip
RANGES = np.array([21103816.114230197, 24293188.495801315, 21325719.850603405, 22938884.45379082])
ANSWER, ANSWER_BIAS = np.array([-3721817.095, 3545589.644, 3763571.160]), 128.0546


def solve(model, satellite, moving, ranges, near=(0.0, 0.0, 0.0), slots=None):
    receiver = new_receiver()
    receiver.position_guess[:] = near
    slots = np.arange(len(satellite)) if slots is None else np.array(slots)
    quality = fix(receiver, model, satellite, moving, slots, len(slots), ranges)
    return receiver, quality


def with_rates(ranges, rates=0.0):
    return np.column_stack([ranges, np.full(len(ranges), rates)])


@pytest.mark.parametrize("model", [CLOSED, MODEL])
def test_the_worked_example_comes_out_to_a_millimetre(model):
    """The example prints millimetres and 0.1 mm of the clock's bias."""
    receiver, quality = solve(model, SATELLITES, np.zeros((4, 3)), with_rates(RANGES))
    np.testing.assert_allclose(receiver.fix[:3], ANSWER, rtol=0, atol=1e-3)
    assert receiver.fix[FIX_BIAS] == pytest.approx(ANSWER_BIAS, abs=1e-3)
    assert quality == UNTESTED


def test_the_other_root_of_the_example_is_not_taken_even_by_a_receiver_that_looks_there():
    """At |r| = 9252314 m all four distances are those of the pseudoranges, with the wrong sign."""
    sign, rows = np.array([1.0, 1.0, 1.0, -1.0]), np.column_stack([SATELLITES, RANGES])
    u, v = np.linalg.solve(rows, np.column_stack([np.ones(4), 0.5 * rows**2 @ sign])).T
    roots = [sign * (root * u + v) for root in np.roots([u * sign @ u, 2.0 * (u * sign @ v - 1.0), v * sign @ v])]
    other = max(roots, key=lambda y: np.linalg.norm(y[:3]))
    assert np.linalg.norm(other[:3]) == pytest.approx(9252314.0, abs=1.0)
    receiver, _ = solve(CLOSED, SATELLITES, np.zeros((4, 3)), with_rates(RANGES), near=other[:3])
    np.testing.assert_allclose(receiver.fix[:3], ANSWER, rtol=0, atol=1e-3)


def test_where_the_receiver_looks_decides_between_places_that_fit_alike():
    """Four satellites in a plane cannot tell a place from its mirror image; a fifth outside the plane can."""
    satellite = np.array([[2e7, 1.2e7, 3e6], [2e7, -9e6, 8e6], [2e7, 2e6, -1.1e7], [2e7, 5e6, 1.3e7]])
    place, image = np.array([6.5e6, 1e6, -4e5]), np.array([3.35e7, 1e6, -4e5])
    z = with_rates(np.linalg.norm(satellite - place, axis=1) + 700.0)
    for wanted in (place, image):
        receiver, quality = solve(MODEL, satellite, np.zeros((4, 3)), z, near=wanted + np.array([4e5, -3e5, 2e5]))
        np.testing.assert_allclose(receiver.fix[:3], wanted, rtol=0, atol=1e-5)
        assert quality == UNTESTED
    satellite = np.vstack([satellite, [1.7e7, -1e7, -1.2e7]])
    z = with_rates(np.linalg.norm(satellite - place, axis=1) + 700.0)
    receiver, _ = solve(MODEL, satellite, np.zeros((5, 3)), z, near=image)
    np.testing.assert_allclose(receiver.fix[:3], place, rtol=0, atol=1e-5)


def test_a_root_that_the_pseudoranges_contradict_is_rejected_from_wherever_one_looks():
    at = scene(np.zeros(1), standing, n_sat=7)
    z = true_ranges(at)[0] + [-4000.0, 12.0]
    wrong = new_receiver()
    for near in (at.r_i[0], np.zeros(3), 3.0 * at.r_i[0], -at.r_i[0]):
        wrong, quality = solve(MODEL, at.satellite[0], at.moving[0], z, near=near)
        np.testing.assert_allclose(wrong.fix[:3], at.r_i[0], rtol=0, atol=1e-6)
        assert quality == CONSISTENT


def least_squares_solution(satellite, moving, z):
    """Position and clock from the ranges by scipy, then velocity and drift from the rates, which are linear in them."""

    def residual(y):
        return np.linalg.norm(satellite - y[:3], axis=1) + y[3] - z[:, 0]

    def design(y):
        line = satellite - y[:3]
        return np.column_stack([-line / np.linalg.norm(line, axis=1)[:, None], np.ones(len(z))])

    found = np.zeros(4)
    for _ in range(2):  # the second time its stopping rules are relative to the residuals that are left
        found = least_squares(residual, found, design, method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    rows = design(found)
    rates = np.linalg.lstsq(rows, z[:, 1] + np.sum(rows[:, :3] * moving, axis=1), rcond=None)[0]
    return np.concatenate([found[:3], rates[:3], [found[3], rates[3]]])


@pytest.mark.parametrize("seed", range(12))
def test_with_noise_it_is_the_converged_least_squares_of_an_independent_solver(seed):
    rng = np.random.default_rng(seed)
    motion = ascending if seed % 2 else standing
    at = scene(np.arange(0.0, 61.0, 10.0), motion, n_sat=int(rng.integers(4, 11)), seed=seed + 50)
    clock = np.full((7, 2, 1), [[3e5 * rng.standard_normal()], [rng.standard_normal()]])
    z = measure(at, clock, rng)[-1, :, :, 0]
    receiver, quality = solve(MODEL, at.satellite[-1], at.moving[-1], z, near=[6.5e6, 0.0, 0.0])
    expected = least_squares_solution(at.satellite[-1], at.moving[-1], z)
    dilution = np.sqrt(np.trace(receiver.inverse))
    np.testing.assert_allclose(receiver.fix, expected, rtol=0, atol=1e-5 * dilution)
    assert quality == UNTESTED if len(z) == 4 else quality in (INCONSISTENT, CONSISTENT)


def test_the_closed_form_alone_is_exact_without_noise_whatever_the_geometry():
    for seed in range(30):
        at = scene(np.zeros(1), standing, n_sat=4 + seed % 6, seed=seed)
        receiver, _ = solve(
            CLOSED, at.satellite[0], at.moving[0], true_ranges(at)[0] + [1e5, -30.0], near=[6.5e6, 0, 0]
        )
        dilution = np.sqrt(np.trace(receiver.inverse))
        np.testing.assert_allclose(receiver.fix[:3], at.r_i[0], rtol=0, atol=1e-6 * max(1.0, dilution))
        np.testing.assert_allclose(receiver.fix[3:6], at.v_i[0], rtol=0, atol=1e-8 * max(1.0, dilution))
        assert receiver.fix[FIX_DRIFT] == pytest.approx(-30.0, abs=1e-8 * max(1.0, dilution))


def spread(model, at, n_run=8000):
    rng = np.random.default_rng(8)
    z = measure(at, np.zeros((1, 2, n_run)), rng)
    out, quality = point_runs(at, model, z)
    return errors(at, out)[0], quality[0]


@pytest.mark.parametrize(("model", "n_sat", "excess"), [(MODEL, 4, 0.0), (MODEL, 8, 0.0), (CLOSED, 8, 0.005)])
def test_the_covariance_is_that_of_the_errors_of_many_runs(model, n_sat, excess):
    """Closed form alone: rows weigh as the square of their distance, 0.2 % of sigma with these eight satellites."""
    at = scene(np.zeros(1), standing, n_sat=n_sat)
    n_run = 8000
    error, _ = spread(model, at, n_run)
    receiver = new_receiver()
    receiver.position_guess[:] = at.r_i[0]
    solution(receiver, model, at.satellite[0], at.moving[0], at.used[0], n_sat, true_ranges(at)[0])
    # brought to the covariance's own axes every component has variance one: 4.5 sigma of n_run draws
    root = np.linalg.inv(np.linalg.cholesky(receiver.covariance))
    variance = np.cov(root @ error)
    bound = 4.5 * np.sqrt(2.0 / n_run)
    assert np.abs(np.diag(variance) - 1.0).max() < bound + 2.0 * excess
    assert np.abs(variance - np.diag(np.diag(variance))).max() < 4.5 / np.sqrt(n_run) + excess
    assert np.abs(np.mean(root @ error, axis=1)).max() < 4.5 / np.sqrt(n_run)


def test_the_closed_form_alone_is_never_more_precise_than_least_squares():
    at = scene(np.zeros(1), standing, n_sat=8)
    closed, refined = spread(CLOSED, at)[0], spread(MODEL, at)[0]
    assert np.sum(closed[:3] ** 2) > np.sum(refined[:3] ** 2)


def test_good_measurements_are_called_inconsistent_as_often_as_said_and_a_wild_one_always():
    at = scene(np.zeros(1), standing, n_sat=7)
    _, quality = spread(point_model(OWN, 2.0, 0.1, false_alarm=0.05), at)
    share = np.mean(quality == INCONSISTENT)
    assert share == pytest.approx(0.05, abs=4.5 * np.sqrt(0.05 * 0.95 / quality.size))
    assert np.all((quality == INCONSISTENT) | (quality == CONSISTENT))
    for column, size in ((0, 200.0), (1, 10.0)):
        z = true_ranges(at)[0]
        z[3, column] += size
        assert solve(MODEL, at.satellite[0], at.moving[0], z, near=at.r_i[0])[1] == INCONSISTENT


@pytest.mark.parametrize("n_used", [0, 1, 2, 3])
def test_fewer_than_four_satellites_give_no_fix(n_used):
    at = scene(np.zeros(1), standing, n_sat=5)
    receiver = new_receiver()
    receiver.position_guess[:] = at.r_i[0]
    z = true_ranges(at)[0]
    assert solution(receiver, MODEL, at.satellite[0], at.moving[0], at.used[0], n_used, z) == NO_FIX
    assert np.all(np.isnan(receiver.solution))
    np.testing.assert_array_equal(receiver.fix, 0.0)
    np.testing.assert_array_equal(receiver.position_guess, at.r_i[0])
    assert list(receiver.verdict) == [NO_FIX, n_used]


def test_satellites_in_one_cone_and_one_that_stands_in_for_two_give_no_fix():
    at = scene(np.zeros(1), standing, n_sat=5)
    angle = np.linspace(0.0, 5.0, 5)
    cone = at.r_i[0] + 2.2e7 * np.stack([0.6 + 0.0 * angle, 0.8 * np.cos(angle), 0.8 * np.sin(angle)], axis=1)
    z = with_rates(np.linalg.norm(cone - at.r_i[0], axis=1))
    assert solve(MODEL, cone, np.zeros((5, 3)), z, near=at.r_i[0])[1] == NO_FIX
    z = true_ranges(at)[0][[0, 1, 2, 2]]
    assert solve(MODEL, at.satellite[0], at.moving[0], z, near=at.r_i[0], slots=[0, 1, 2, 2])[1] == NO_FIX


def test_a_slot_without_a_range_or_a_rate_is_left_out():
    at = scene(np.zeros(1), standing, n_sat=8)
    z = true_ranges(at)[0] + np.random.default_rng(1).standard_normal((8, 2)) * [2.0, 0.1]
    z[2, 0], z[5, 1] = np.nan, np.nan
    rest = [0, 1, 3, 4, 6, 7]
    with_gaps, quality = solve(MODEL, at.satellite[0], at.moving[0], z, near=at.r_i[0])
    without, other = solve(MODEL, at.satellite[0], at.moving[0], z[rest], near=at.r_i[0], slots=rest)
    assert quality == other
    assert list(with_gaps.verdict) == [quality, 6]
    np.testing.assert_array_equal(with_gaps.fix, without.fix)
    assert slot_measurement(z, 2) == (0.0, 0.0, 0.0)


@jit
def solve_lanes(receiver, model, satellite, moving, used, ranges, out):
    at, o = view(receiver), view(out)
    o[0] = solution(at, model, satellite, moving, used, used.shape[0], view(ranges))


def test_eight_runs_with_different_satellites_missing_are_to_the_bit_those_of_each_alone():
    rng, at = np.random.default_rng(4), scene(np.zeros(1), standing, n_sat=8)
    z = measure(at, clocks(rng, 1, WIDTH, 1.0), rng)[0]
    for run in range(1, WIDTH):
        z[rng.permutation(8)[: run - 1], rng.integers(2), run] = np.nan
    together, out = new_receiver(WIDTH), np.empty((1, WIDTH))
    together.position_guess[:] = at.r_i[0][:, None]
    solve_lanes(together, MODEL, at.satellite[0], at.moving[0], at.used[0], np.ascontiguousarray(z), out)
    assert list(out[0]) == [CONSISTENT] * 5 + [UNTESTED, NO_FIX, NO_FIX]
    for run in range(WIDTH):
        alone = new_receiver()
        alone.position_guess[:] = at.r_i[0]
        solution(alone, MODEL, at.satellite[0], at.moving[0], at.used[0], 8, np.ascontiguousarray(z[..., run]))
        for name in ("fix", "inverse", "solution", "covariance", "position_guess", "verdict"):
            np.testing.assert_array_equal(getattr(together, name)[..., run], getattr(alone, name))


def test_what_is_reported_is_the_covariance_a_multiple_its_diagonal_or_a_constant():
    at = scene(np.zeros(1), standing, n_sat=6)

    def reported(kind):
        receiver = new_receiver()
        receiver.position_guess[:] = at.r_i[0]
        solution(
            receiver, point_model(kind, 2.0, 0.1), at.satellite[0], at.moving[0], at.used[0], 6, true_ranges(at)[0]
        )
        return receiver

    own = reported(OWN)
    np.testing.assert_array_equal(own.covariance[:3, :3], 4.0 * own.inverse[:3, :3])
    np.testing.assert_allclose(own.covariance[3:, 3:], 0.01 * own.inverse[:3, :3], rtol=1e-15)
    np.testing.assert_allclose(reported(ReportedCovariance(factor=10.0)).covariance, 10.0 * own.covariance, rtol=1e-15)
    np.testing.assert_array_equal(
        reported(ReportedCovariance(has_correlations=False)).covariance, np.diag(np.diag(own.covariance))
    )  # fmt: skip
    constant = reported(ReportedCovariance(False, False, 1.0, 9.0, 0.04)).covariance
    np.testing.assert_allclose(constant, np.diag([9.0] * 3 + [0.04] * 3), rtol=1e-15)


def test_a_solution_of_too_little_quality_is_not_handed_out():
    at = scene(np.zeros(1), standing, n_sat=6)
    z = true_ranges(at)[0]
    z[1, 0] += 500.0
    for least, handed_out in ((1, True), (2, False), (3, False)):
        receiver, near = new_receiver(), at.r_i[0]
        receiver.position_guess[:] = near
        model = point_model(OWN, 2.0, 0.1, least_quality=least)
        assert solution(receiver, model, at.satellite[0], at.moving[0], at.used[0], 6, z) == INCONSISTENT
        assert np.all(np.isfinite(receiver.solution)) == handed_out
        assert np.array_equal(receiver.position_guess, near) != handed_out
