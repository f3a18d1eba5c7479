"""Conservative tuning: under-weighting, fading memory, process noise of a change of region, a transition held."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.covariance.history import covariance
from lvnav_trade.kernels.covariance import grow, inflate, update_scalar
from lvnav_trade.kernels.strapdown import N_SUM, SUM_C, SUM_F, SUM_TH, SUM_V
from lvnav_trade.kernels.transition import FIRST, KEPT, RENEWED, linearise, linearised_sums
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.simulation.montecarlo import run_block
from tests.building import INERTIAL, LOOSE, MATCHED, assumed_receiver, flight, loaded, prepare_hop, turning, with_fields
from tests.covariance.test_history import agrees, inside

NOISES = ("pseudorange_sigma", "range_rate_sigma")
ONE = np.zeros(1, dtype=np.int64)
NOISELESS = {"gyro_random_walk": "0 rad/sqrt(s)", "accel_random_walk": "0 m/s/sqrt(s)", "gyro_bias": "1 deg/h",
             "accel_bias": "1 mg"}  # fmt: skip


def prepare_case(*settings, flight=None, **fields):
    scenario = loaded(MATCHED, *settings)
    return prepare_hop(scenario.model_copy(update={"filter": with_fields(scenario.filter, **fields)}), flight)


def formal(prepared_case):
    return covariance(prepared_case).formal_sigma


# ------------------------------------------------------------------------------------------------------ under-weighting


@pytest.mark.parametrize("joseph", [False, True])
def test_an_underweighted_scalar_update_is_lears(joseph):
    """K = P / ((1 + beta) P + R), P+ = (1 - K) P (1 - K) + K (R + beta P) K: Zanetti et al. 2010, equations 14, 17."""
    P, x, K = np.array([[4.0]]), np.zeros(1), np.zeros(1)
    normalised, weight = update_scalar(P, x, K, np.ones(1), ONE, ONE, 3.0, 1.0, np.inf, 1, joseph, 0.5)
    gain = 4.0 / (1.5 * 4.0 + 1.0)
    assert x[0] == pytest.approx(3.0 * gain, rel=1e-14)
    assert P[0, 0] == pytest.approx((1.0 - gain) ** 2 * 4.0 + gain**2 * (1.0 + 0.5 * 4.0), rel=1e-14)
    assert (normalised, weight) == pytest.approx((3.0 / 7.0**0.5, 1.0 / 7.0), rel=1e-14)


def test_a_noise_factor_is_a_receiver_of_larger_noise_as_the_filter_assumes_it():
    receiver = assumed_receiver(loaded(MATCHED))
    noisier = receiver.model_copy(update={name: 2.0 * getattr(receiver, name) for name in NOISES})
    one = prepare_case(underweighting=[{"noise_factor": 4.0, "from": "0 s"}])
    other, same = prepare_case(), prepare_case(receiver=noisier.model_dump(mode="json"))
    np.testing.assert_allclose(formal(one), formal(same), rtol=1e-10)
    assert np.all(formal(one)[-1, 3:9] > 1.2 * formal(other)[-1, 3:9])


def test_the_covariance_that_a_solution_comes_with_grows_by_the_factor():
    """A factor of the filter's tuning, and the same factor that the receiver reports: both engines."""
    scenario = loaded(MATCHED, LOOSE)
    tuned = with_fields(scenario.filter, underweighting=[{"noise_factor": 3.0, "from": "0 s"}])

    def solving(factor, card):
        solution = {"kind": "bancroft", "range_sigma": "2 m", "rate_sigma": "0.1 m/s",
                    "reported_covariance": {"kind": "own", "factor": factor}}  # fmt: skip
        receiver = with_fields(scenario.receiver, solution=solution)
        return prepare_hop(scenario.model_copy(update={"receiver": receiver, "filter": card}))

    one, other = solving(1.0, tuned), solving(3.0, scenario.filter)
    np.testing.assert_allclose(formal(one), formal(other), rtol=1e-10)
    blocks = [run_block(prepared_case, 5, 0, 8) for prepared_case in (one, other)]
    np.testing.assert_allclose(blocks[0].sigma, blocks[1].sigma, rtol=1e-9)


# ------------------------------------------------------------------------------------------------------- fading memory


