import math

import numpy as np
import pytest
from pydantic import TypeAdapter
from ruamel.yaml import YAML

from lvnav_trade.gnss.constellation import AlmanacConstellation, NominalConstellation, orbits
from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import ecef_from_geodetic, gmst, rotation_e_n

RECORD = """\
ID: {prn}
Health: {health}
Eccentricity: {e}
Time of Applicability(s): 147456.0
Orbital Inclination(rad): 0.96
Rate of Right Ascen(r/s): -8e-9
SQRT(A) (m 1/2): 5153.6
Right Ascen at Week(rad): 1.25
Argument of Perigee(rad): 0.75
Mean Anom(rad): {anomaly}
Af0(s): 0
Af1(s/s): 0
week: 382
"""
TOA = "2026-08-03T16:57:18Z"  # second 147456 of week 2430 = 382 + 2 x 1024, GPS time 18 s ahead


@pytest.fixture(scope="module")
def gps_24(root):
    return NominalConstellation(**YAML(typ="safe").load(root / "configs/constellations/gps_24.yaml"))


def published(refdata):
    """Return the elements of the YUMA almanac of May 2015 at its time of applicability, second 319488 of week 1843."""
    path = refdata / "gnss/almanac/gps_yuma_wk819_2015.alm"
    return orbits(AlmanacConstellation(almanac=str(path)), "2015-05-06T16:44:32Z")


def satellite(prn, health, e, anomaly):
    return RECORD.format(prn=prn, health=health, e=e, anomaly=anomaly)


def own(tmp_path, *records):
    path = tmp_path / "own.alm"
    path.write_text("".join(records))
    return AlmanacConstellation(almanac=str(path))


def visible(orbit, t, latitude, longitude):
    """Return lines of sight (n_epoch, n_sat, 3) in north-east-down at a site, and which are above a mask of 5 deg."""
    line = orbit.ecef(t[:, None])[0] - ecef_from_geodetic(latitude, longitude, 0.0)
    unit = line / np.linalg.norm(line, axis=-1, keepdims=True) @ rotation_e_n(latitude, longitude).T
    return unit, -unit[..., 2] > math.sin(math.radians(5.0))


def position_dilution(unit, used):
    rows = np.concatenate([unit, np.ones_like(unit[..., :1])], axis=-1) * used[..., None]
    return np.sqrt(np.trace(np.linalg.inv(np.swapaxes(rows, -1, -2) @ rows)[..., :3, :3], axis1=-2, axis2=-1))


def test_a_published_almanac_gives_the_reference_positions_to_the_millimetre(refdata):
    orbit = published(refdata)
    r_e, _ = orbit.ecef(np.array([[0.0], [3600.0]]))
    expected = [(-20363301.275, -13603238.779, -10561311.777), (-13558072.125, -13315908.932, -18680338.872)]
    np.testing.assert_allclose(r_e[:, orbit.names.index("G01")], expected, rtol=0.0, atol=0.00051)


@pytest.mark.parametrize(
    ("site", "fewest", "mean", "most", "mean_dilution", "worst_dilution"),
    [
        ((5.236, -52.775), 9, 11.31, 14, 1.531, 2.022),  # Kourou
        ((-38.6, -62.0), 7, 9.66, 14, 1.665, 3.871),  # Bahia Blanca
        ((67.89, 21.10), None, 11.22, None, 1.700, 3.52),  # Esrange
    ],
)
def test_a_day_of_the_published_almanac_shows_as_many_satellites_as_published(
    refdata, site, fewest, mean, most, mean_dilution, worst_dilution
):
    # Five-degree mask, every 300 s from the time of applicability; to the digits printed.
    unit, up = visible(published(refdata), np.arange(0.0, 86400.0, 300.0), *np.radians(site))
    count, dilution = up.sum(axis=1), position_dilution(unit, up)
    assert np.mean(count) == pytest.approx(mean, abs=0.0051)
    assert fewest is None or (count.min(), count.max()) == (fewest, most)
    assert np.mean(dilution) == pytest.approx(mean_dilution, abs=0.00051)
    assert np.max(dilution) == pytest.approx(worst_dilution, abs=0.00051)


def test_the_velocity_is_the_derivative_of_the_position(gps_24, tmp_path):
    eccentric = own(tmp_path, satellite(3, 0, 0.02, -2.0), satellite(9, 0, 0.3, 0.1))
    for constellation in (gps_24, eccentric):
        orbit = orbits(constellation, TOA)
        t = np.linspace(-1000.0, 40000.0, 7)[:, None]
        _, v_e = orbit.ecef(t)
        step = 0.5
        difference = orbit.ecef(t + step)[0] - orbit.ecef(t - step)[0]
        np.testing.assert_allclose(v_e, difference / (2 * step), rtol=0.0, atol=1e-4)


def test_an_own_record_stands_where_kepler_says(tmp_path):
    orbit = orbits(own(tmp_path, satellite(3, 0, 0.02, 0.0)), TOA)
    r_e, _ = orbit.ecef(np.array([[0.0]]))
    # At perigee: a (1 - e) along the perigee direction; the node counts from Greenwich at the start of the week.
    node, perigee, inclination = 1.25 - 7.2921151467e-5 * 147456.0, 0.75, 0.96
    along = np.array([
        math.cos(node) * math.cos(perigee) - math.sin(node) * math.sin(perigee) * math.cos(inclination),
        math.sin(node) * math.cos(perigee) + math.cos(node) * math.sin(perigee) * math.cos(inclination),
        math.sin(perigee) * math.sin(inclination),
    ])  # fmt: skip
    np.testing.assert_allclose(r_e[0, 0], 5153.6**2 * 0.98 * along, rtol=0.0, atol=1e-4)


