import math
from functools import cache

import numpy as np
import pytest
from ruamel.yaml import YAML
from scipy.interpolate import make_interp_spline

from lvnav_trade.gnss.constellation import NominalConstellation
from lvnav_trade.gnss.fault_cards import SatelliteOutage
from lvnav_trade.gnss.link import AntennaCard, CosineGain, LinkCard, TableGain, carrier_to_noise, gains
from lvnav_trade.gnss.loops import LoopsCard, code_sigma, rate_sigma
from lvnav_trade.gnss.receiver_cards import ReceiverCard
from lvnav_trade.gnss.tracking import TrackingCard
from lvnav_trade.gnss.visibility import sky
from lvnav_trade.quantities.frames import earth_angle, ecef_from_geodetic, eci_from_ecef, gmst, matrices, quaternions
from lvnav_trade.quantities.records import IDLE, TRACK
from lvnav_trade.trajectory.flight import Phase, Trajectory, motion
from lvnav_trade.trajectory.truth import attitude_spline
from tests.counting import calls
from tests.trajectory.flight_cases import CONFIGS, ascent
from tests.trajectory.phase_centres import antenna_states

LATITUDE, LONGITUDE = math.radians(40.0), math.radians(-105.0)
EPOCH = "2022-06-01T21:40:00Z"
SIDES = {"right": [0, 1, 0], "below": [0, 0, 1], "left": [0, -1, 0], "above": [0, 0, -1]}
PATCH = {"kind": "cosine", "peak": "5 dBi"}
LOOPS = {"integration": "5 ms", "code_bandwidth": "0.2 Hz", "jitter": "1.5 deg"}


@cache
def gps():
    return NominalConstellation(**YAML(typ="safe").load((CONFIGS / "constellations/gps_24.yaml").read_text()))


def receiver(**changes):
    numbers = {
        "name": "test", "source": "none", "pseudorange_sigma": "2 m", "range_rate_sigma": "0.1 m/s", "mask": "5 deg",
        "solution": {"kind": "direct", "position_sigma": "2 m", "velocity_sigma": "0.1 m/s"},
        "clock": {"h0": 0.0, "h_minus2": 0.0},
    }  # fmt: skip
    return ReceiverCard(**(numbers | changes))


def patches(lever="0 m", **changes):
    lever_arms = {name: [f"{x} m" for x in np.array(side) * float(lever.split()[0])] for name, side in SIDES.items()}
    return [
        {"name": name, "boresight": side, "lever_b": lever_arms[name], "pattern": PATCH} | changes
        for name, side in SIDES.items()
    ]


def four(**changes):
    return receiver(**({"antennas": patches(), "link": {}, "loops": LOOPS, "tracking": {}} | changes))


def vertical(push=80.0, burn=4.0, spin=0.0, pad=20.0, coast=30.0):
    """Return a rocket that stands, is pushed straight up by `push` (m/s^2) for `burn` s, and coasts, nose up.

    It turns about its axis by spin (rad/s); force jumps at ignition and at burnout.
    """
    theta0 = gmst(EPOCH)
    up = np.array(
        [math.cos(LATITUDE) * math.cos(LONGITUDE), math.cos(LATITUDE) * math.sin(LONGITUDE), math.sin(LATITUDE)]
    )
    east = np.array([-math.sin(LONGITUDE), math.cos(LONGITUDE), 0.0])

    def height(t, name):
        powered, free = (t, 0.0 * t) if name == "boost" else (burn + 0.0 * t, t - burn)
        flown = 0.5 * push * powered**2 + push * powered * free - 0.5 * 9.8 * free**2
        return 1600.0 + (0.0 * t if name == "pad" else flown)

    def phase(name, start, end):
        t = np.linspace(start, end, round((end - start) * 20) + 1)
        r_e = ecef_from_geodetic(LATITUDE + 0.0 * t, LONGITUDE + 0.0 * t, height(t, name))
        c, s = np.cos(spin * t)[:, None], np.sin(spin * t)[:, None]
        side = c * east + s * np.cross(up, east)
        C_b_e = np.stack([np.broadcast_to(up, side.shape), side, np.cross(up, side)], axis=-1)
        C_b_i = np.stack([eci_from_ecef(C_b_e[..., k], earth_angle(theta0, t)) for k in range(3)], axis=-1)
        return Phase(
            name, start, end, make_interp_spline(t, eci_from_ecef(r_e, earth_angle(theta0, t)), k=5),
            attitude_spline(t, quaternions(C_b_i)),
        )  # fmt: skip

    parts = (phase("pad", -pad, 0.0), phase("boost", 0.0, burn), phase("coast", burn, burn + coast))
    return Trajectory(parts, {"liftoff": 0.0, "burnout": burn}, theta0, EPOCH)


