import math
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest
from pydantic import Field, TypeAdapter
from ruamel.yaml import YAML

from lvnav_trade.gnss.constellation import (
    AlmanacConstellation,
    CombinedConstellation,
    Constellation,
    NominalConstellation,
    RinexConstellation,
    orbits,
)
from lvnav_trade.gnss.rinex import read_navigation
from lvnav_trade.gnss.satellites import (
    CombinedSatellites,
    broken_record_remarks,
    nearest_records,
    satellites,
    time_offsets,
)
from lvnav_trade.gnss.visibility import transmission
from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import (
    earth_angle,
    ecef_from_eci,
    ecef_from_geodetic,
    eci_from_ecef,
    gmst,
    rotation_e_n,
)
from tests.counting import calls
from tests.gnss.test_rinex import GALILEO_3, GLONASS_3, GPS_2, HEAD_3
from tests.trajectory.products import gps_time

EPOCH = "2026-08-01T12:00:00Z"
MIXED = "gnss/rinex3/VILL00ESP_R_20181700000_01D_MN.rnx.gz"
NOON = "2018-06-19T12:00:00Z"  # of the day of that file
GLONASS_HEAD = HEAD_3.replace(
    "                                                            END OF HEADER",
    "GLGP -1.2000000000E-08 0.000000000E+00      0    0          TIME SYSTEM CORR\n"
    "                                                            END OF HEADER",
)


@pytest.fixture(scope="module")
def card(root):
    """Return a constellation card by name, parts that are cards opened."""
    adapter = TypeAdapter(Annotated[Constellation, Field(discriminator="kind")])

    def read(name):
        data = dict(YAML(typ="safe").load(root / f"configs/constellations/{name}.yaml"))
        if "parts" in data:
            data["parts"] = [read(Path(part).name).model_dump(mode="json") for part in data["parts"]]
        return adapter.validate_python(data)

    return read


def own(tmp_path, text, **fields):
    path = tmp_path / "own.rnx"
    path.write_text(text)
    return RinexConstellation(rinex=str(path), **fields)


def test_nominal_satellites_stand_where_their_elements_say(card):
    gps_24, t = card("gps_24"), np.array([[0.0], [600.0]])
    above = satellites(gps_24, EPOCH)
    assert above.systems == ("G",) * 24
    assert above.names == tuple(slot.name for slot in gps_24.slots)
    for ours, elements in zip(above.ecef(t), orbits(gps_24, EPOCH).ecef(t), strict=True):
        np.testing.assert_array_equal(ours, elements)
    np.testing.assert_array_equal(above.clock(t), np.zeros((2, 24)))


def test_an_almanac_carries_its_clocks_to_the_lift_off(refdata):
    path = refdata / "gnss/almanac/gps_yuma_wk819_2015.alm"
    at_toa = satellites(AlmanacConstellation(almanac=str(path)), "2015-05-06T16:44:32Z")
    later = satellites(AlmanacConstellation(almanac=str(path)), "2015-05-07T16:44:32Z")
    bias, drift = (at_toa.clock(np.full(1, t)) for t in (0.0, 1.0))
    np.testing.assert_allclose(later.clock(np.zeros(1)), bias + 86400.0 * (drift - bias), rtol=0.0, atol=1e-12)
    assert np.max(np.abs(SPEED_OF_LIGHT * bias)) > 1e4
    # -2 r.v / c^2 with inertial velocity, to a millimetre
    r_e, v_e = at_toa.ecef(np.zeros(1))
    v_i = v_e + 7.2921151467e-5 * np.stack([-r_e[:, 1], r_e[:, 0], 0.0 * r_e[:, 0]], axis=-1)
    term = SPEED_OF_LIGHT * at_toa.relativity(np.zeros(1))
    np.testing.assert_allclose(term, -2.0 * np.sum(r_e * v_i, axis=-1) / SPEED_OF_LIGHT, rtol=0.0, atol=1e-3)


def test_a_sem_almanac_is_known_by_its_content(refdata):
    path = refdata / "gnss/almanac/gps_sem_wk387_2007.al3"
    above = satellites(AlmanacConstellation(almanac=str(path)), "2007-01-28T00:00:00Z")  # of week 1411
    assert len(above.names) == 29  # PRN 4 was unhealthy
    radius = np.linalg.norm(above.ecef(np.zeros(1))[0], axis=-1)
    np.testing.assert_allclose(radius, 26.56e6, rtol=0.025)


