"""BeiDou: time, constants and orbits of all kinds, against a recorded file, published places, the ICD's algorithm."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError
from ruamel.yaml import YAML

from lvnav_trade.gnss.broadcast import GEOSTATIONARY, broadcast_ephemerides
from lvnav_trade.gnss.constellation import (
    AlmanacConstellation,
    NominalConstellation,
    RinexConstellation,
    orbits,
)
from lvnav_trade.gnss.kepler import EARTH_RATE_BEIDOU, GM_BEIDOU
from lvnav_trade.gnss.rinex import read_navigation
from lvnav_trade.gnss.satellites import nearest_records, satellites, time_offsets
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import geodetic_from_ecef
from lvnav_trade.quantities.times import gps_seconds, resolve_beidou_week
from tests.gnss.test_broadcast import own
from tests.gnss.test_rinex import HEAD_3
from tests.trajectory.products import gps_time

MIXED = "gnss/rinex3/VILL00ESP_R_20181700000_01D_MN.rnx.gz"
NOON = "2018-06-19T12:00:00Z"
NOW = np.zeros(1)
SYNCHRONOUS = 6493.4
RECORD = """\
C05 2018 06 19 12 00 00-6.033743266016E-04-2.987121726392E-11 0.000000000000E+00
     1.000000000000E+00-4.421562500000E+02-1.060044153420E-09 1.203412341234E+00
    -1.450767740607E-05 7.345912745222E-04-1.027248799801E-05 6.493436752319E+03
     2.160000000000E+05 2.100132405758E-07 1.123412341234E+00 6.100162863731E-08
     8.837890625000E-02 3.192968750000E+02-2.123412341234E+00 1.285767840820E-09
    -3.150131236212E-10 0.000000000000E+00 6.500000000000E+02 0.000000000000E+00
     2.000000000000E+00 0.000000000000E+00-5.600000000000E-10-9.000000000000E-09
     2.160000000000E+05 0.000000000000E+00
