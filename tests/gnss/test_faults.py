import numpy as np
import pytest
from pydantic import ValidationError

from lvnav_trade.gnss.fault_cards import (
    AntennaFailure,
    ClockDrift,
    ClockJump,
    DegradedNoise,
    FrozenOutput,
    LatencyChange,
    RangeBias,
    SatelliteOutage,
    WildSamples,
)
from lvnav_trade.gnss.faults import antennas_alive, delay, failures, highest, satellite_outages
from lvnav_trade.quantities.conditions import FlightProfile
from lvnav_trade.quantities.errors import InputError

T = np.arange(0.0, 20.0)
COURSE = FlightProfile({"lift_off": 0.0, "stage1_cutoff": 8.0})
# Four satellites at constant rates; the second is the highest at first, and the third from 7.5 s on.
ELEVATION = np.stack([0.3 + 0.0 * T, 0.9 - 0.02 * T, 0.6 + 0.02 * T, 0.1 + 0.0 * T], axis=1)
VISIBLE = np.ones((20, 4), dtype=bool)


def outage(start="stage1_cutoff + 2 s", duration="5 s", keep=0):
    return SatelliteOutage(start=start, duration=duration, keep=keep)


def test_a_total_outage_takes_all_from_its_start_until_before_its_end():
    gone = satellite_outages([outage()], COURSE, T, ELEVATION, VISIBLE)
    assert np.flatnonzero(gone.all(axis=1)).tolist() == [10, 11, 12, 13, 14]
    assert np.flatnonzero(gone.any(axis=1)).tolist() == [10, 11, 12, 13, 14]


def test_a_partial_outage_keeps_the_highest_at_its_start_though_others_rise_above_them():
    gone = satellite_outages([outage(start="5 s", duration="10 s", keep=1)], COURSE, T, ELEVATION, VISIBLE)
    assert np.all(gone[5:15] == [True, False, True, True])
    assert not gone[:5].any()
    assert not gone[15:].any()


def test_a_partial_outage_keeps_only_what_could_be_tracked_at_its_start():
    visible = VISIBLE.copy()
    visible[:6, 1] = False
    gone = satellite_outages([outage(start="5 s", keep=2)], COURSE, T, ELEVATION, visible)
    assert np.all(gone[5:10] == [False, True, False, True])


def test_an_outage_that_begins_between_epochs_takes_the_sky_of_the_next_one():
    gone = satellite_outages([outage(start="4.4 s", duration="2 s", keep=1)], COURSE, T, ELEVATION, VISIBLE)
    assert np.flatnonzero(gone.any(axis=1)).tolist() == [5, 6]


def test_where_two_outages_hold_each_takes_its_share_in_any_order():
    faults = [outage(start="5 s", duration="10 s", keep=2), outage(start="9 s", duration="3 s", keep=1)]
    gone = satellite_outages(faults, COURSE, T, ELEVATION, VISIBLE)
    assert np.array_equal(gone, satellite_outages(faults[::-1], COURSE, T, ELEVATION, VISIBLE))
    assert (~gone).sum(axis=1).tolist() == [4] * 5 + [2] * 4 + [1] * 3 + [2] * 3 + [4] * 5


def test_an_outage_of_no_length_or_none_at_all_takes_nothing():
    assert not satellite_outages([outage(duration="0 s")], COURSE, T, ELEVATION, VISIBLE).any()
    assert not satellite_outages([], COURSE, T, ELEVATION, VISIBLE).any()


def test_an_epoch_that_rounding_has_moved_still_lies_on_the_edge():
    gone = satellite_outages([outage(start="10 s", duration="5 s")], COURSE, T - 1e-12, ELEVATION, VISIBLE)
    assert np.flatnonzero(gone.any(axis=1)).tolist() == [10, 11, 12, 13, 14]


@pytest.mark.parametrize("start", ["30 s", "-100 s"])
def test_an_outage_outside_the_flight_is_refused(start):
    with pytest.raises(
        InputError, match=r"^faults\.1\.start: the outage from .* lies outside the flight \(0 s to 19 s\)$"
    ):
        satellite_outages([outage(), outage(start=start)], COURSE, T, ELEVATION, VISIBLE)


def test_a_start_at_an_unknown_event_is_refused_with_its_place():
    with pytest.raises(InputError, match=r"^faults\.0\.start: .*stage1_cutof"):
        satellite_outages([outage(start="stage1_cutof + 2 s")], COURSE, T, ELEVATION, VISIBLE)


def test_an_outage_of_negative_length_is_refused():
    with pytest.raises(ValidationError, match="greater than or equal to 0"):
        outage(duration="-5 s")