def mean_cn0(seen, epoch):
    return float(np.mean(seen.cn0[epoch][seen.is_tracked[epoch]]))


def test_a_student_rocket_keeps_the_satellites_that_its_record_says():
    # A flight of 2022: on the pad 31 dB-Hz and 11 satellites, under about 80 m/s^2 20.5 dB-Hz and 6, whole again 8 to
    # 10 s later. Antenna, oscillator and loops are not published and are assumed: what is tested is that one set of
    # plausible numbers (a small antenna in the nose, a crystal that shakes, a slow frequency loop) gives all of it.
    pattern = {
        "kind": "table", "angle": ["0 deg", "40 deg", "90 deg", "110 deg"],
        "gain": ["-6 dBi", "-8.5 dBi", "-15 dBi", "-22 dBi"],
    }  # fmt: skip
    card = receiver(
        mask="2 deg",
        antennas=[{"name": "nose", "pattern": pattern}],
        link={"noise_figure": "3 dB", "implementation_loss": "2 dB"},
        loops={
            "carrier": "fll", "carrier_order": 2, "carrier_bandwidth": "1 Hz", "integration": "20 ms",
            "vibration": "11.5 deg/g",
        },
        tracking={
            "acquire_above": "22 dB-Hz", "track_above": "12 dB-Hz", "search_time": "20 s", "reacquire_time": "10 s",
            "memory": "30 s", "pull_in": "2 s", "coast": "1 s",
        },
    )  # fmt: skip
    t = np.arange(-19.0, 33.0)
    seen = sky(gps(), card, vertical(), t)
    count = seen.is_tracked.sum(axis=1)
    assert np.all(count[t < 0.0] == 11)
    assert mean_cn0(seen, 10) == pytest.approx(31.0, abs=1.0)
    boost = (t > 1.0) & (t < 4.0)
    assert np.all(np.abs(count[boost] - 6) <= 1)
    assert mean_cn0(seen, int(np.flatnonzero(boost)[0])) == pytest.approx(20.5, abs=2.0)
    back = t[(t > 4.0) & (count == 11)][0] - 4.0
    assert 7.0 <= back <= 11.0
    assert {x.reason for x in seen.transitions if x.state_before == "track"} == {"dynamics"}


def test_a_receiver_without_antennas_link_or_tracking_is_what_it_was():
    t = np.arange(-19.0, 33.0)
    seen = sky(gps(), receiver(channels=6), vertical(), t)
    assert np.all(seen.is_tracked.sum(axis=1) == 6)
    assert np.array_equal(seen.state == TRACK, seen.is_tracked)
    assert np.all((seen.range_sigma == 2.0) & (seen.rate_sigma == 0.1) & (seen.antenna == 0) & np.isnan(seen.cn0))
    assert seen.transitions == ()
    assert seen.lever_arms.tolist() == [[0.0, 0.0, 0.0]]