"""


def recorded(refdata):
    return [item for item in read_navigation(refdata / MIXED).ephemerides if item.name[0] == "C"]


def test_beidou_time_is_14_s_behind_gps_time_and_counts_its_weeks_from_2006():
    begin = gps_seconds("2006-01-01T00:00:00Z")
    assert resolve_beidou_week(0, 0.0, begin) == begin == gps_time(2006, 1, 1, 0, 0) + 14.0
    # week 650 began on 2018-06-17 00:00 BDT, which was 23:59:56 UTC
    assert resolve_beidou_week(650, 0.0, 0.0) == gps_seconds("2018-06-16T23:59:56Z")
    assert resolve_beidou_week(650 - 512, 3.0, gps_seconds(NOON)) == resolve_beidou_week(650, 3.0, 0.0)


def test_a_record_of_beidou_is_in_beidou_time(tmp_path):
    path = tmp_path / "own.rnx"
    path.write_text(HEAD_3 + RECORD)
    (record,) = read_navigation(path).ephemerides
    assert record.toc == record.toe == gps_time(2018, 6, 19, 12, 0, 14)
    assert record.elements["week_second"] == 216000.0
    assert (record.health, record.elements["group_delay"], record.elements["data_source"]) == (0.0, -5.6e-10, 0.0)


def from_the_document(item, t):
    """The BDS-SIS-ICD's table 5-11, line by line, at t s of BeiDou's seconds of week; Earth-fixed position."""
    e, mu, rate = item.elements, 3.986004418e14, 7.2921150e-5
    a, tk = e["root_axis"] ** 2, t - e["week_second"]
    M = e["mean_anomaly"] + (math.sqrt(mu / a**3) + e["mean_motion_difference"]) * tk
    E = M
    for _ in range(50):
        E = M + e["eccentricity"] * math.sin(E)
    v = math.atan2(math.sqrt(1 - e["eccentricity"] ** 2) * math.sin(E), math.cos(E) - e["eccentricity"])
    phi = v + e["perigee"]
    s, c = math.sin(2 * phi), math.cos(2 * phi)
    u = phi + e["latitude_sin"] * s + e["latitude_cos"] * c
    r = a * (1 - e["eccentricity"] * math.cos(E)) + e["radius_sin"] * s + e["radius_cos"] * c
    i = e["inclination"] + e["inclination_rate"] * tk + e["inclination_sin"] * s + e["inclination_cos"] * c
    x, y = r * math.cos(u), r * math.sin(u)
    turning = 0.0 if int(item.name[1:]) in (1, 2, 3, 4, 5, 59, 60, 61, 62, 63) else rate
    node = e["node"] + (e["node_rate"] - turning) * tk - rate * e["week_second"]
    place = np.array([
        x * math.cos(node) - y * math.cos(i) * math.sin(node),
        x * math.sin(node) + y * math.cos(i) * math.cos(node), y * math.sin(i),
    ])  # fmt: skip
    if turning:
        return place
    about_x, about_z = math.radians(-5.0), rate * tk
    X = np.array([[1, 0, 0], [0, math.cos(about_x), math.sin(about_x)], [0, -math.sin(about_x), math.cos(about_x)]])
    Z = np.array([[math.cos(about_z), math.sin(about_z), 0], [-math.sin(about_z), math.cos(about_z), 0], [0, 0, 1]])
    return Z @ X @ place


def test_every_recorded_satellite_stands_where_the_documents_algorithm_says(refdata):
    found = recorded(refdata)
    assert {item.name for item in found} >= {"C05", "C06", "C11"}  # GEO, IGSO, MEO
    for item in found:
        (r_e,), _ = broadcast_ephemerides([item], item.toe + 1700.0).ecef(NOW)
        np.testing.assert_allclose(r_e, from_the_document(item, item.elements["week_second"] + 1700.0), atol=1e-6)


def test_recorded_satellites_have_the_published_places_of_their_kind(refdata):
    near = nearest_records(recorded(refdata), gps_seconds(NOON))
    day = np.linspace(-12.0, 12.0, 145)[:, None] * 3600.0
    for name, (radius, inclination, crossing) in {
        "C05": (42164e3, None, 58.75), "C08": (42164e3, 55.0, 118.0), "C09": (42164e3, 55.0, 95.0),
        "C10": (42164e3, 55.0, 95.0), "C13": (42164e3, 55.0, 95.0),
        "C11": (27906e3, 55.0, None), "C12": (27906e3, 55.0, None), "C14": (27906e3, 55.0, None),
    }.items():  # fmt: skip
        r_e = broadcast_ephemerides([near[name]], near[name].toe).ecef(day)[0][:, 0]
        latitude, longitude, _ = np.degrees(geodetic_from_ecef(r_e))
        # the harmonics of an hour's fit are no model of a whole day: 0.1 % of the radius at most
        assert np.mean(np.linalg.norm(r_e, axis=1)) == pytest.approx(radius, rel=1e-3), name
        if inclination is None:
            assert np.max(np.abs(latitude)) < 2.5, name  # old GEO tilt by some degrees
            assert np.max(np.abs(longitude - crossing)) < 0.7, name
        else:
            assert np.max(latitude) == pytest.approx(inclination, abs=4.0), name
        if inclination and crossing:
            north = np.flatnonzero((latitude[:-1] < 0.0) & (latitude[1:] >= 0.0))
            assert np.min(np.abs(longitude[north] - crossing)) < 8.0, name


def test_successive_ephemerides_of_all_kinds_meet_half_way(refdata, record_property):
    by_time = {(item.name, item.toe): item for item in recorded(refdata) if item.health == 0.0}
    gaps = {}
    for (name, toe), item in by_time.items():
        other = by_time.get((name, toe + 3600.0))
        if other is not None:
            ours, theirs = (broadcast_ephemerides([one], toe + 1800.0).ecef(NOW)[0] for one in (item, other))
            kind = "GEO" if name in GEOSTATIONARY else "MEO" if name in ("C11", "C12", "C14") else "IGSO"
            gaps.setdefault(kind, []).append(float(np.linalg.norm(ours - theirs)))
    assert {kind: len(found) > 7 for kind, found in gaps.items()} == {"GEO": True, "IGSO": True, "MEO": True}
    rms = {kind: float(np.sqrt(np.mean(np.square(found)))) for kind, found in gaps.items()}
    record_property("BeiDou: RMS gap half way to the next ephemeris in m", {k: round(v, 3) for k, v in rms.items()})
    assert max(rms.values()) < 3.0


def test_velocity_is_the_derivative_of_position_for_a_tilted_satellite_too():
    above = broadcast_ephemerides([own(name="C03", root_axis=SYNCHRONOUS, inclination=0.09), own(name="C11")], 1.2e9)
    t, step = np.linspace(-7200.0, 40000.0, 23)[:, None], 0.25
    difference = (above.ecef(t + step)[0] - above.ecef(t - step)[0]) / (2.0 * step)
    np.testing.assert_allclose(above.ecef(t)[1], difference, rtol=0.0, atol=2e-5)
    np.testing.assert_array_equal(above.is_geostationary, [True, False])


def test_systems_that_are_no_beidou_are_not_moved_by_one_that_is():
    alone, beside = broadcast_ephemerides([own()], 1.2e9), broadcast_ephemerides([own(), own(name="C03")], 1.2e9)
    for one, other in zip(alone.ecef(NOW + 900.0), beside.ecef(NOW[:, None] + 900.0), strict=True):
        np.testing.assert_array_equal(one[0], other[0, 0])


def test_four_systems_of_a_recorded_file_are_up_around_its_noon(refdata):
    above = satellites(RinexConstellation(rinex=str(refdata / MIXED)), NOON)
    assert set(above.systems) == {"G", "E", "C", "R"}
    assert above.systems.count("C") >= 3


def test_the_time_offset_of_the_file_is_the_ranges_where_it_is_ignored(tmp_path):
    path = tmp_path / "own.rnx"
    head = HEAD_3.replace(
        "                                                            END OF HEADER",
        "BDGP  4.0000000000E-08 1.000000000E-14 216000  650          TIME SYSTEM CORR\n"
        "                                                            END OF HEADER",
    )
    path.write_text(head + RECORD)
    (offset,) = read_navigation(path).offsets
    assert (offset.system, offset.bias, offset.drift) == ("C", 4e-8, 1e-14)
    assert offset.time == gps_time(2018, 6, 19, 12, 0, 14)
    card = RinexConstellation(rinex=str(path), time_correction="ignored")
    found = time_offsets(card, ("C", "C"), NOON, np.array([0.0, 100.0]))
    age = gps_seconds(NOON) + np.array([0.0, 100.0]) - offset.time
    np.testing.assert_allclose(found[:, 0, 0], -299792458.0 * (4e-8 + 1e-14 * age), rtol=1e-12)  # 12 m
    path.write_text(HEAD_3 + RECORD)
    with pytest.raises(InputError, match="no TIME SYSTEM CORR between BeiDou and GPS time"):
        time_offsets(card, ("C",), NOON, np.array([0.0]))


# --- almanac ----------------------------------------------------------------------------------------------------------

YUMA = """\
******** Week {week} almanac for PRN-{prn:02d} ********
ID: {prn:02d}
Health: 000
Eccentricity: {eccentricity!r}
Time of Applicability(s): {week_second!r}
Orbital Inclination(rad): {inclination!r}
Rate of Right Ascen(r/s): {node_rate!r}
SQRT(A)  (m 1/2): {root_axis!r}
Right Ascen at Week(rad): {node!r}
Argument of Perigee(rad): {perigee!r}
Mean Anom(rad): {mean_anomaly!r}
Af0(s): 0.0
Af1(s/s): 0.0
week: {week}

