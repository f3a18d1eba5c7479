"""Almanacs: every field read, every mistake named."""

from __future__ import annotations

import math

import pytest

from lvnav_trade.gnss.almanac import read_sem, read_yuma
from lvnav_trade.quantities.errors import InputError

RECORD = """\
******** Week 400 almanac for PRN-{prn:02d} ********
ID:                         {prn:02d}
Health:                     {health:03d}
Eccentricity:               0.5000000000E-002
Time of Applicability(s):  147456.0000
Orbital Inclination(rad):   0.9599310886
Rate of Right Ascen(r/s):  -0.8000000000E-008
SQRT(A)  (m 1/2):           5153.600000
Right Ascen at Week(rad):   0.{prn}500000000E+000
Argument of Perigee(rad):   1.250000000
Mean Anom(rad):            -0.2500000000E+001
Af0(s):                    -0.1000000000E-004
Af1(s/s):                   0.0000000000E+000
week:                        400

"""


def almanac(tmp_path, text):
    path = tmp_path / "own.alm"
    path.write_text(text)
    return path


def refusal(path, read=read_yuma):
    with pytest.raises(InputError) as refused:
        read(path)
    text = str(refused.value)
    assert "\n" not in text
    return text


def test_every_field_of_a_record_is_read_in_its_unit(tmp_path):
    record, second = read_yuma(almanac(tmp_path, RECORD.format(prn=4, health=0) + RECORD.format(prn=7, health=63)))
    assert record.prn == 4
    assert (record.health, second.health) == (0, 63)
    assert record.eccentricity == 0.005
    assert record.applicability == 147456.0
    assert record.inclination == 0.9599310886
    assert record.node_rate == -8e-9
    assert record.root_axis == 5153.6
    assert (record.node, second.node) == (0.45, 0.75)
    assert record.perigee == 1.25
    assert record.mean_anomaly == -2.5
    assert (record.clock_bias, record.clock_drift) == (-1e-5, 0.0)
    assert record.week == 400


def test_records_without_lines_of_stars_with_other_line_ends_and_exponents_are_read(tmp_path):
    lines = (RECORD.format(prn=4, health=0) + RECORD.format(prn=7, health=0)).splitlines()
    text = "\r\n".join(line.replace("E-", "D-") for line in lines if line and not line.startswith("*"))
    assert [record.prn for record in read_yuma(almanac(tmp_path, text))] == [4, 7]


def test_a_published_almanac_is_read_whole(refdata):
    records = read_yuma(refdata / "gnss/almanac/gps_yuma_wk819_2015.alm")
    assert len(records) == 31
    assert {record.week for record in records} == {819}


@pytest.mark.parametrize("text", ["", "\n\n", "******** Week 400 almanac for PRN-01 ********\n"])
def test_a_file_without_records_is_refused(tmp_path, text):
    path = almanac(tmp_path, text)
    assert refusal(path) == f"{path}:1: no almanac record (a YUMA record begins with 'ID:')"


def test_a_missing_file_is_refused_by_name(tmp_path):
    path = tmp_path / "absent.alm"
    assert refusal(path) == f"{path}: cannot be read: No such file or directory"


def test_a_file_that_is_not_text_is_refused(tmp_path):
    path = tmp_path / "own.alm"
    path.write_bytes(b"\x89PNG\r\n\x1a\n\xff\x00")
    assert refusal(path) == f"{path}:1: not a text file, so not a YUMA almanac"


def test_a_truncated_record_names_its_last_line_and_what_is_missing(tmp_path):
    lines = (RECORD.format(prn=4, health=0) + RECORD.format(prn=7, health=0)).splitlines()
    path = almanac(tmp_path, "\n".join(lines[:-3]))
    assert refusal(path) == f"{path}:27: the record ends without 'af1', 'week'"


def test_a_record_that_the_next_one_cuts_short_names_its_last_line(tmp_path):
    lines = (RECORD.format(prn=4, health=0) + RECORD.format(prn=7, health=0)).splitlines()
    path = almanac(tmp_path, "\n".join(lines[:6] + lines[15:]))
    assert refusal(path).startswith(f"{path}:6: the record ends without 'rate of right ascen', ")


