import math

import numpy as np
import pytest
from pydantic import ValidationError
from ruamel.yaml import YAML

from lvnav_trade.world.receiver.antenna import AntennaCard, CosineGain, TableGain, gain, gains


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