def test_the_highest_are_chosen_among_the_candidates_only():
    elevation, candidates = np.array([0.5, 0.9, 0.1, 0.5]), np.array([True, False, True, True])
    assert highest(elevation, candidates, 0).tolist() == [False] * 4
    assert highest(elevation, candidates, 1).tolist() == [True, False, False, False]
    assert highest(elevation, candidates, 2).tolist() == [True, False, False, True]
    assert highest(elevation, candidates, 9).tolist() == candidates.tolist()


def test_an_antenna_that_is_not_there_cannot_fail():
    with pytest.raises(InputError, match=r"faults\.0\.antennas: antenna 5: the receiver has 4, counted from 1"):
        antennas_alive([AntennaFailure(start="2 s", duration="3 s", antennas=[5])], COURSE, T, 4)


def test_antennas_fail_from_after_the_start_until_the_end():
    alive = antennas_alive([AntennaFailure(start="2 s", duration="3 s", antennas=[1, 3])], COURSE, T, 4)
    assert np.flatnonzero(~alive[:, 0]).tolist() == [3, 4, 5]
    assert np.array_equal(alive[:, 0], alive[:, 2])
    assert alive[:, 1].all()
    assert alive[:, 3].all()


def test_latency_changes_add_up_where_they_overlap():
    late = delay(
        [
            LatencyChange(start="2 s", duration="4 s", by="100 ms"),
            LatencyChange(start="4 s", duration="4 s", by="50 ms"),
        ],
        COURSE, T,
    )  # fmt: skip
    np.testing.assert_allclose(late[:10], [0, 0, 0.1, 0.1, 0.15, 0.15, 0.05, 0.05, 0, 0])


def test_each_fault_touches_its_own_satellites_and_times_only():
    names = ("G01", "G02", "G03", "G04")
    out = failures(
        [
            DegradedNoise(start="3 s", duration="2 s", factor=4.0, satellites=["G02"]),
            DegradedNoise(start="15 s", duration="2 s", factor=2.0),
            RangeBias(start="stage1_cutoff", duration="4 s", size="20 m", drift="3 m/s"),
            ClockJump(start="12.4 s", size="150 m"),
            WildSamples(start="5 s", duration="2 s", sigma="100 m", satellites=["G04"]),
            FrozenOutput(start="17 s", duration="9 s"),
        ],
        COURSE, T, names, ELEVATION, VISIBLE,
    )  # fmt: skip
    assert {tuple(place) for place in np.argwhere(out.noise == 4.0).tolist()} == {(3, 1), (4, 1)}
    assert np.all(out.noise[15:17] == 2.0)
    assert np.flatnonzero(out.solution_noise != 1.0).tolist() == [15, 16]
    # the highest at the fault's start, the third from 7.5 s on
    np.testing.assert_allclose(out.bias[8:12, 2], [20.0, 23.0, 26.0, 29.0])
    assert np.count_nonzero(out.bias) == 4
    np.testing.assert_allclose(out.drift[8:12, 2], 3.0)
    assert np.flatnonzero(out.jump[:, 0]).tolist() == [13]
    assert out.jump.sum() == 150.0
    assert {tuple(place) for place in np.argwhere(out.wild_sigma > 0.0).tolist()} == {(5, 3), (6, 3)}
    assert np.flatnonzero(out.is_frozen).tolist() == [17, 18, 19]


def test_a_clock_that_drifts_gains_from_its_start_to_its_end_whatever_the_epochs():
    card = ClockDrift(start="4.25 s", duration="10 s", rate="2 m/s")
    jump = failures([card], COURSE, T, ("a", "b", "c", "d"), ELEVATION, VISIBLE).jump
    assert np.flatnonzero(jump.any(axis=1)).tolist() == [5, 15]
    np.testing.assert_allclose(jump[[5, 15]], [[1.5, 2.0], [-1.5, -2.0]])
    # bias and drift as a receiver steps them
    bias = drift = 0.0
    for t, (jumped, changed) in zip(T, jump, strict=True):
        bias, drift = bias + drift + jumped, drift + changed
        assert bias == pytest.approx(2.0 * np.clip(t - 4.25, 0.0, 10.0))


def test_a_satellite_that_is_none_of_the_constellation_is_named():
    with pytest.raises(InputError, match=r"faults\.1\.satellites: 'G9' is not in the constellation \(it has "):
        failures(
            [outage(), DegradedNoise(start="3 s", duration="2 s", factor=4.0, satellites=["G9"])],
            COURSE, T, ("G01", "G02", "G03", "G04"), ELEVATION, VISIBLE,
        )  # fmt: skip


def test_any_fault_outside_the_flight_is_refused_with_its_kind():
    with pytest.raises(InputError, match=r"faults\.0\.start: the clock jump from 50 s to 50 s lies outside the flight"):
        failures([ClockJump(start="50 s", size="1 m")], COURSE, T, ("G01",) * 4, ELEVATION, VISIBLE)
