"""Precise orbits of SP3 files: between nodes they are those that the file was made of; faults are one line."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from lvnav_trade.gnss.constellation import PreciseConstellation, RinexConstellation
from lvnav_trade.gnss.kepler import Orbits
from lvnav_trade.gnss.precise import NODES, read_positions
from lvnav_trade.gnss.satellites import file_digests, satellites
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.times import GPS_ORIGIN

EPOCH = "2026-06-01T12:00:00Z"  # 12:00:18 of GPS time
STEP, BEFORE, COUNT = 900.0, 8, 24


def elements(eccentricity: float = 0.01):
    """Return three satellites on Keplerian orbits, times from EPOCH."""
    n = 3
    axis = np.full(n, 26.56e6)
    return Orbits(
        ("G01", "G02", "G05"), axis, np.full(n, eccentricity), np.full(n, 0.96), np.array([0.1, 1.2, 2.3]),
        np.full(n, -8e-9), np.array([0.4, 0.5, 0.6]), np.array([0.0, 1.0, 2.0]), np.sqrt(3.986005e14 / axis**3),
        np.array([1e-5, -2e-4, 3e-4]), np.array([1e-11, 0.0, -2e-11]), ("G", "G", "G"),
    )  # fmt: skip


def written(folder, count: int = COUNT, system: str = "GPS", change=lambda lines: lines):
    """Write a file of the satellites; its first node is BEFORE steps before 12:00 of GPS time."""
    above, lines = elements(), ["#cP2026  6  1 10  0  0.00000000", f"%c G  cc {system} ccc cccc"]
    for k in range(count):
        moment = datetime(2026, 6, 1, 12, tzinfo=UTC) + timedelta(seconds=STEP * (k - BEFORE))
        t = np.array(STEP * (k - BEFORE) - 18.0)
        lines.append(f"*  {moment:%Y %m %d %H %M} 0.00000000")
        r_e, clock = above.ecef(t)[0], above.clock(t)
        for name, place, ahead in zip(above.names, r_e / 1e3, clock, strict=True):
            lines.append(f"P{name}" + "".join(f"{value:14.6f}" for value in (*place, 1e6 * ahead)))
    file = folder / "orbits.sp3"
    file.write_text("\n".join(change([*lines, "EOF"])) + "\n")
    return file


def test_between_nodes_orbits_and_clocks_are_those_of_the_file(tmp_path):
    found, above = satellites(PreciseConstellation(sp3=str(written(tmp_path))), EPOCH), elements()
    assert (found.names, found.systems) == (above.names, above.systems)
    t = np.linspace(-1800.0, 3600.0, 61)[:, None] + np.array([0.0, 0.01, -0.02])
    r_e, v_e = found.ecef(t)
    true_r, true_v = above.ecef(t)
    np.testing.assert_allclose(r_e, true_r, rtol=0.0, atol=0.02)
    np.testing.assert_allclose(v_e, true_v, rtol=0.0, atol=1e-4)
    np.testing.assert_allclose(found.clock(t), above.clock(t), rtol=0.0, atol=2e-12)
    np.testing.assert_allclose(found.relativity(t), above.relativity(t), rtol=0.0, atol=2e-11)
    assert found.ecef(np.zeros((0, 3)))[0].shape == (0, 3, 3)


def test_two_files_are_one(tmp_path):
    whole = satellites(PreciseConstellation(sp3=str(written(tmp_path))), EPOCH)
    lines = (tmp_path / "orbits.sp3").read_text().splitlines()
    cut = [k for k, line in enumerate(lines) if line.startswith("* ")][11]
    for name, part in (("one", lines[:cut]), ("two", [*lines[:2], *lines[cut:]])):
        (tmp_path / f"{name}.sp3").write_text("\n".join(part) + "\n")
    card = PreciseConstellation(sp3=(str(tmp_path / "two.sp3"), str(tmp_path / "one.sp3")))
    t = np.linspace(-100.0, 800.0, 10)[:, None]
    np.testing.assert_array_equal(satellites(card, EPOCH).ecef(t)[0], whole.ecef(t)[0])
    assert len(file_digests(card).split()) == 2


def test_a_satellite_without_a_clock_is_left_out(tmp_path):
    def lost(lines):
        return [line[:46] + " 999999.999999" if line.startswith("PG02") else line for line in lines]

    found = satellites(PreciseConstellation(sp3=str(written(tmp_path, change=lost))), EPOCH)
    assert found.names == ("G01", "G05")


@pytest.mark.parametrize(
    ("options", "epoch", "said"),
    [
        ({}, "2026-06-02T12:00:00Z", "the lift-off needs 5 epochs before it and behind it"),
        ({"count": 6}, EPOCH, "6 epochs; at least 10 are needed"),
        ({"system": "UTC"}, EPOCH, "times are of UTC"),
        ({"change": lambda lines: ["RINEX", *lines[1:]]}, EPOCH, ":1: not an SP3 file"),
        ({"change": lambda lines: [line.replace("PG01", "PG01x") for line in lines]}, EPOCH, "is not a number"),
        ({"change": lambda lines: [line for line in lines if "P" not in line[:1]]}, EPOCH, "no satellite has position"),
        ({"change": lambda lines: [line.replace(" 11 00 ", " 11 61 ") for line in lines]}, EPOCH, "not a time"),
        ({"change": lambda lines: [line.replace(" 11 00 ", " 1_1 00 ") for line in lines]}, EPOCH, "not a time"),
        ({"change": lambda lines: [line.replace("0.00000000", "nan") for line in lines]}, EPOCH, "not a time"),
    ],
)
def test_faults_are_said_with_their_place(tmp_path, options, epoch, said):
    with pytest.raises(InputError, match=said) as found:
        satellites(PreciseConstellation(sp3=str(written(tmp_path, **options))), epoch)
    assert "\n" not in str(found.value)


def test_a_flight_beyond_the_file_is_refused(tmp_path):
    found = satellites(PreciseConstellation(sp3=str(written(tmp_path))), EPOCH)
    with pytest.raises(InputError, match="the flight goes beyond them"):
        found.ecef(np.array([[5.0 * 3600.0]]))


def test_between_recorded_nodes_broadcast_orbits_are_as_near_as_at_nodes(refdata, record_property):
    file = refdata / "gnss/sp3/igs15904.sp3"
    nodes = read_positions(file)
    assert nodes.t[0] == (datetime(2010, 7, 1, tzinfo=UTC) - GPS_ORIGIN).total_seconds()
    rms = []
    for hour in (4, 8, 12, 16, 20):
        epoch = f"2010-07-01T{hour - 1:02d}:59:45Z"  # 15 s behind GPS time then: nodes are at zero
        sky = satellites(RinexConstellation(rinex=str(refdata / "gnss/rinex2/brdc1820.10n")), epoch)
        exact = satellites(PreciseConstellation(sp3=str(file)), epoch)
        both = [(sky.names.index(name), exact.names.index(name)) for name in exact.names if name in sky.names]
        assert len(both) > 25
        one, other = np.array(both).T
        rms.append([np.sqrt(np.mean((sky.ecef(t)[0][one] - exact.ecef(t)[0][other]) ** 2) * 3.0)
                    for t in (np.array(0.0), np.array(450.0))])  # fmt: skip
    at_nodes, between = np.sqrt(np.mean(np.square(rms), axis=0))
    record_property("measured", f"broadcast against precise orbits: {at_nodes:.3f} m at nodes, {between:.3f} m between")
    assert 1.0 < at_nodes < 2.6
    assert abs(between / at_nodes - 1.0) < 0.1


def test_a_polynomial_of_all_nodes_of_a_short_file_is_enough(tmp_path):
    found = satellites(PreciseConstellation(sp3=str(written(tmp_path, count=BEFORE + NODES // 2 + 2))), EPOCH)
    np.testing.assert_allclose(found.ecef(np.array(0.0))[0], elements().ecef(np.array(0.0))[0], atol=0.02)
