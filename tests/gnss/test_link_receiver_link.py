"""Antennas and the link budget."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError
from ruamel.yaml import YAML

from lvnav_trade.gnss.link import (
    AntennaCard,
    CosineGain,
    LinkCard,
    TableGain,
    carrier_to_noise,
    gain,
    gains,
    path_loss,
    received_power,
)
from lvnav_trade.quantities.line_of_sight import off_nadir_angle


def antenna(**changes):
    return AntennaCard(**({"name": "test", "pattern": {"kind": "cosine", "peak": "5 dBi"}} | changes))


def mean_gain(card):
    """Return the gain averaged over the sphere (a ratio): what an antenna hears in all can be no more than 1."""
    angle = np.linspace(0.0, math.pi, 20001)
    ratio = 10.0 ** (0.1 * gain(card, angle))
    return np.trapezoid(ratio * np.sin(angle), angle) / 2.0


def test_a_cosine_loses_three_decibels_at_sixty_degrees_and_ends_in_its_back_lobes():
    card = antenna()
    angles = np.radians([0.0, 60.0, 89.9, 90.0, 180.0])
    np.testing.assert_allclose(gain(card, angles), [5.0, 5.0 - 3.0103, -10.0, -10.0, -10.0], atol=1e-4)


def test_without_back_lobes_a_cosine_has_its_textbook_directivity():
    # Directivity of cos^n in power over a half space is 2 (n + 1): 6.02 dBi for n = 1, 7.78 dBi for n = 2.
    for exponent, directivity in ((1.0, 4.0), (2.0, 6.0)):
        pattern = CosineGain(peak=f"{10 * math.log10(directivity)} dBi", exponent=exponent, front_to_back="90 dB")
        assert mean_gain(antenna(pattern=pattern)) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("name", ["patch", "hemispherical"])
def test_a_shipped_antenna_hears_no_more_than_an_antenna_can(root, name):
    card = AntennaCard(**YAML(typ="safe").load(root / f"configs/antennas/{name}.yaml"))
    assert 0.3 < mean_gain(card) <= 1.0


def test_a_table_is_met_at_its_entries_and_straight_between_them():
    card = antenna(pattern=TableGain(angle=("0 deg", "40 deg", "90 deg"), gain=("4 dBi", "2 dBi", "0 dBi")))
    np.testing.assert_allclose(gain(card, np.radians([0.0, 20.0, 40.0, 65.0, 120.0])), [4.0, 3.0, 2.0, 1.0, 0.0])


def test_what_lies_beyond_the_cutoff_is_not_heard():
    card = antenna(cutoff="80 deg")
    assert np.isneginf(gain(card, np.radians([79.9, 80.1]))).tolist() == [False, True]


def test_every_antenna_is_checked_by_its_own_boresight_whatever_its_length():
    cards = [antenna(boresight=(0.0, 2.0, 0.0)), antenna(boresight=(0.0, -0.5, 0.0))]
    sideways = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    np.testing.assert_allclose(gains(cards, sideways), [[5.0, -10.0], [-10.0, 5.0]])
    tilted = np.array([0.3, math.cos(0.5), math.sin(0.5)]) / math.hypot(0.3, 1.0)
    angle = math.acos(tilted[1])
    assert gains(cards, tilted)[0] == pytest.approx(5.0 + 10.0 * math.log10(math.cos(angle)))


def test_without_antennas_one_hears_all_directions_alike():
    assert gains((), np.ones((4, 3, 3))).tolist() == np.zeros((4, 3, 1)).tolist()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"boresight": (0.0, 0.0, 0.0)}, "has no direction"),
        ({"pattern": {"kind": "table", "angle": ["0 deg", "10 deg"], "gain": ["1 dBi"]}}, "2 angles but 1 gains"),
        ({"pattern": {"kind": "table", "angle": ["0 deg", "0 deg"], "gain": ["1 dBi", "2 dBi"]}}, "must rise"),
    ],
)
def test_an_antenna_that_makes_no_sense_is_refused(changes, message):
    with pytest.raises(ValidationError, match=message):
        antenna(**changes)


# Link budget of the technology handbook of Chungbuk National University: elevation, range, gain of the satellite.
EDGE, MIDDLE, ZENITH = (math.radians(elevation) for elevation in (5.0, 50.0, 90.0))
RANGES = {EDGE: 25150e3, MIDDLE: 21410e3, ZENITH: 20180e3}
GROUND, ORBIT = 6378e3, 26560e3


def nadir_angle(elevation):
    return math.asin(GROUND / ORBIT * math.cos(elevation))


def at_ground(card, elevation):
    return float(received_power(card, np.array(RANGES[elevation]), np.array(nadir_angle(elevation))))


def test_the_free_space_loss_is_the_textbooks():
    # (4 pi R / lambda)^2 at 20 180 km on L1: 182.5 dB; the edge of the Earth is 20 log10(25150 / 20180) further.
    zenith, edge = path_loss(LinkCard(), np.array([20180e3, 25150e3]))
    assert zenith == pytest.approx(182.5, abs=0.05)
    assert edge - zenith == pytest.approx(1.912, abs=0.001)


def test_the_ranges_of_the_handbook_are_those_of_its_elevations():
    for elevation, distance in RANGES.items():
        closed = math.sqrt(ORBIT**2 - (GROUND * math.cos(elevation)) ** 2) - GROUND * math.sin(elevation)
        assert closed == pytest.approx(distance, rel=0.004)


def test_the_gains_of_the_handbook_stand_at_the_nadir_angles_of_its_elevations():
    card = LinkCard()
    angles = [nadir_angle(elevation) for elevation in (ZENITH, MIDDLE, EDGE)]
    np.testing.assert_allclose(
        np.interp(angles, card.transmit_angle, card.transmit_gain), [11.8, 15.1, 13.8], atol=0.02
    )


def test_the_received_power_is_the_handbooks_at_the_zenith():
    assert at_ground(LinkCard(), ZENITH) == pytest.approx(-158.2, abs=0.05)


def test_every_satellite_above_five_degrees_meets_the_minimum_of_the_interface():
    # IS-GPS-200, table 3-V: at least -158.5 dBW for L1 C/A above 5 deg, and section 6.3.1: at most -153 dBW.
    elevation = np.radians(np.linspace(5.0, 90.0, 50))
    distance = np.sqrt(ORBIT**2 - (GROUND * np.cos(elevation)) ** 2) - GROUND * np.sin(elevation)
    power = received_power(LinkCard(), distance, np.arcsin(GROUND / ORBIT * np.cos(elevation)))
    assert np.all(power > -158.5)
    assert np.all(power < -153.0)
    assert np.argmax(power) not in (0, 49)  # strongest half way up: the beam is shaped to level the edge and the zenith


def test_the_carrier_to_noise_density_is_the_handbooks():
    # Ts = 316 K, N0 = -203.6 dBW/Hz: 38.5 to 46.5 dB-Hz; with 3 dB for receiver and implementation 35.5 to 43.5.
    bare = LinkCard(antenna_temperature="316 K", noise_figure="0 dB", implementation_loss="0 dB")
    assert carrier_to_noise(bare, np.array(-203.6)) == pytest.approx(0.0, abs=0.02)
    lossy = bare.model_copy(update={"implementation_loss": 3.0})
    for elevation in (EDGE, ZENITH):
        assert 38.5 < carrier_to_noise(bare, at_ground(bare, elevation)) < 46.5
        assert 35.5 < carrier_to_noise(lossy, at_ground(lossy, elevation)) < 43.5


def test_the_system_temperature_adds_the_receivers_own():
    # Septentrio's manual: C/N0 = P - 10 log10(Tant + 290 (10^(NF/10) - 1)) + 228.6 with Tant near 130 K.
    card = LinkCard(antenna_temperature="130 K", noise_figure="3 dB", implementation_loss="0 dB")
    expected = -158.5 - 10.0 * math.log10(130.0 + 290.0 * (10.0**0.3 - 1.0)) + 228.6
    assert carrier_to_noise(card, np.array(-158.5)) == pytest.approx(expected, abs=0.002)


def test_the_angle_at_the_satellite_closes_the_triangle():
    for elevation, distance in RANGES.items():
        here = np.array([GROUND, 0.0, 0.0])
        direction = np.array([math.sin(elevation), math.cos(elevation), 0.0])
        there = here + distance * direction
        angle = float(off_nadir_angle(there, direction))
        # Law of sines: sin(angle) / ground = sin(90 deg + elevation) / distance of the satellite from the centre.
        assert math.sin(angle) == pytest.approx(GROUND * math.cos(elevation) / np.linalg.norm(there), abs=1e-9)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"transmit_angle": ("0 deg",)}, "1 transmit angles but 5 gains"),
        ({"transmit_angle": ("0 deg", "0 deg"), "transmit_gain": ("1 dBi", "1 dBi")}, "must rise"),
        ({"antenna_temperature": "0 K", "noise_figure": "0 dB"}, "have no noise"),
    ],
)
def test_a_link_that_makes_no_sense_is_refused(changes, message):
    with pytest.raises(ValidationError, match=message):
        LinkCard(**changes)