@pytest.mark.parametrize(
    ("line", "value", "what"),
    [
        (4, "0.5x0E-002", "eccentricity: '0.5x0E-002' is not a number"),
        (4, "", "eccentricity: '' is not a number"),
        (4, "nan", "eccentricity: nan is outside 0 to 0.999"),
        (4, "1.2", "eccentricity: 1.2 is outside 0 to 0.999"),
        (2, "4.5", "id: '4.5' is not a whole number"),
        (2, "256", "id: 256 is outside 1 to 255"),
        (8, "51.536", "sqrt(a) (m 1/2): 51.536 is outside 2600 to 100000"),
    ],
)
def test_a_wrong_number_is_refused_with_its_line(tmp_path, line, value, what):
    lines = RECORD.format(prn=4, health=0).splitlines()
    lines[line - 1] = lines[line - 1].partition(":")[0] + ": " + value
    path = almanac(tmp_path, "\n".join(lines))
    assert refusal(path) == f"{path}:{line}: {what}"


def test_a_satellite_that_comes_twice_is_refused_with_both_lines(tmp_path):
    path = almanac(tmp_path, RECORD.format(prn=4, health=0) * 2)
    assert refusal(path) == f"{path}:17: PRN 4 again (first on line 2)"


@pytest.mark.parametrize(
    "label", ["Right Ascen at Week(rad)", "Right Ascen at TOA(rad)", "Right Ascension at Week(rad)"]
)
def test_the_node_is_read_under_the_labels_that_writers_give_it(tmp_path, label):
    text = RECORD.format(prn=4, health=0)
    (plain,) = read_yuma(almanac(tmp_path, text))
    old = next(line.partition(":")[0] for line in text.splitlines() if line.startswith("Right Ascen"))
    assert read_yuma(almanac(tmp_path, text.replace(old, label))) == (plain,)


def test_satellites_of_other_systems_are_passed_over(tmp_path):
    text = RECORD.format(prn=4, health=0)
    assert [one.prn for one in read_yuma(almanac(tmp_path, text + RECORD.format(prn=193, health=0)))] == [4]
    path = almanac(tmp_path, RECORD.format(prn=193, health=0))
    assert refusal(path) == f"{path}: PRN 193 and no other up to 63, so no satellite to take"


def test_an_unhealthy_satellite_whose_record_is_broken_is_left_out_and_a_healthy_one_refused(tmp_path):
    lines = RECORD.format(prn=7, health=63).splitlines()
    at = next(k for k, line in enumerate(lines) if line.startswith("SQRT(A)"))
    lines[at] = "SQRT(A)  (m 1/2): 0.000000"
    broken, good = "\n".join(lines) + "\n", RECORD.format(prn=4, health=0)
    assert [one.prn for one in read_yuma(almanac(tmp_path, good + broken))] == [4]
    assert "sqrt(a) (m 1/2): 0.000000 is outside 2600" in refusal(
        almanac(tmp_path, good + broken.replace("063", "000"))
    )


def test_a_field_that_comes_twice_or_is_unknown_is_refused(tmp_path):
    lines = RECORD.format(prn=4, health=0).splitlines()
    path = almanac(tmp_path, "\n".join([*lines[:4], lines[3], *lines[4:]]))
    assert refusal(path) == f"{path}:5: 'eccentricity' comes twice in one record"
    path = almanac(tmp_path, "\n".join([*lines[:4], "Colour: blue", *lines[4:]]))
    assert refusal(path) == f"{path}:5: 'colour' is not a field of a YUMA almanac"
    path = almanac(tmp_path, "\n".join([*lines[:4], "blue", *lines[4:]]))
    assert refusal(path) == f"{path}:5: 'blue' is not a line 'label: value' of a YUMA almanac"


SEM_RECORD = """\
{prn}
32
0
 0.67005157470703E-0002  0.14945983886719E-0001 -0.24774635676295E-0008
 0.51536845703125E+0004 -0.57885289192200E+0000 -0.55991351604462E+0000
-0.51991939544678E+0000  0.10395050048828E-0003  0.36379788070917E-0011
{health}
9

"""
HEAD = "{count}  CURRENT.ALM\n 387 589824\n\n"