"""


def yuma(tmp_path, week, **fields):
    path = tmp_path / "own.alc"
    path.write_text(YUMA.format(week=week, **fields))
    return AlmanacConstellation(almanac=str(path), system="BeiDou")


def test_an_almanac_is_the_ephemeris_without_its_harmonics(refdata, tmp_path):
    for name in ("C08", "C11"):
        item = nearest_records(recorded(refdata), gps_seconds(NOON))[name]
        card = yuma(tmp_path, 650, prn=int(name[1:]), **item.elements)
        above = satellites(card, "2018-06-19T06:00:00Z")
        assert (above.names, above.systems) == ((name,), ("C",))
        t = item.toe - gps_seconds("2018-06-19T06:00:00Z")
        (ours,), _ = above.ecef(np.array([t]))
        np.testing.assert_allclose(ours, broadcast_ephemerides([item], item.toe).ecef(NOW)[0][0], rtol=0.0, atol=3e3)


@pytest.mark.parametrize("week", [650, 650 - 512])
def test_a_geostationary_satellite_of_an_almanac_stands_at_its_longitude(tmp_path, week):
    axis = (GM_BEIDOU / EARTH_RATE_BEIDOU**2) ** (1 / 3)
    fields = {"eccentricity": 0.0, "inclination": 0.0, "node_rate": 0.0, "root_axis": math.sqrt(axis), "perigee": 0.0,
              "mean_anomaly": 0.5, "week_second": 216000.0}  # fmt: skip
    card = yuma(tmp_path, week, prn=1, node=(EARTH_RATE_BEIDOU * 216000.0 + 1.3) % math.tau, **fields)
    # the Earth rates of BeiDou and of GPS, which the flight counts with, part by 1.5e-12 rad/s
    t = np.array([0.0, 7200.0])
    r_e = satellites(card, "2018-06-19T12:00:00Z").ecef(t[:, None])[0][:, 0]
    np.testing.assert_allclose(np.arctan2(r_e[:, 1], r_e[:, 0]), 1.8, atol=2e-8)
    np.testing.assert_allclose(np.linalg.norm(r_e, axis=1), axis, rtol=1e-12)


def test_gps_almanacs_have_no_time_offset_and_those_of_beidou_may():
    assert AlmanacConstellation(almanac="a", system="BeiDou", time_offset="3 m").time_offset == 3.0
    with pytest.raises(ValidationError, match="a constellation of GPS has none"):
        AlmanacConstellation(almanac="a", time_offset="3 m")
    with pytest.raises(ValidationError, match="system"):
        AlmanacConstellation(almanac="a", system="Galileo")


# --- nominal slots ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def beidou_30(root: Path):
    return NominalConstellation(**YAML(typ="safe").load(root / "configs/constellations/beidou_30.yaml"))


def test_nominal_slots_stand_where_they_are_published(beidou_30):
    day = np.arange(0.0, 86164.0, 300.0)[:, None]
    for epoch in ("2020-07-31T00:00:00Z", "2026-08-01T12:00:00Z"):  # and stay
        found = orbits(beidou_30, epoch)
        r_e, _ = found.ecef(day)
        latitude, longitude, _ = (np.degrees(a) for a in geodetic_from_ecef(r_e))
        at = {name: k for k, name in enumerate(found.names)}
        for name, place in (("C-G1", 80.0), ("C-G2", 110.5), ("C-G3", 140.0)):
            np.testing.assert_allclose(longitude[:, at[name]], place, atol=0.01)
            np.testing.assert_allclose(latitude[:, at[name]], 0.0, atol=1e-9)
        crossings = []
        for name in ("C-I1", "C-I2", "C-I3"):
            own_latitude = latitude[:, at[name]]
            (north,) = np.flatnonzero((own_latitude <= 0.0) & (np.roll(own_latitude, -1) > 0.0))
            assert longitude[north, at[name]] == pytest.approx(118.0, abs=0.7)
            assert np.max(own_latitude) == pytest.approx(55.0, abs=0.2)
            crossings.append(day[north, 0])
        np.testing.assert_allclose(np.diff(np.sort(crossings)), 86164.0 / 3.0, atol=301.0)
        assert found.systems == ("C",) * 30


def test_a_slot_with_an_orbit_of_its_own_has_rates_of_its_own(beidou_30):
    plain = beidou_30.model_copy(update={"node_rate": 1e-7, "latitude_rate": 2e-4})
    found = orbits(plain, "2020-07-31T00:00:00Z")
    assert set(found.node_rate[:24]) == {1e-7}
    assert set(found.mean_motion[:24]) == {2e-4}
    assert set(found.node_rate[24:]) == {0.0}
    np.testing.assert_allclose(found.mean_motion[24:], 7.2921151467e-5, rtol=1e-11)


def test_asia_sees_more_of_them_than_america(beidou_30):
    t = np.arange(0.0, 86400.0, 1800.0)[:, None]
    r_e = orbits(beidou_30, "2020-07-31T00:00:00Z").ecef(t)[0]

    def seen(longitude):
        up = np.array([math.cos(longitude), math.sin(longitude), 0.0])
        line = r_e - 6378137.0 * up
        return np.mean(np.sum(line @ up > np.sin(np.radians(10.0)) * np.linalg.norm(line, axis=-1), axis=-1))

    assert seen(math.radians(110.0)) > seen(math.radians(-80.0)) + 4.0