def test_an_isotropic_antenna_and_no_losses_give_the_link_budget_and_nothing_else():
    card = receiver(link={}, tracking={})
    t = np.arange(-19.0, 33.0)
    seen, plain = sky(gps(), card, vertical(), t), sky(gps(), receiver(), vertical(), t)
    assert np.array_equal(seen.is_tracked, plain.is_tracked)
    up = seen.elevation > math.radians(5.0)
    # Handbook: -158.2 dBW at the zenith, -155.4 at 50 deg; noise of 130 K + 170 K and 1 dB: 41 to 45 dB-Hz.
    strongest, weakest = (float(carrier_to_noise(card.link, np.array(p))) for p in (-155.2, -158.3))
    assert np.all((seen.cn0[up] > weakest) & (seen.cn0[up] < strongest))


def test_the_best_antenna_is_the_one_that_looks_there():
    flight, t = vertical(spin=0.3), np.arange(-19.0, 33.0)
    seen = sky(gps(), four(tracking=None, loops=None), flight, t)
    at = motion(flight, t)
    line = seen.r_i - at.r_i[:, None, :]
    direction_b = np.einsum("nji,nsj->nsi", matrices(at.q_b_i), line / np.linalg.norm(line, axis=-1, keepdims=True))
    axes = np.array(list(SIDES.values()), dtype=float)
    np.testing.assert_array_equal(seen.antenna, np.argmax(direction_b @ axes.T, axis=-1))
    assert len(np.unique(seen.antenna[:, 0])) == 4  # the spin brings each to face it
    level = gains(four().antennas, direction_b).max(axis=-1)
    single = sky(gps(), receiver(link={}), flight, t)
    np.testing.assert_allclose(seen.cn0, single.cn0 + level, rtol=0.0, atol=1e-9)


def test_a_satellite_at_the_zenith_is_heard_less_by_antennas_that_look_sideways():
    # Section 6.1 of Canepa and Servidia says so of the pad; here the nearest to the zenith against those below 45 deg.
    seen = sky(gps(), four(tracking=None, loops=None), vertical(), np.array([-10.0]))
    level = seen.cn0 - sky(gps(), receiver(link={}), vertical(), np.array([-10.0])).cn0
    highest = int(np.argmax(seen.elevation))
    sideways = (seen.elevation > math.radians(5.0)) & (seen.elevation < math.radians(45.0))
    assert level[0, highest] < level[sideways].min()


def test_thermal_noise_follows_the_carrier_to_noise_density():
    card = four()
    seen = sky(gps(), card, vertical(push=20.0), np.arange(-19.0, 33.0))
    up = seen.is_tracked
    np.testing.assert_allclose(seen.range_sigma[up], np.hypot(2.0, code_sigma(card.loops, seen.cn0[up])))
    np.testing.assert_allclose(
        seen.rate_sigma[up], np.hypot(0.1, rate_sigma(card.loops, seen.cn0[up], card.link.wavelength))
    )
    assert np.all(np.isfinite(seen.range_sigma))
    assert np.all(np.isfinite(seen.rate_sigma))


@pytest.mark.parametrize(("dead", "changing"), [((0, 3), True), ((0, 2, 3), False)])
def test_dead_antennas_lose_their_satellites_which_come_back_one_by_one(dead, changing):
    t, flight = np.arange(-59.0, 560.0), ascent()
    alive = np.ones((t.size, 4), dtype=bool)
    failure = (t >= 300.0) & (t < 330.0)
    alive[np.ix_(failure, dead)] = False
    card = four(antennas=patches(cutoff="90 deg"), mask_height="75 km")
    whole, broken = sky(gps(), card, flight, t), sky(gps(), card, flight, t, antenna_alive=alive)
    assert np.array_equal(broken.is_tracked[t < 300.0], whole.is_tracked[t < 300.0])
    assert not np.any(np.isin(broken.antenna[failure], dead) & broken.is_tracked[failure])
    changed = np.isin(whole.antenna[failure], dead) & broken.is_tracked[failure]
    assert bool(changed.any()) is changing  # heard by two antennas: it changes to the one that lives
    gone = [x for x in broken.transitions if x.reason == "no antenna" and x.state_before == "track" and x.t < 300.0]
    assert len(gone) >= 3
    # Dead since the epoch before, 299 s: the first step that hears nothing is at 299.1 s, and half a second is coasted.
    assert {round(x.t, 6) for x in gone} == {299.6}
    count = broken.is_tracked.sum(axis=1)
    assert count[t == 300.0] == whole.is_tracked.sum(axis=1)[t == 300.0] - len(gone)
    missed = {x.satellite for x in gone}
    back = {x.satellite: x.t for x in broken.transitions if x.t > 329.0 and x.state_after == "track"}
    assert missed <= set(back)
    assert np.all(np.diff(sorted(back[name] for name in missed)) > 0.05)  # never two at once
    assert np.array_equal(broken.is_tracked[t >= 450.0], whole.is_tracked[t >= 450.0])