def own(tmp_path, *satellites, count=None):
    path = tmp_path / "own.al3"
    records = "".join(SEM_RECORD.format(prn=prn, health=health) for prn, health in satellites)
    path.write_text(HEAD.format(count=len(satellites) if count is None else count) + records)
    return path


def edited(tmp_path, line, text):
    path = own(tmp_path, (1, 0), (7, 63))
    lines = path.read_text().splitlines()
    lines[line - 1] = text
    path.write_text("\n".join(lines))
    return path


def sem_refusal(path):
    return refusal(path, read_sem).removeprefix(f"{path}:")


def test_every_field_is_read_in_semicircles_and_inclinations_count_from_54_degrees(tmp_path):
    record, second = read_sem(own(tmp_path, (1, 0), (7, 63)))
    assert (record.prn, record.health, second.prn, second.health) == (1, 0, 7, 63)
    assert record.eccentricity == 0.0067005157470703
    assert math.degrees(record.inclination) == pytest.approx(54.0 + 180.0 * 0.014945983886719, abs=1e-12)
    assert math.degrees(record.node_rate) == pytest.approx(-180.0 * 0.24774635676295e-8, rel=1e-12)
    assert record.root_axis == 5153.6845703125
    assert math.degrees(record.node) == pytest.approx(-180.0 * 0.578852891922, abs=1e-12)
    assert math.degrees(record.perigee) == pytest.approx(-180.0 * 0.55991351604462, abs=1e-12)
    assert math.degrees(record.mean_anomaly) == pytest.approx(-180.0 * 0.51991939544678, abs=1e-12)
    assert (record.clock_bias, record.clock_drift) == (1.0395050048828e-4, 3.6379788070917e-12)
    assert (record.week, record.applicability) == (387, 589824.0)


def test_a_published_almanac_is_read_whole_and_every_satellite_is_a_gps_orbit(refdata):
    records = read_sem(refdata / "gnss/almanac/gps_sem_wk387_2007.al3")
    assert len(records) == len({record.prn for record in records}) == 30
    for record in records:
        assert 26.55e6 < record.root_axis**2 < 26.58e6
        assert 51.0 < math.degrees(record.inclination) < 57.0  # PRN 11 of that year at 51.25 deg
        assert 0.0 < record.eccentricity < 0.025


def test_a_blank_serial_number_is_no_mistake(tmp_path):
    path = edited(tmp_path, 5, "")
    assert [record.prn for record in read_sem(path)] == [1, 7]


@pytest.mark.parametrize(
    ("line", "text", "what"),
    [
        (1, "many  CURRENT.ALM", "1: number of records: 'many' is not a whole number"),
        (1, "3  CURRENT.ALM", "20: ends after 2 satellites, but line 1 says 3"),
        (2, " 387", "2: second is missing"),
        (2, " 387 700000", "2: second: 700000 is outside 0 to 604800"),
        (4, "256", "4: PRN: 256 is outside 1 to 255"),
        (7, " 1.5 0.0 0.0", "7: eccentricity: 1.5 is outside 0 to 0.999"),
        (7, " 0.5 0.0", "7: 2 numbers where 3 should be (eccentricity, inclination offset, rate of right ascension)"),
        (8, " 5153x6 0.0 0.0", "8: root of the semi-major axis: '5153x6' is not a number"),
        (13, "1", "13: PRN 1 again (first on line 4)"),
    ],
)
def test_a_wrong_line_is_refused_by_its_number(tmp_path, line, text, what):
    assert sem_refusal(edited(tmp_path, line, text)) == what


def test_a_file_cut_short_is_refused(tmp_path):
    path = own(tmp_path, (1, 0), (7, 0))
    path.write_text("\n".join(path.read_text().splitlines()[:16]))
    assert sem_refusal(path) == "16: the last satellite has 4 lines, not 8"


@pytest.mark.parametrize("text", ["", "\n\n", "30 CURRENT.ALM\n"])
def test_a_file_without_head_is_refused(tmp_path, text):
    path = tmp_path / "own.al3"
    path.write_text(text)
    assert "no SEM almanac: number of records, week and second are missing" in sem_refusal(path)
