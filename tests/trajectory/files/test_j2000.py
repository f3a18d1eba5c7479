"""Axes of J2000 to axes of date, against a published example and values of ERFA 2.0."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.trajectory.files.j2000 import rotation_to_date

ARCSEC = np.pi / 648000.0


def test_a_published_state_is_turned_to_the_true_equator_and_mean_equinox_of_date() -> None:
    # Vallado et al., Revisiting Spacetrack Report 3 (AIAA 2006-6753), appendix C: J2000 without corrections, and TEME
    r, v = np.array([5102.5096, 6123.01152, 6378.1363]), np.array([-4.7432196, 0.7905366, 5.53375619])
    turn = rotation_to_date("2004-04-06T07:51:28.386009Z")
    assert turn @ r == pytest.approx([5094.1801072, 6127.6447052, 6380.3445327], abs=3e-4)  # km; 0.01 arcsec
    assert turn @ v == pytest.approx([-4.746131487, 0.785818041, 5.531931288], abs=1e-6)


@pytest.mark.parametrize(
    ("epoch", "expected"),
    [  # R3(eqeq94) pnm80 of ERFA 2.0, all 106 terms
        ("2024-03-20T12:00:00Z", [
            [9.999825873431e-01, -5.415541714539e-03, -2.344550828246e-03],
            [5.415436164542e-03, 9.999853350988e-01, -5.136538021229e-05],
            [2.344794616999e-03, 3.866772045964e-05, 9.999972502177e-01],
        ]),
        ("2031-09-01T03:00:00Z", [
            [9.999701046804e-01, -7.081447792349e-03, -3.105292667945e-03],
            [7.081524663350e-03, 9.999749255952e-01, 1.376026418108e-05],
            [3.105117361987e-03, -3.575005942856e-05, 9.999951784724e-01],
        ]),
    ],
)  # fmt: skip
def test_twenty_terms_of_nutation_are_those_of_the_whole_series_to_hundredths_of_an_arcsecond(epoch, expected) -> None:
    turn = rotation_to_date(epoch)
    assert turn @ turn.T == pytest.approx(np.eye(3), abs=1e-15)
    assert np.max(np.abs(turn - expected)) < 0.03 * ARCSEC