def test_more_satellites_are_in_view_as_the_launcher_rises():
    # Figures 9 and 20 of Canepa and Servidia: the mask sinks from 10 deg to below the horizontal.
    t = np.arange(-59.0, 560.0, 5.0)
    seen = sky(gps(), four(mask="10 deg", mask_height="75.188 km", tracking={"aiding": "fused"}), ascent(), t)
    count = seen.is_tracked.sum(axis=1)
    assert count[t > 500.0].min() >= count[t < 0.0].max() + 3
    assert seen.elevation[seen.is_tracked].min() < -0.1


def test_a_jump_of_thrust_shakes_off_a_narrow_loop_and_not_a_wide_one():
    def lost(bandwidth, push):
        card = four(loops=LOOPS | {"carrier_bandwidth": bandwidth}, antennas=[], tracking={"coast": "0 s"})
        found = sky(gps(), card, vertical(push=push), np.arange(-19.0, 33.0)).transitions
        return [(x.t, x.reason) for x in found if x.state_after == "lost"]

    assert lost("30 Hz", 5.0) == []
    narrow = lost("8 Hz", 80.0)
    assert narrow
    assert {reason for _, reason in narrow} == {"dynamics"}
    assert min(t for t, _ in narrow) == pytest.approx(0.1, abs=0.11)  # at ignition, not at the epoch after it


def test_the_line_of_sight_takes_its_share_of_the_jump():
    # A jump of acceleration across the line does not reach the loop: low satellites stay while high ones are lost.
    loops = LOOPS | {"carrier_bandwidth": "14 Hz"}
    card = four(loops=loops, antennas=[], mask="0 deg", tracking={"coast": "0 s"})
    seen = sky(gps(), card, vertical(push=40.0), np.arange(-19.0, 33.0))
    gone = {x.satellite for x in seen.transitions if x.state_after == "lost" and 0.0 <= x.t < 1.0}
    up = np.flatnonzero(seen.is_tracked[18])
    height = dict(zip(np.array(seen.names)[up], np.degrees(seen.elevation[18, up]), strict=True))
    assert gone
    assert set(height) - gone
    assert min(height[name] for name in gone) > max(height[name] for name in set(height) - gone)


def test_a_spinning_body_shakes_the_antennas_that_stand_off_its_axis():
    # Jerk of the phase centre is w^3 r: 15 rad/s and 0.5 m make 1690 m/s^3, on the axis nothing.
    def losses(lever):
        card = four(antennas=patches(lever, pattern={"kind": "cosine", "peak": "5 dBi", "exponent": 0.0}))
        t = np.arange(-19.0, -5.0)
        return sum(x.state_after == "lost" for x in sky(gps(), card, vertical(spin=15.0), t).transitions)

    assert losses("0 m") == 0
    assert losses("0.5 m") > 0