def test_an_almanac_far_from_the_lift_off_is_refused_and_a_longer_age_allows_it(refdata):
    path = str(refdata / "gnss/almanac/gps_yuma_wk819_2015.alm")
    with pytest.raises(InputError) as refused:
        satellites(AlmanacConstellation(almanac=path), "2016-05-06T16:44:32Z")
    assert str(refused.value) == (
        f"{path}: the lift-off 2016-05-06T16:44:32Z is 366.0 days after the time of applicability; "
        "longest_age allows 180 days"
    )
    longer = AlmanacConstellation(almanac=path, longest_age="400 days")
    assert len(satellites(longer, "2016-05-06T16:44:32Z").names) > 28


def test_a_navigation_file_named_as_almanac_is_distinguished(tmp_path):
    path = Path(own(tmp_path, HEAD_3 + GALILEO_3).rinex)
    with pytest.raises(InputError, match=r"own\.rnx:1: a RINEX file; name it by \{rinex: \.\.\.\}, not \{almanac"):
        satellites(AlmanacConstellation(almanac=str(path)), NOON)


def test_three_systems_of_a_recorded_file_are_up_around_its_noon(refdata):
    above = satellites(RinexConstellation(rinex=str(refdata / MIXED)), NOON)
    count = {letter: above.systems.count(letter) for letter in "GER"}
    assert count == {"G": 15, "E": 9, "R": 6}  # what one station heard within the age limits
    assert sorted(above.names) == sorted(set(above.names))
    r_e, v_e = above.ecef(np.array([[0.0], [600.0]]))
    radius = np.linalg.norm(r_e, axis=-1)
    for letter, size in (("G", 26.56e6), ("E", 29.6e6), ("R", 25.508e6)):
        which = np.array(above.systems) == letter
        np.testing.assert_allclose(radius[:, which], size, rtol=0.03)
    assert np.all(np.linalg.norm(v_e, axis=-1) < 4000.0)


def test_recorded_clocks_of_all_systems_are_some_hundred_kilometres_and_steady(refdata):
    above = satellites(RinexConstellation(rinex=str(refdata / MIXED)), NOON)
    clock = SPEED_OF_LIGHT * above.clock(np.array([[0.0], [600.0]]))
    assert clock.shape == above.relativity(np.array([[0.0], [600.0]])).shape == (2, len(above.names))
    assert 1e5 < np.max(np.abs(clock)) < 3e6
    assert np.max(np.abs(clock[1] - clock[0])) < 100.0


def test_systems_are_chosen_by_the_card_and_lists_of_files_are_one_set(refdata):
    path = str(refdata / MIXED)
    chosen = satellites(RinexConstellation(rinex=path, systems=["Galileo"]), NOON)
    assert set(chosen.systems) == {"E"}
    twice = satellites(RinexConstellation(rinex=[path, path], systems=["Galileo"]), NOON)
    assert twice.names == chosen.names


def test_of_galileos_two_messages_that_on_e1_is_taken(refdata):
    records = read_navigation(refdata / MIXED).ephemerides
    near = nearest_records((item for item in records if item.name[0] == "E"), gps_time(2018, 6, 19, 12, 0, 0))
    assert {item.elements["data_source"] for item in near.values()} == {517.0}


def test_the_real_glonass_satellites_of_2018_stand_near_the_nominal_slots(refdata, card, record_property):
    # Twelve hours of age: each of the 24 was heard once around the day.
    real = satellites(RinexConstellation(rinex=str(refdata / MIXED), systems=["GLONASS"], longest_age="12 h"), NOON)
    nominal = satellites(card("glonass_24"), NOON)
    names = [name for name in nominal.names if name in real.names]
    assert len(names) == 24
    (r, v), (q, w) = (
        (array[[above.names.index(name) for name in names]] for array in above.ecef(np.zeros(1)))
        for above in (real, nominal)
    )
    turning = 7.2921151467e-5 * np.array([0.0, 0.0, 1.0])
    normals = [np.cross(x, y + np.cross(turning, x)) for x, y in ((r, v), (q, w))]
    real_normal, normal = (n / np.linalg.norm(n, axis=1, keepdims=True) for n in normals)
    tilt = np.degrees(np.arccos(np.sum(real_normal * normal, axis=1)))
    ahead = np.degrees(np.arctan2(np.sum(np.cross(q, r) * normal, axis=1), np.sum(q * r, axis=1)))
    record_property("GLONASS of 2018 off the slots: largest tilt, mean and largest along-track in deg",
                    [round(float(x), 2) for x in (tilt.max(), ahead.mean(), np.abs(ahead).max())])  # fmt: skip
    assert tilt.max() < 2.0
    assert np.abs(ahead).max() < 9.0
    assert abs(ahead.mean()) < 1.0


