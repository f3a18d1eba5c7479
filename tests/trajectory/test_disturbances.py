"""Coning, tones and random vibration are what their cards say, and hold together as one motion."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from pydantic import ValidationError

from lvnav_trade.kernels.earth import gravity_along
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import matrices
from lvnav_trade.trajectory.attitude_algebra import product, rotation_quaternions
from lvnav_trade.trajectory.disturbances import OscillationCard, SmallMotion, oscillations, small_motion
from lvnav_trade.trajectory.truth import Trajectory, add_oscillations, motion, reference
from tests.building import flight, turning

G = 9.80665
EVENTS = {"liftoff": 0.0, "stage1_cutoff": 20.0}
CONING = {"angle": "1 deg", "frequency": "10 Hz"}
TONE = {"frequency": "25 Hz", "axis": "x", "acceleration": "2 g"}
NOISE = {"frequency": ["20 Hz", "80 Hz", "350 Hz", "1000 Hz"],
         "acceleration": ["0.01 g^2/Hz", "0.04 g^2/Hz", "0.04 g^2/Hz", "0.014 g^2/Hz"]}  # fmt: skip


def card(**parts):
    return OscillationCard.model_validate({"start": "liftoff + 1 s", "end": "stage1_cutoff - 1 s"} | parts)


def still(duration=20.0):
    """A flight without force whose body does not turn against the stars."""
    return flight([(duration, lambda t: np.zeros(3))], lambda t: np.tile([1.0, 0.0, 0.0, 0.0], (t.size, 1)))


def pushed(duration=20.0):
    """A flight under 3 g whose body pitches and rolls."""
    return flight([(duration, lambda t: np.array([10.0, 20.0, -15.0]))], turning)


def laid_over(nominal, *cards):
    return add_oscillations(nominal, oscillations(cards, EVENTS, (nominal.start, nominal.end)))


def drift(trajectory, rate, first, last, compensate):
    """Inertial angle (3,) per second by which attitude integrated from the increments at `rate` leaves the truth."""
    ref = reference(trajectory, rate)
    ticks = slice(*np.searchsorted(ref.t, [first - 1e-9, last - 1e-9]))
    turn = ref.dtheta[ticks]
    if compensate:
        turn = turn + np.cross(ref.dtheta[ticks.start - 1 : ticks.stop - 1], turn) / 12.0
    q = ref.q_b_i[ticks.start : ticks.start + 1]
    for step in rotation_quaternions(turn):
        q = product(q, step[None])
    truth = ref.q_b_i[ticks.stop]
    left = product(q, truth[None] * [1.0, -1.0, -1.0, -1.0])[0]
    return 2.0 * np.sign(left[0]) * left[1:] / (last - first)


def test_the_coning_drift_of_a_one_sample_algorithm_is_the_closed_form(refdata, record_property):
    # (1/2) Omega sin^2 A (1 - sin(Omega T)/(Omega T)), the literature's closed form, with its values in the vectors.
    vectors = json.loads((refdata / "gnss/test_vectors/unit_check_vectors.json").read_text())["coning"]["rows"]
    assert len(vectors) == 3
    for row in vectors:
        cone = {"angle": f"{row['A_deg']} deg", "frequency": f"{row['f_hz']} Hz"}
        moved = laid_over(still(), card(coning=[cone]))
        found = drift(moved, 1.0 / row["T"], 3.0, 13.0, compensate=False)
        record_property(f"coning drift, A {row['A_deg']} deg, {row['f_hz']} Hz", f"{found[0]:.7e} rad/s")
        assert abs(found[0]) == pytest.approx(row["theory_rad_s"], rel=5e-4)
        assert np.max(np.abs(found[1:])) < 1e-3 * row["theory_rad_s"]


@pytest.mark.parametrize(("degrees", "frequency", "tick"), [(1.0, 10.0, 0.005), (0.1, 50.0, 0.0025), (1.0, 5.0, 0.01)])
def test_the_one_sample_drift_follows_the_formula_and_two_samples_leave_little_of_it(degrees, frequency, tick):
    moved = laid_over(still(), card(coning=[{"angle": f"{degrees} deg", "frequency": f"{frequency} Hz"}]))
    turn = 2.0 * math.pi * frequency * tick
    theory = math.pi * frequency * math.sin(math.radians(degrees)) ** 2 * (1.0 - math.sin(turn) / turn)
    plain = drift(moved, 1.0 / tick, 3.0, 13.0, compensate=False)[0]
    compensated = drift(moved, 1.0 / tick, 3.0, 13.0, compensate=True)[0]
    assert abs(plain) == pytest.approx(theory, rel=5e-4)
    # Computed values of the same three motions: 0.633, 1.163 and 0.3166 deg/h.
    published = {10.0: 0.633, 50.0: 1.163, 5.0: 0.3166}[frequency]
    assert abs(math.degrees(compensated) * 3600.0) == pytest.approx(published, rel=0.02)


def test_the_axis_of_a_cone_keeps_its_angle_from_where_it_rests():
    moved = laid_over(still(), card(coning=[CONING]))
    q = motion(moved, np.linspace(3.0, 13.0, 997)).q_b_i
    nose = matrices(q)[:, :, 0]
    assert np.max(np.abs(np.degrees(np.arccos(nose[:, 0])) - 1.0)) < 1e-9
    # Truth of the motion: -2 Omega sin^2(A/2) about the axis, Omega sin A across it.
    w = motion(moved, np.linspace(3.0, 13.0, 997)).w_ib_b
    omega = 20.0 * math.pi
    assert np.max(np.abs(np.abs(w[:, 0]) - 2.0 * omega * math.sin(math.radians(0.5)) ** 2)) < 1e-9
    assert np.max(np.abs(np.hypot(w[:, 1], w[:, 2]) - omega * math.sin(math.radians(1.0)))) < 1e-9


ALL = {
    "coning": [{**CONING, "angle": "3 deg", "axis": "y", "phase": "40 deg"}],
    "tones": [TONE, {"frequency": "12 Hz", "axis": "z", "angle": "0.5 deg", "phase": "90 deg"}],
    "noise": [{**NOISE, "lines": 16}, {"frequency": ["5 Hz", "60 Hz"], "rate": ["1 (deg/s)^2/Hz"] * 2, "lines": 8}],
}


def test_rate_velocity_and_force_are_the_derivatives_of_attitude_and_position():
    moved = laid_over(pushed(), card(**ALL))
    # On ramps, between them, and outside; differences of eighth order over 30 microseconds against 1 kHz.
    t, h = (
        np.concatenate([np.linspace(1.05, 1.45, 40), np.linspace(2.0, 18.0, 60), np.linspace(18.55, 18.95, 40)]),
        3e-5,
    )
    weights = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
    here = motion(moved, t)
    slope_q, slope_v = np.zeros((t.size, 4)), np.zeros((t.size, 3))
    for k, weight in weights.items():
        after, before = motion(moved, t + k * h), motion(moved, t - k * h)
        slope_q += weight / h * (after.q_b_i - before.q_b_i)
        slope_v += weight / h * (after.v_i - before.v_i)
    rate = 2.0 * product(here.q_b_i * [1.0, -1.0, -1.0, -1.0], slope_q)[:, 1:]
    assert np.max(np.abs(rate - here.w_ib_b)) < 1e-8 * np.max(np.abs(here.w_ib_b)) + 1e-9
    f_i = np.einsum("kij,kj->ki", matrices(here.q_b_i), here.f_b)
    assert np.max(np.abs(slope_v - gravity_along(here.r_i) - f_i)) < 3e-6 * np.max(np.abs(here.f_b))
    # Position moves by millimetres on 6e6 m: its differences over a tenth of a second's thousandth say little more.
    step = 1e-3
    path = motion(moved, t + step).r_i - motion(moved, t - step).r_i
    area = step * (motion(moved, t - step).v_i + motion(moved, t + step).v_i + 4.0 * here.v_i) / 3.0
    assert np.max(np.abs(path - area)) < 1e-3 * np.max(np.abs(path))


def test_increments_are_the_integrals_of_rate_and_force():
    # Long ticks are sums of short ones, whatever the number of nodes that each takes; 1 kHz lines turn by 2.5 waves
    # within a tick of 400 Hz. Rounding of positions of 6e6 m leaves 4e-7 m/s^2, which is 1e-9 m/s in a tick.
    moved = laid_over(
        pushed(8.0), OscillationCard.model_validate({"start": "1 s", "end": "6 s", "ramp": "0.3 s", **ALL})
    )
    slow, fast = reference(moved, 400.0), reference(moved, 3200.0)
    n = len(slow.dvel)
    for long, short, bound in ((slow.dvel, fast.dvel, 1e-9), (slow.dtheta, fast.dtheta, 1e-13)):
        gap = np.max(np.abs(long - short[: 8 * n].reshape(n, 8, 3).sum(axis=1)))
        assert gap < bound


def test_an_ideal_unit_returns_the_attitude_as_its_ticks_grow_short():
    # Two samples per step are of fourth order: the error falls by 16 from 800 to 1600 Hz, and is coning's own.
    moved = laid_over(pushed(), card(coning=[CONING], tones=[{"frequency": "12 Hz", "axis": "z", "angle": "0.5 deg"}]))
    errors = [np.linalg.norm(drift(moved, rate, 3.0, 17.0, compensate=True)) for rate in (800.0, 1600.0)]
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.1)
    assert errors[1] < 1e-9


def test_sculling_leaves_half_the_product_in_the_mean_of_the_felt_force():
    # An angle A sin about y and an acceleration a sin along x, in step, give a mean of A a / 2 along z: what the
    # body feels there in the mean is what its axes' swing takes away again, for nothing moves in the mean.
    tones = [{"frequency": "50 Hz", "axis": "y", "angle": "0.2 deg"},
             {"frequency": "50 Hz", "axis": "x", "acceleration": "2 g"}]  # fmt: skip
    moved = laid_over(still(), card(tones=tones))
    ref = reference(moved, 400.0)
    first, last = np.searchsorted(ref.t, [2.0 - 1e-9, 18.0 - 1e-9])
    felt = ref.dvel[first:last].sum(axis=0)[2] / 16.0
    assert felt == pytest.approx(0.5 * math.radians(0.2) * 2.0 * G, rel=1e-3)
    moved_on = ref.v_i[last] - ref.v_i[first] - (motion(still(), [18.0]).v_i - motion(still(), [2.0]).v_i)[0]
    assert np.max(np.abs(moved_on)) < 1e-3


def test_noise_has_the_power_of_its_density_and_only_in_its_band():
    band = OscillationCard.model_validate({"start": "0 s", "end": "80 s", "noise": [NOISE]})
    one = oscillations([band], {}, (0.0, 100.0))
    t = np.arange(1.0, 79.0, 1.0 / 4000.0)
    felt = small_motion(one, t).shift_acceleration
    # Area of the density by hand: straight lines on logarithmic axes of slopes 1, 0 and -1.
    area = 0.01 / 20.0 * (80.0**2 - 20.0**2) / 2.0 + 0.04 * 270.0 + 0.04 * 350.0 * math.log(1000.0 / 350.0)
    assert np.sqrt(np.mean(felt**2, axis=0)) / G == pytest.approx([math.sqrt(area)] * 3, rel=0.01)
    spectrum = np.abs(np.fft.rfft(felt[:, 0])) ** 2
    f = np.fft.rfftfreq(t.size, 1.0 / 4000.0)
    assert spectrum[(f < 19.0) | (f > 1010.0)].sum() < 1e-3 * spectrum.sum()
    correlation = np.corrcoef(felt.T)
    assert np.max(np.abs(correlation - np.eye(3))) < 0.05


def test_noise_is_the_same_in_every_run_and_another_by_another_name():
    def line(name):
        found = oscillations([card(noise=[{**NOISE, "name": name}])], EVENTS, (0.0, 20.0))
        return small_motion(found, np.array([7.0])).shift_acceleration

    assert np.array_equal(line("vibration"), line("vibration"))
    assert np.max(np.abs(line("vibration") - line("pogo"))) > 1.0


SWAY = {"frequency": "0.4 Hz", "axis": "y", "angle": "1 mrad", "lever": ["20 m", "0 m", "1 m"]}


def test_a_mode_turns_the_body_and_displaces_the_unit_by_its_lever_arm():
    (sway,) = oscillations([card(modes=[SWAY])], EVENTS, (0.0, 20.0))
    t = np.arange(5.0, 15.0, 0.01)  # four periods between the ramps
    moved = small_motion([sway], t)
    assert np.sqrt(np.mean(moved.turn[:, 1] ** 2)) == pytest.approx(1e-3, rel=1e-3)
    assert not moved.turn[:, [0, 2]].any()
    np.testing.assert_allclose(moved.shift, np.cross(moved.turn, [20.0, 0.0, 1.0]), atol=1e-15)
    np.testing.assert_allclose(moved.shift_rate, np.cross(moved.turn_rate, [20.0, 0.0, 1.0]), atol=1e-15)


def test_a_damped_mode_has_the_power_and_the_width_of_a_damped_oscillator():
    """Under white torque: mean square by definition, that of the rate (2 pi f)^2 times as large."""
    window = {"start": "0 s", "end": "4000 s", "ramp": "1 s"}
    damped = OscillationCard.model_validate({**window, "modes": [{**SWAY, "damping": 0.05, "lines": 512}]})
    (sway,) = oscillations([damped], EVENTS, (0.0, 4000.0))
    assert 0.5 * np.sum(np.abs(sway.turn[:, 1]) ** 2) == pytest.approx(1e-6, rel=1e-12)
    rate = 0.5 * np.sum(np.abs(sway.omega * sway.turn[:, 1]) ** 2)
    assert rate == pytest.approx((2.0 * math.pi * 0.4) ** 2 * 1e-6, rel=0.02)
    # half of the power lies within damping times the frequency of the resonance, as of a Lorentz curve
    near = np.abs(sway.omega / (2.0 * math.pi * 0.4) - 1.0) < 0.05
    assert np.mean(near) == pytest.approx(0.5, abs=0.02)
    moved = small_motion([sway], np.arange(1.0, 3999.0, 0.25))
    assert np.sqrt(np.mean(moved.turn[:, 1] ** 2)) == pytest.approx(1e-3, rel=0.05)


def test_modes_of_another_name_or_axis_sway_by_themselves():
    def lines(**change):
        return oscillations([card(modes=[{**SWAY, "damping": 0.02, **change}])], EVENTS, (0.0, 20.0))[0].omega

    assert np.array_equal(lines(), lines())
    assert not np.array_equal(lines(), lines(name="other"))
    assert not np.array_equal(lines(), lines(axis="z"))


def test_nothing_moves_outside_the_window_and_nothing_jumps_at_its_edges():
    moved, nominal = laid_over(pushed(), card(**ALL)), pushed()
    for t in (np.linspace(0.0, 1.0, 30), np.linspace(19.0, 20.0, 30)):
        for with_, without in zip(motion(moved, t), motion(nominal, t), strict=True):
            assert np.max(np.abs(with_ - without)) < 1e-12
    for phase_end in (1.0, 1.5, 18.5, 19.0):
        before, after = motion(moved, [phase_end - 1e-9]), motion(moved, [phase_end])
        for name, bound in (("r_i", 1e-4), ("v_i", 1e-6), ("q_b_i", 1e-8), ("w_ib_b", 1e-4), ("f_b", 1e-3)):
            assert np.max(np.abs(getattr(before, name) - getattr(after, name))) < bound, name


def test_overlapping_oscillations_add():
    one, two = card(tones=[TONE]), OscillationCard.model_validate({"start": "5 s", "end": "9 s", "tones": [TONE]})
    t = np.linspace(0.0, 20.0, 301)
    both = small_motion(oscillations([one, two], EVENTS, (0.0, 20.0)), t)
    apart = [small_motion(oscillations([single], EVENTS, (0.0, 20.0)), t) for single in (one, two)]
    for name in SmallMotion._fields:
        assert np.allclose(getattr(both, name), sum(getattr(part, name) for part in apart), rtol=0.0, atol=1e-12)


def test_without_oscillation_the_flight_is_the_very_same():
    nominal = still()
    assert laid_over(nominal) is nominal
    assert isinstance(nominal, Trajectory)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"coning": []}, "an oscillation needs coning, tones, noise or modes"),
        ({"tones": [{"frequency": "5 Hz", "axis": "x"}]}, "give acceleration or angle, one of the two"),
        ({"noise": [{**NOISE, "rate": ["1 (rad/s)^2/Hz"] * 4}]}, "give acceleration or rate, one of the two"),
        ({"noise": [{**NOISE, "acceleration": ["1 g^2/Hz"]}]}, "4 frequencies but 1 densities"),
        ({"noise": [{**NOISE, "acceleration": [0, 0, 0, 0]}]}, "greater than zero"),
        ({"noise": [{**NOISE, "frequency": ["9 Hz", "8 Hz", "10 Hz", "11 Hz"]}]}, "frequency must rise"),
        ({"noise": [{**NOISE, "acceleration": ["1 m/s^2"] * 4}]}, "wrong unit"),
        ({"coning": [{**CONING, "angle": "0 deg"}]}, "greater than 0"),
    ],
)
def test_a_card_that_cannot_be_meant_is_refused(change, message):
    with pytest.raises(ValidationError, match=message):
        card(**change)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ({"start": "stage_cutoff"}, "no event 'stage_cutoff' .did you mean 'stage1_cutoff'"),
        ({"start": "5 s", "end": "5.5 s"}, "oscillation 1: from 5 to 5.5 s there is no room for two ramps of 0.5 s"),
        ({"end": "stage1_cutoff + 3 s"}, "oscillation 1: 1 to 23 s is not within the flight, 0 to 20 s"),
    ],
)
def test_a_window_that_is_not_in_the_flight_is_refused(times, message):
    with pytest.raises(InputError, match=message):
        oscillations([card(coning=[CONING], **times)], EVENTS, (0.0, 20.0))