def test_phase_centres_stand_on_their_levers_and_move_with_the_spin():
    flight, t, step = vertical(spin=2.0), np.arange(-19.0, -5.0), 0.005
    card = four(antennas=patches("0.6 m"))
    r_i, v_i = antenna_states(flight, card, t)
    at = motion(flight, t)
    lever_arms = np.array(card.lever_arms)
    assert lever_arms.shape == (4, 3)
    np.testing.assert_allclose(
        r_i - at.r_i[:, None, :], np.einsum("nij,aj->nai", matrices(at.q_b_i), lever_arms), rtol=0.0, atol=1e-8
    )
    later, earlier = (antenna_states(flight, card, t + side)[0] for side in (step, -step))
    np.testing.assert_allclose(v_i, (later - earlier) / (2.0 * step), rtol=0.0, atol=1e-4)
    alone, _ = antenna_states(flight, receiver(lever_b=["2 m", "0 m", "0 m"]), t)
    assert alone.shape == (14, 1, 3)


def test_an_outage_is_a_fault_to_the_channels_and_ends_with_a_search():
    fault = SatelliteOutage(start="100 s", duration="20 s", keep=3)
    t = np.arange(-59.0, 560.0)
    seen = sky(gps(), four(), ascent(), t, [fault])
    within = (t >= 100.0) & (t < 120.0)
    assert np.all(seen.is_tracked[within].sum(axis=1) == 3)
    assert {x.reason for x in seen.transitions if 99.0 < x.t <= 100.0 and x.state_after == "lost"} == {"fault"}
    assert seen.is_tracked[t == 120.0].sum() == 3  # a plain receiver has them all back at once
    assert seen.is_tracked[t == 180.0].sum() > 5


def test_another_mask_leaves_the_draws_of_a_satellite_alone():
    # Both start cold with a searcher for every satellite, so who else is searched for does not matter.
    settings = {"start": "searching", "searchers": 16, "aiding": "none"}
    t = np.arange(-59.0, 100.0)
    low, high = (
        sky(gps(), four(mask=mask, tracking=settings), ascent(), t).transitions for mask in ("5 deg", "30 deg")
    )
    first = {x.satellite: x.t for x in high if x.state_after == "acquire" and x.t < -20.0}
    assert len(first) >= 3
    assert first == {x.satellite: x.t for x in low if x.state_after == "acquire" and x.satellite in first}


def test_latency_that_pushes_epochs_before_the_start_does_no_harm():
    t = np.maximum(-20.0, np.arange(-19.0, 33.0) - 2.5)
    seen = sky(gps(), four(), vertical(push=20.0), t)
    assert seen.is_tracked[0].sum() >= 8
    assert np.array_equal(seen.is_tracked[0], seen.is_tracked[1])


@pytest.mark.parametrize("t", [np.empty(0), np.array([-3.0])])
def test_no_epoch_or_a_single_one_is_a_flight_too(t):
    seen = sky(gps(), four(), vertical(), t)
    assert seen.is_tracked.shape == seen.cn0.shape == seen.state.shape == (t.size, 24)
    assert seen.lever_arms.shape == (4, 3)
    assert np.all((seen.state == TRACK) | (seen.state == IDLE))


def test_a_second_of_flight_with_four_antennas_takes_few_calls_whatever_the_number_of_satellites():
    # 275 calls a second today; one for each of the 96 pairs of satellite and antenna would double that.
    card, flight = four(antennas=patches("0.6 m")), ascent()
    spans = (np.arange(-59.0, end) for end in (0.0, 1.0, 251.0))  # the first loads what is needed
    _, few, many = (calls(lambda t=t: sky(gps(), card, flight, t)) for t in spans)
    assert 0 < many - few < 340 * 250