def test_the_reference_time_of_the_elements_does_not_move_the_satellites(tmp_path, gps_24):
    for constellation in (gps_24, own(tmp_path, satellite(3, 0, 0.02, 1.0))):
        early = orbits(constellation, "2026-08-03T10:00:00Z").ecef(np.array([[7200.0]]))[0]
        late = orbits(constellation, "2026-08-03T12:00:00Z").ecef(np.array([[0.0]]))[0]
        # What is left is the rounding of 1e9 s since the slots' epoch, 0.1 us at 4 km/s.
        np.testing.assert_allclose(early, late, rtol=0.0, atol=0.01)


def test_unhealthy_satellites_are_left_out(tmp_path):
    records = [satellite(3, 0, 0.01, 1.0), satellite(5, 63, 0.01, 2.0)]
    assert orbits(own(tmp_path, *records), TOA).names == ("G03",)


def test_an_almanac_without_a_healthy_satellite_is_refused(tmp_path):
    constellation = own(tmp_path, satellite(5, 1, 0.01, 2.0))
    with pytest.raises(InputError, match=r"own\.alm: no healthy satellite$"):
        orbits(constellation, TOA)


def test_the_path_of_an_almanac_is_marked_as_one():
    assert AlmanacConstellation.model_fields["almanac"].json_schema_extra == {"path": True}


def test_the_hour_angle_of_the_nominal_slots_is_the_sidereal_time_of_their_epoch(gps_24):
    # Within 2 s: the table's is apparent and of UT1 (nutation up to 1.2 s, UT1 - UTC up to 0.9 s), ours mean, of UTC.
    difference = (gps_24.greenwich - gmst(gps_24.epoch) + math.pi) % (2.0 * math.pi) - math.pi
    assert math.degrees(difference) == pytest.approx(0.0, abs=0.0085)


def test_the_nominal_slots_stand_at_their_epoch_where_the_table_says(gps_24):
    orbit = orbits(gps_24, gps_24.epoch)
    assert len(orbit.names) == len(set(orbit.names)) == 24
    r_e, v_e = (array[0] for array in orbit.ecef(np.array([[0.0]])))
    turn, s, c = OMEGA, math.sin(gps_24.greenwich), math.cos(gps_24.greenwich)
    C_e_i = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    r_i = r_e @ C_e_i.T
    v_i = (v_e + turn * np.stack([-r_e[:, 1], r_e[:, 0], 0.0 * r_e[:, 0]], axis=-1)) @ C_e_i.T
    h_i = np.cross(r_i, v_i)
    node = np.degrees(np.arctan2(h_i[:, 0], -h_i[:, 1]))
    latitude = np.degrees(np.arcsin(r_i[:, 2] / 26559.7e3 / math.sin(math.radians(55.0))))
    for slot, angle, height, r in zip(gps_24.slots, node, latitude, r_i, strict=True):
        assert (angle - math.degrees(slot.node) + 180.0) % 360.0 - 180.0 == pytest.approx(
            0.0, abs=5e-3
        )  # the plane turns, too
        assert math.sin(math.radians(height)) == pytest.approx(math.sin(slot.latitude_argument), abs=1e-9)
        assert np.linalg.norm(r) == pytest.approx(26559.7e3, abs=1e-3)


def test_the_ground_track_of_a_nominal_slot_repeats_after_two_revolutions(gps_24):
    orbit = orbits(gps_24, TOA)
    day = 2.0 * 2.0 * math.pi / orbit.mean_motion[0]
    first, again = (orbit.ecef(np.array([[t]]))[0][0] for t in (0.0, day))
    # 0.03 deg of longitude is left: the published axis is 0.7 km below that of an exact repeat under J2 alone.
    np.testing.assert_allclose(first, again, rtol=0.0, atol=26560e3 * math.radians(0.05))
    assert day == pytest.approx(86154.0, abs=5.0)  # GPS repeats some 246 s short of a solar day


def test_the_nominal_slots_give_a_dilution_of_six_or_less_nearly_everywhere(gps_24):
    # The performance standard for which the slots were designed: 98 % of the globe and of a day, five-degree mask.
    orbit = orbits(gps_24, TOA)
    t = np.arange(0.0, 86400.0, 1800.0)
    good, weight = [], []
    for latitude in np.radians(np.arange(-85.0, 86.0, 10.0)):
        for longitude in np.radians(np.arange(0.0, 360.0, 30.0)):
            unit, up = visible(orbit, t, latitude, longitude)
            assert up.sum(axis=1).min() >= 4
            good.append(np.mean(position_dilution(unit, up) <= 6.0))
            weight.append(math.cos(latitude))
    assert np.average(good, weights=weight) >= 0.98


def test_a_constellation_without_slots_or_a_slot_without_unit_is_refused(gps_24):
    adapter = TypeAdapter(NominalConstellation)
    card = gps_24.model_dump(mode="json")
    assert adapter.validate_python(card) == gps_24
    with pytest.raises(ValueError, match="at least 1 item"):
        adapter.validate_python(card | {"slots": []})
    with pytest.raises(ValueError, match="has no unit"):
        adapter.validate_python(card | {"slots": [{"name": "A1", "node": "272.847", "latitude_argument": "0 deg"}]})