def test_the_galileo_slots_meet_the_published_spot_value(card):
    # Plane A, slot 1, on 2016-11-21: node 317.632 deg, 180.153 deg from it. Time counts here by GPS, two leap seconds
    # more, and the published node leaves out the precession of the equinox from which the hour angle counts, 0.08 deg.
    galileo, epoch = orbits(card("galileo_24"), "2016-11-21T00:00:00Z"), "2016-11-21T00:00:00Z"

    assert math.degrees(galileo.node[0] + gmst(epoch)) % 360.0 == pytest.approx(317.632, abs=0.09)
    assert math.degrees(galileo.mean_anomaly[0]) == pytest.approx(180.153, abs=0.016)


def test_a_lift_off_outside_the_files_time_is_refused_and_says_so(refdata, tmp_path):
    path = refdata / MIXED
    with pytest.raises(InputError) as refused:
        satellites(RinexConstellation(rinex=str(path), systems=["GPS"]), "2018-06-21T12:00:00Z")
    assert str(refused.value).startswith(f"{path}: the lift-off 2018-06-21T12:00:00Z is 3")
    assert str(refused.value).endswith(" h after the nearest ephemeris of GPS; longest_age allows 2 h")
    early = own(tmp_path, HEAD_3 + GALILEO_3)
    with pytest.raises(InputError, match=r"is 10\.0 days after the nearest ephemeris of Galileo"):
        satellites(early, "2018-06-28T15:40:00Z")
    with pytest.raises(InputError, match=r"is 5\.7 h before the nearest ephemeris of Galileo; longest_age allows 4 h$"):
        satellites(early, "2018-06-18T10:00:00Z")
    assert satellites(early.model_copy(update={"longest_age": 6 * 3600.0}), "2018-06-18T10:00:00Z").names == ("E01",)


def test_a_system_that_the_file_lacks_or_that_is_sick_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"own\.rnx: no healthy satellite of GPS$"):
        satellites(own(tmp_path, HEAD_3 + GALILEO_3, systems=["GPS"]), "2018-06-18T16:00:00Z")
    sick = GLONASS_3.replace("-0.000000000000E+00 0.000000000000E+00", "-0.000000000000E+00 1.000000000000E+00", 1)
    with pytest.raises(InputError, match=r"own\.rnx: no healthy satellite of GLONASS$"):
        satellites(own(tmp_path, HEAD_3 + sick), "2018-06-18T18:15:00Z")


def stated(text, line, column, value):
    """Return a record of version 3 with another number in one of its places."""
    lines = text.splitlines(keepends=True)
    start = 4 + 19 * column
    lines[line] = f"{lines[line][:start]}{value:19.12E}{lines[line][start + 19 :]}"
    return "".join(lines)


@pytest.mark.parametrize(
    ("health", "healthy"), [(0, True), (64, True), (8, True), (0x1B8, True), (1, False), (2, False), (4, False)]
)
def test_galileo_is_healthy_for_a_user_of_e1_by_the_flags_of_e1(tmp_path, health, healthy):
    card, lift_off = own(tmp_path, HEAD_3 + stated(GALILEO_3, 6, 1, health)), "2018-06-18T16:00:00Z"
    if healthy:
        assert satellites(card, lift_off).names == ("E01",)
        return
    with pytest.raises(InputError, match=r"own\.rnx: no healthy satellite of Galileo$"):
        satellites(card, lift_off)


@pytest.mark.parametrize(("accuracy", "taken"), [(3.12, True), (6.0, True), (-1.0, False), (255.0, False)])
def test_galileo_without_a_prediction_of_accuracy_is_not_taken(tmp_path, accuracy, taken):
    card = own(tmp_path, HEAD_3 + stated(GALILEO_3, 6, 0, accuracy))
    if taken:
        assert satellites(card, "2018-06-18T16:00:00Z").names == ("E01",)
        return
    with pytest.raises(InputError, match="no healthy satellite of Galileo"):
        satellites(card, "2018-06-18T16:00:00Z")


@pytest.mark.parametrize(("accuracy", "taken"), [("0.614400000000D+04", True), ("0.819200000000D+04", False)])
def test_gps_without_a_prediction_of_accuracy_is_not_taken(tmp_path, accuracy, taken):
    lines = GPS_2.splitlines(keepends=True)
    lines[10] = f"   {accuracy:>19}{lines[10][22:]}"
    card = own(tmp_path, "".join(lines))
    if taken:
        assert satellites(card, "2010-07-01T02:00:00Z").names == ("G02",)
        return
    with pytest.raises(InputError, match="no healthy satellite of GPS"):
        satellites(card, "2010-07-01T02:00:00Z")