@pytest.mark.parametrize("alpha", [1.01, 1.2])
def test_a_fading_memory_filter_of_a_constant_has_the_gain_of_the_closed_form(alpha):
    """P = alpha^2 P R / (P + R) has the root R (alpha^2 - 1): the gain is 1 - 1 / alpha^2 (Simon, section 7.4)."""
    P, x, K, R = np.array([[100.0]]), np.zeros(1), np.zeros(1), 2.0
    for _ in range(4000):
        inflate(P, alpha, 1)
        before = P[0, 0]
        update_scalar(P, x, K, np.ones(1), ONE, ONE, 0.0, R, np.inf, 1, False)
    assert before == pytest.approx(R * (alpha**2 - 1.0), rel=1e-12)
    assert before / (before + R) == pytest.approx(1.0 - alpha**-2, rel=1e-12)


def test_what_is_considered_is_not_inflated_but_its_correlations_are():
    P = np.array([[4.0, 1.0], [1.0, 9.0]])
    inflate(P, 2.0, 1)
    np.testing.assert_array_equal(P, [[16.0, 2.0], [2.0, 9.0]])


def test_without_noise_and_measurements_sigmas_grow_by_the_exponential_of_the_time():
    plain, faded = (prepare_case(INERTIAL, imu=NOISELESS, **more) for more in ({}, {"fading_memory": "40 s"}))
    growth = np.exp(plain.t_hist / 40.0)[:, None]
    np.testing.assert_allclose(formal(faded), formal(plain) * growth, rtol=1e-10)
    np.testing.assert_array_equal(covariance(faded).true_sigma, covariance(plain).true_sigma)


# ---------------------------------------------------------------------------------------------------------- H-infinity


def test_the_covariance_grows_by_the_weights_taken_off_its_inverse():
    rng = np.random.default_rng(11)
    root, weights = rng.standard_normal((12, 12)), np.zeros(9)
    P = root @ root.T
    weights[[3, 4, 7]] = 0.2 / np.diag(P)[[3, 4, 7]]
    dense = np.linalg.inv(np.linalg.inv(P) - np.diag([*weights, 0.0, 0.0, 0.0]))
    grow(P, weights)
    np.testing.assert_allclose(P, dense, rtol=0, atol=1e-12 * np.abs(dense).max())
    np.testing.assert_array_equal(P, P.T)


def test_where_no_such_filter_exists_there_is_no_covariance():
    P = np.array([[4.0]])
    grow(P, np.array([0.25]))
    assert np.isnan(P[0, 0])


def cycle(P, weight, q=1.0, r=1.0):
    """Return the gain of one epoch of a random walk that is measured; P (1, 1), predicted, becomes the next one."""
    x, K, gain = np.zeros(1), np.zeros(1), P[0, 0] / (P[0, 0] + r)
    update_scalar(P, x, K, np.ones(1), ONE, ONE, 0.0, r, np.inf, 1, False)
    grow(P, np.array([weight]))
    P[0, 0] += q
    return gain


@pytest.mark.parametrize(("weight", "steady"), [(0.5, 2.0), (0.0, (1.0 + 5.0**0.5) / 2.0), (0.75, 0.5 + 4.25**0.5)])
def test_an_h_infinity_filter_of_a_random_walk_has_the_steady_covariance_of_the_closed_form(weight, steady):
    """With Q = R = 1, P = 1 + P / (1 + (1 - theta) P): P = 1/2 + sqrt(1/4 + 1 / (1 - theta)); at 0 that of Kalman."""
    P = np.array([[10.0]])
    for _ in range(200):
        cycle(P, weight)
    assert P[0, 0] == pytest.approx(steady, rel=1e-12)


@pytest.mark.parametrize("weight", [0.3, 0.7])
def test_no_noise_has_an_effect_beyond_the_bound_and_a_kalman_filter_has_no_such_bound(weight):
    """The largest ratio of squared errors to squared disturbances is below 1 / theta: singular values of the map from
    start, process and measurement noise to the errors of the estimates.
    """
    n = 60

    def largest(theta):
        P = np.array([[1.0]])
        gains = np.array([cycle(P, theta) for _ in range(n)])
        errors = np.zeros((n, 2 * n))  # of the start and the n - 1 steps after it, and of the n measurements
        error = np.zeros(2 * n)
        for k, gain in enumerate(gains):
            error[k] += 1.0  # the start, or a step, of one sigma
            error = (1.0 - gain) * error
            error[n + k] -= gain
            errors[k] = error
        return np.linalg.svd(errors, compute_uv=False)[0] ** 2

    assert largest(weight) < 1.0 / weight
    assert largest(weight) < largest(0.0)


def test_without_noise_and_measurements_the_variance_grows_by_the_closed_form_and_truth_does_not():
    """p / (1 - p t / (T s^2)), however the time is divided into windows."""
    P, whole = np.array([[4.0]]), np.array([[4.0]])
    for _ in range(10):
        grow(P, np.array([1.0 / (60.0 * 9.0)]))
    grow(whole, np.array([10.0 / (60.0 * 9.0)]))
    assert P[0, 0] == pytest.approx(4.0 / (1.0 - 4.0 * 10.0 / (60.0 * 9.0)), rel=1e-14)
    assert P[0, 0] == pytest.approx(whole[0, 0], rel=1e-14)