ALL = {
    "antennas": [
        {"name": "nose", "lever_b": ["2 m", "0 m", "0 m"], "cutoff": "95 deg", "boresight": [1, 0.1, 0],
         "pattern": {"kind": "table", "angle": ["0 deg", "90 deg"], "gain": ["-5 dBi", "-12 dBi"]}},
        {"name": "side", "boresight": [0, 1, 0], "cutoff": "70 deg",
         "pattern": {"kind": "cosine", "peak": "3 dBi", "exponent": 3, "front_to_back": "12 dB"}},
    ],
    "link": {},
    "loops": LOOPS | {"spacing": 0.5, "vibration": "2 deg/g"},
    "tracking": {"memory": "4 s", "acquire_above": "36 dB-Hz", "track_above": "34 dB-Hz", "search_time": "12 s"},
}  # fmt: skip
OTHER = {
    "antennas": {
        "0.lever_b": ["2 m", "1 m", "0 m"], "0.boresight": [1, -0.3, 0], "0.cutoff": "60 deg",
        "0.pattern.angle": ["0 deg", "60 deg"], "0.pattern.gain": ["-5 dBi", "-10 dBi"], "0.pattern.kind": "cosine",
        "1.pattern.peak": "4 dBi", "1.pattern.exponent": 1, "1.pattern.front_to_back": "3 dB",
    },
    "link": {
        "frequency": "1602 MHz", "transmit_power": "15 dBW", "transmit_gain": ["11 dBi"] * 5, "loss": "3 dB",
        "transmit_angle": ["0 deg", "5 deg", "10 deg", "12 deg", "14 deg"], "antenna_temperature": "100 K",
        "noise_figure": "3 dB", "implementation_loss": "2 dB",
    },
    "loops": {
        "carrier": "fll", "carrier_order": 2, "carrier_bandwidth": "15 Hz", "integration": "10 ms",
        "rate_interval": "0.2 s", "code_bandwidth": "1 Hz", "code_aided": False, "spacing": 0.8, "front_end": "6 MHz",
        "code_rate": "10.23 MHz", "jitter": "3 deg", "vibration": "0 deg/g",
    },
    "tracking": {
        "acquire_above": "40 dB-Hz", "track_above": "25 dB-Hz", "search_time": "30 s", "reacquire_time": "2 s",
        "memory": "2 s", "aiding": "none", "aided_factor": 0.5, "searchers": 2, "pull_in": "3 s", "coast": "3 s",
        "start": "searching", "realisation": 7,
    },
}  # fmt: skip


@cache
def reported(text=None):
    """Return all that the sky says of a receiver with everything, on a flight with a jolt, a spin and an outage."""
    card = receiver(**ALL) if text is None else ReceiverCard.model_validate_json(text)
    fault = SatelliteOutage(start="-12 s", duration="3 s", keep=3)
    seen = sky(gps(), card, vertical(spin=0.4, push=40.0), np.arange(-19.0, 33.0), [fault])
    arrays = b"".join(np.ascontiguousarray(part).tobytes() for part in seen[6:-1])
    return arrays + repr(seen.transitions).encode()


@pytest.mark.parametrize(("part", "name"), [(part, name) for part, names in OTHER.items() for name in names])
def test_every_field_of_hearing_and_tracking_changes_the_sky_or_is_refused(part, name):
    text = receiver(**ALL).model_dump(mode="json")
    *way, last = [part, *name.split(".")]
    at = text
    for key in way:
        at = at[int(key)] if isinstance(at, list) else at[key]
    assert last in at
    at[last] = OTHER[part][name]
    try:
        card = ReceiverCard.model_validate(text)
    except ValueError:
        return
    changes = reported(card.model_dump_json()) != reported()  # not in the assertion: the bytes are long
    assert changes


def test_no_field_of_hearing_and_tracking_is_left_out():
    models = {"link": LinkCard, "loops": LoopsCard, "tracking": TrackingCard}
    assert {part: set(model.model_fields) for part, model in models.items()} == {p: set(OTHER[p]) for p in models}
    labels = ("name", "source", "assumed", "second_hand", "pattern")
    antenna = {name for name in AntennaCard.model_fields if name not in labels}
    patterns = {f"pattern.{name}" for model in (CosineGain, TableGain) for name in model.model_fields}
    assert antenna | patterns == {name.partition(".")[2] for name in OTHER["antennas"]}
