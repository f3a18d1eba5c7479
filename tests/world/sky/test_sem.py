import math

import pytest

from lvnav_trade.errors import InputError
from lvnav_trade.world.sky.sem import read_sem

RECORD = """\
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
    records = "".join(RECORD.format(prn=prn, health=health) for prn, health in satellites)
    path.write_text(HEAD.format(count=len(satellites) if count is None else count) + records)
    return path


def edited(tmp_path, line, text):
    path = own(tmp_path, (1, 0), (7, 63))
    lines = path.read_text().splitlines()
    lines[line - 1] = text
    path.write_text("\n".join(lines))
    return path


def refusal(path):
    with pytest.raises(InputError) as refused:
        read_sem(path)
    text = str(refused.value)
    assert "\n" not in text
    return text.removeprefix(f"{path}:")


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
        (4, "64", "4: PRN: 64 is outside 1 to 63"),
        (7, " 1.5 0.0 0.0", "7: eccentricity: 1.5 is outside 0 to 0.999"),
        (7, " 0.5 0.0", "7: 2 numbers where 3 should be (eccentricity, inclination offset, rate of right ascension)"),
        (8, " 5153x6 0.0 0.0", "8: root of the semi-major axis: '5153x6' is not a number"),
        (13, "1", "13: PRN 1 again (first on line 4)"),
    ],
)
def test_a_wrong_line_is_refused_by_its_number(tmp_path, line, text, what):
    assert refusal(edited(tmp_path, line, text)) == what


def test_a_file_cut_short_is_refused(tmp_path):
    path = own(tmp_path, (1, 0), (7, 0))
    path.write_text("\n".join(path.read_text().splitlines()[:16]))
    assert refusal(path) == "16: the last satellite has 4 lines, not 8"


@pytest.mark.parametrize("text", ["", "\n\n", "30 CURRENT.ALM\n"])
def test_a_file_without_head_is_refused(tmp_path, text):
    path = tmp_path / "own.al3"
    path.write_text(text)
    assert "no SEM almanac: number of records, week and second are missing" in refusal(path)