BOUNDED = {"time": "20 s", "velocity": "0.1 m/s", "position": "2 m"}


def test_the_longer_the_time_the_nearer_it_is_to_the_kalman_filter():
    plain, bounded = (
        prepare_case(),
        [prepare_case(h_infinity=BOUNDED | {"time": f"{time:g} s"}) for time in (20.0, 2e3, 2e5)],
    )
    off = [np.abs(formal(one)[-1, 3:9] / formal(plain)[-1, 3:9] - 1.0).max() for one in bounded]
    assert off[0] > 0.01
    assert off[1] == pytest.approx(off[0] / 100.0, rel=0.3)
    assert off[2] == pytest.approx(off[1] / 100.0, rel=0.05)


def test_errors_that_no_filter_bounds_are_refused_with_the_time_from_which_on():
    with pytest.raises(InputError, match=r"filter.h_infinity.time: no filter bounds errors .* has no end"):
        covariance(prepare_case(h_infinity={"time": "1 s", "position": "1 cm"}))


# ----------------------------------------------------------------------------------------- change of operating region


def test_a_change_of_region_adds_its_variance_then_and_velocity_carries_it_on():
    """0.5 m/s at 10 s is 0.25 m^2/s^2 more of velocity from then on, and 0.25 tau^2 more of position."""
    entry = {"from": "10 s", "velocity": "0.5 m/s"}
    plain, more = (covariance(prepare_case(INERTIAL, imu=NOISELESS, **f)) for f in ({}, {"region_noise": [entry]}))
    added, t = more.formal_sigma**2 - plain.formal_sigma**2, plain.t
    np.testing.assert_allclose(added[t < 10.0], 0.0, atol=1e-15)
    after = t >= 10.0
    np.testing.assert_allclose(added[after, 3:6], 0.25, rtol=2e-3)
    np.testing.assert_allclose(added[after, 6:9], 0.25 * np.tile((t[after, None] - 10.0) ** 2, 3), rtol=1e-3, atol=1e-6)
    np.testing.assert_array_equal(more.true_sigma, plain.true_sigma)


# ------------------------------------------------------------------------------------- process noise over the dynamics

FORCE = 30.0 * np.array([0.6, 0.64, 0.48])


def test_noise_in_proportion_to_the_force_is_that_of_its_square_over_the_burn():
    """Density k f: k^2 f^2 t of velocity while 30 m/s^2 push, its double integral of position, nothing in free fall."""
    burn = flight([(10.0, lambda t: FORCE), (15.0, lambda t: 0.0 * FORCE)], turning)
    table = {"specific_force": ["0 m/s^2", "60 m/s^2"], "velocity": ["0 m/s/sqrt(s)", "0.2 m/s/sqrt(s)"]}
    plain, more = (
        covariance(prepare_case(INERTIAL, flight=burn, imu=NOISELESS, **f)) for f in ({}, {"process_noise_by": [table]})
    )
    added, t = more.formal_sigma**2 - plain.formal_sigma**2, plain.t
    density = 0.1**2
    burning = np.minimum(t, 10.0)[:, None]
    np.testing.assert_allclose(added[t > 1.0, 3:6], np.tile(density * burning, 3)[t > 1.0], rtol=2e-2)
    moved = density * (burning**3 / 3.0 + burning * (t[:, None] - burning) * t[:, None])
    np.testing.assert_allclose(added[-1, 6:9], np.tile(moved, 3)[-1], rtol=2e-2)
    np.testing.assert_array_equal(more.true_sigma, plain.true_sigma)


def test_a_table_with_one_value_is_the_noise_of_the_card():
    """Over altitude, attitude, velocity and position: what enters at the end of a window enters within it otherwise."""
    noise = {"attitude": "1 deg/sqrt(h)", "velocity": "0.1 m/s/sqrt(s)", "position": "0.3 m/sqrt(s)"}
    table = {"altitude": ["0 km", "900 km"], **{name: [value, value] for name, value in noise.items()}}
    one = formal(prepare_case(process_noise_by=[table]))
    other = formal(prepare_case(**{f"{name}_noise": value for name, value in noise.items()}))
    np.testing.assert_allclose(one, other, rtol=5e-3)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"velocity": ["1 m/s/sqrt(s)"]}, "one of altitude, specific_force, jerk is stated"),
        ({"jerk": ["0 m/s^3", "1 m/s^3"]}, "no noise"),
        ({"jerk": ["0 m/s^3", "1 m/s^3"], "velocity": ["1 m/s/sqrt(s)"]}, "2 values of jerk but 1 of velocity"),
    ],
)
def test_a_table_without_meaning_is_refused(table, message):
    with pytest.raises(ValueError, match=message):
        prepare_case(process_noise_by=[table])