def test_a_broken_record_costs_no_other_and_is_reported_where_its_system_is_taken(tmp_path):
    dead = stated(GALILEO_3.replace("E01", "E02"), 2, 3, 0.0)  # the root of its semi-major axis
    text = HEAD_3 + GALILEO_3 + dead + GLONASS_3
    lift_off = "2018-06-18T16:00:00Z"
    card = own(tmp_path, text, systems=["Galileo"])
    assert satellites(card, lift_off).names == ("E01",)
    (line,) = broken_record_remarks(card)
    assert line.removeprefix(f"{tmp_path / 'own.rnx'}: ").startswith(
        "1 broken record of E02 left out, the first at line 16: E02 root of the semi-major axis: "
    )
    assert broken_record_remarks(own(tmp_path, text, systems=["GLONASS"])) == []
    assert broken_record_remarks(own(tmp_path, text.replace(dead, stated(dead, 6, 1, 1.0)), systems=["Galileo"])) == []
    with pytest.raises(InputError, match=r"own\.rnx:8: E02 root of the semi-major axis: .* is outside 2600"):
        satellites(own(tmp_path, HEAD_3 + dead + GLONASS_3, systems=["Galileo"]), lift_off)


def test_a_state_of_glonass_that_no_satellite_can_have_is_broken(tmp_path):
    zero = GLONASS_3.replace("R01", "R02")
    for line in (1, 2, 3):
        zero = stated(zero, line, 0, 0.0)
    card = own(tmp_path, HEAD_3 + GLONASS_3 + zero)
    assert satellites(card, "2018-06-18T18:15:00Z").names == ("R01",)
    assert "R02 position: its size of 0 m is outside 1e+07 to 5e+07" in broken_record_remarks(card)[0]
    with pytest.raises(InputError, match="R02 position: its size of 0 m"):
        satellites(own(tmp_path, HEAD_3 + zero), "2018-06-18T18:15:00Z")


def test_two_parts_of_one_system_are_refused(card):
    gps_24 = card("gps_24")
    with pytest.raises(InputError, match="two parts of the combined constellation give GPS"):
        satellites(CombinedConstellation(parts=(gps_24, gps_24)), EPOCH)


def test_two_satellites_of_one_name_are_refused(card):
    gps_24, galileo = card("gps_24"), card("galileo_24").model_dump(mode="json")
    same = NominalConstellation(
        **galileo | {"slots": [slot | {"name": f"A{k}"} for k, slot in enumerate(galileo["slots"])]}
    )
    with pytest.raises(InputError, match="two parts of the combined constellation name a satellite A1"):
        satellites(CombinedConstellation(parts=(gps_24, same)), EPOCH)
    with pytest.raises(ValueError, match="two slots are named 'A1'"):
        NominalConstellation(**galileo | {"slots": [slot | {"name": "A1"} for slot in galileo["slots"]]})


def test_a_combined_constellation_is_its_parts_one_after_the_other(card):
    whole, t = (
        satellites(card("gps_galileo_glonass"), EPOCH),
        np.linspace(0.0, 600.0, 5)[:, None] - np.arange(72) * 1e-3,
    )
    assert isinstance(whole, CombinedSatellites)
    assert len(set(whole.names)) == 72
    assert whole.systems == ("G",) * 24 + ("E",) * 24 + ("R",) * 24
    alone = satellites(card("galileo_24"), EPOCH)
    np.testing.assert_array_equal(whole.ecef(t)[0][:, 24:48], alone.ecef(t[:, 24:48])[0])
    assert whole.ecef(np.zeros(1))[0].shape == (72, 3)
    assert whole.clock(np.zeros((3, 1))).shape == (3, 72)


def test_three_systems_show_a_site_more_satellites_and_a_better_dilution(card, record_property):
    site, found = np.radians([5.236, -52.775]), {}
    t = np.arange(0.0, 86400.0, 900.0)[:, None]
    for name in ("gps_24", "gps_galileo", "gps_galileo_glonass"):
        above = satellites(card(name), EPOCH)
        line = above.ecef(t)[0] - ecef_from_geodetic(*site, 0.0)
        unit = line / np.linalg.norm(line, axis=-1, keepdims=True) @ rotation_e_n(*site).T
        up = -unit[..., 2] > math.sin(math.radians(5.0))
        letters = np.array(above.systems)
        clocks = np.stack([letters == letter for letter in dict.fromkeys(above.systems)], axis=-1)  # one unknown each
        rows = (
            np.concatenate([unit, np.broadcast_to(clocks, (*unit.shape[:2], clocks.shape[-1]))], axis=-1)
            * up[..., None]
        )
        cofactor = np.linalg.inv(np.swapaxes(rows, -1, -2) @ rows)
        dilution = np.sqrt(np.trace(cofactor[..., :3, :3], axis1=-2, axis2=-1))
        found[name] = (float(up.sum(axis=1).mean()), float(dilution.mean()), float(dilution.max()))
    record_property("satellites, mean and worst PDOP at Kourou", {k: np.round(v, 2).tolist() for k, v in found.items()})
    one, two, three = found.values()
    assert two[0] > one[0] + 6.0
    assert three[0] > two[0] + 5.0
    assert three[1] < two[1] < one[1]
    assert three[2] < 2.0


