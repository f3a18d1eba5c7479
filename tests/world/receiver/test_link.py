import math

import numpy as np
import pytest
from pydantic import ValidationError

from lvnav_trade.world.receiver.link import LinkCard, carrier_to_noise, off_nadir, path_loss, received_power

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
        angle = float(off_nadir(there, direction))
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