# ------------------------------------------------------------------------------------------------------ transition held


def test_a_held_transition_is_that_of_the_attitude_and_force_known_at_its_start():
    rates, sums, nav = np.zeros((2, N_SUM)), np.arange(1.0, 19.0), np.zeros(10)
    nav[:4] = np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)  # 90 deg about z
    first = sums.copy()
    linearise(rates, nav, FIRST)
    linearised_sums(rates, sums, 2.0, FIRST)
    np.testing.assert_allclose(sums, first)
    linearise(rates, nav, RENEWED)
    sums = np.full(N_SUM, 7.0)
    linearised_sums(rates, sums, 0.5, RENEWED)
    np.testing.assert_allclose(sums[SUM_C : SUM_C + 9], 0.5 * np.array([0, -1, 0, 1, 0, 0, 0, 0, 1]), atol=1e-15)
    force = first[SUM_F : SUM_F + 3] / 2.0
    np.testing.assert_allclose(sums[SUM_F : SUM_F + 3], 0.5 * force)
    np.testing.assert_allclose(sums[SUM_V : SUM_V + 3], 0.5 * np.array([-force[1], force[0], force[2]]))
    np.testing.assert_allclose(sums[SUM_TH : SUM_TH + 3], 0.25 * first[SUM_TH : SUM_TH + 3])
    kept = sums.copy()
    linearised_sums(rates, sums, 1.0, KEPT)
    np.testing.assert_allclose(sums, 2.0 * kept)
    linearise(rates, nav, RENEWED)  # the means of the last window, not those that it was propagated with
    np.testing.assert_allclose(rates[0, SUM_F : SUM_F + 3], kept[SUM_F : SUM_F + 3])


def test_a_transition_that_is_linearised_less_often_is_further_off():
    """Pitch of 1 deg/s, roll of 4 deg/s under 30 m/s^2: the error falls with the interval, 0.1 s is good to 1 %."""
    exact = formal(prepare_case())
    off = [
        np.abs(formal(prepare_case(transition_rate=rate)) / exact - 1.0).max() for rate in ("10 Hz", "1 Hz", "0.2 Hz")
    ]
    assert off[0] < 0.01
    assert 3.0 * off[0] < off[1]
    assert 3.0 * off[1] < off[2]


def test_a_steady_flight_needs_no_linearisation():
    """Constant force, no rotation: what was known at the start is true throughout."""
    nose = turning(np.zeros(1))
    force = 20.0 * np.array([0.6, 0.64, 0.48])
    steady = flight([(20.0, lambda t: force)], lambda t: np.tile(nose, (t.size, 1)))
    found = [formal(prepare_case(flight=steady, transition_rate=rate)) for rate in (None, "0.1 Hz")]
    np.testing.assert_allclose(found[0], found[1], rtol=1e-6)


# --------------------------------------------------------------------------------------------------------- all together

ALL = {
    "underweighting": [{"beta": 0.4, "until": "15 s"}, {"noise_factor": 2.0, "from": "10 s"}],
    "fading_memory": "30 s",
    "h_infinity": BOUNDED,
    "region_noise": [{"force_change": "10 m/s^2", "velocity": "0.1 m/s", "accel_bias": "1 mg"}],
    "process_noise_by": [
        {"specific_force": ["0 m/s^2", "30 m/s^2"], "velocity": ["0 m/s/sqrt(s)", "0.05 m/s/sqrt(s)"]}
    ],
    "transition_rate": "0.5 Hz",
}


def test_both_engines_agree_on_a_filter_that_is_tuned_in_every_way():
    prepared_case = prepare_case(**ALL)
    ratio, interval = agrees(prepared_case, 400, (10.0, 20.0, 30.0))
    assert inside(ratio, interval), (ratio, interval)
    cov, block = covariance(prepared_case), run_block(prepared_case, 3, 0, 8)
    np.testing.assert_allclose(block.sigma, np.broadcast_to(cov.formal_sigma, block.sigma.shape), rtol=0.02)
    # conservative: it claims less than it has, and has more than the best filter
    best = covariance(prepare_case())
    assert np.all(cov.formal_sigma[-1, 3:9] > cov.true_sigma[-1, 3:9])
    assert np.all(cov.true_sigma[-1, 3:9] > best.true_sigma[-1, 3:9])