def test_eighty_satellites_over_ten_minutes_take_hardly_more_calls_than_over_one(card, refdata):
    recorded = RinexConstellation(rinex=str(refdata / MIXED), systems=["GLONASS"], longest_age="12 h")
    parts = (card("gps_24"), card("galileo_24"), recorded)
    above = satellites(CombinedConstellation(parts=parts), NOON)
    t = np.arange(-60.0, 600.0)
    here = eci_from_ecef(ecef_from_geodetic(0.09, -0.92, 100e3), earth_angle(1.0, t))
    long, short = (calls(lambda n=n: transmission(above, 1.0, t[:n], here[:n])) for n in (660, 66))
    assert short < long < 1.05 * short  # steps of integration over GLONASS's half hours, not epochs
    sent = transmission(above, 1.0, t, here)
    distance = np.linalg.norm(sent.r_i - here[:, None], axis=-1)
    np.testing.assert_allclose(distance, SPEED_OF_LIGHT * sent.travel, rtol=0.0, atol=1e-6)
    there = ecef_from_eci(sent.r_i, earth_angle(1.0, t[:, None] - sent.travel))
    np.testing.assert_allclose(there, above.ecef(t[:, None] - sent.travel)[0], rtol=0.0, atol=1e-3)


def test_gps_has_no_offset_from_its_own_time_and_lists_are_not_empty(card):
    data = card("gps_24").model_dump(mode="json")
    with pytest.raises(ValueError, match="time_offset counts from GPS time, so a constellation of GPS has none"):
        NominalConstellation(**data | {"time_offset": "1 m"})
    for field in ({"rinex": []}, {"rinex": "a", "systems": []}):
        with pytest.raises(ValueError, match="is an empty list"):
            RinexConstellation(**field)


def test_an_ignored_offset_of_galileos_time_shortens_its_ranges(refdata, tmp_path):
    """2.2322637960e-08 s at 2018-06-20, falling by 1.0214e-14 s/s: 6.69 m twelve hours before."""
    ignored = RinexConstellation(rinex=str(refdata / MIXED), systems=["GPS", "Galileo"], time_correction="ignored")
    systems, t = satellites(ignored, NOON).systems, np.array([0.0, 600.0])
    found = time_offsets(ignored, systems, NOON, t)
    galileo = np.array(systems) == "E"
    assert np.all(found[:, ~galileo] == 0.0)
    seconds = 2.2322637960e-08 - 1.021405183e-14 * (t + 18.0 - 43200.0)  # noon of UTC is 18 s later in GPS time
    np.testing.assert_allclose(found[:, galileo, 0], -SPEED_OF_LIGHT * seconds[:, None] * np.ones(galileo.sum()))
    assert found[0, galileo, 0][0] == pytest.approx(-6.692 - 0.132, abs=1e-3)
    np.testing.assert_allclose(found[:, galileo, 1], SPEED_OF_LIGHT * 1.021405183e-14)
    applied = ignored.model_copy(update={"time_correction": "applied"})
    assert np.all(time_offsets(applied, systems, NOON, t) == 0.0)
    every = ignored.model_copy(update={"systems": ("GPS", "Galileo", "GLONASS")})
    with pytest.raises(InputError, match="no TIME SYSTEM CORR between GLONASS and GPS time to ignore"):
        time_offsets(every, ("G", "E", "R"), NOON, t)


def test_offsets_go_to_the_satellites_of_their_own_part(card, tmp_path):
    glonass = own(tmp_path, GLONASS_HEAD + GLONASS_3, time_correction="ignored")
    whole = CombinedConstellation(parts=(card("gps_24"), card("galileo_24"), glonass))
    epoch = "2018-06-18T18:15:00Z"
    systems = satellites(whole, epoch).systems
    found = time_offsets(whole, systems, epoch, np.zeros(1))[0, :, 0]
    expected = np.where(np.array(systems) == "R", 1.2e-8 * SPEED_OF_LIGHT, 0.0)
    np.testing.assert_allclose(found, expected)
