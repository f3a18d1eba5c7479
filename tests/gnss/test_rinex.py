import gzip

import pytest

from lvnav_trade.gnss.rinex import _offsets, read_navigation
from lvnav_trade.quantities.errors import InputError
from tests.trajectory.products import gps_time

GPS_2 = """\
     2              NAVIGATION DATA                         RINEX VERSION / TYPE
    0.1118D-07  0.1490D-07 -0.5960D-07 -0.5960D-07          ION ALPHA
    0.8806D+05  0.1638D+05 -0.1966D+06 -0.1311D+06          ION BETA
                                                            END OF HEADER
 2 10  7  1  1 59 44.0 0.269107520580D-03 0.250111042988D-11 0.000000000000D+00
    0.700000000000D+01 0.116875000000D+02 0.519200208378D-08-0.231457342120D+01
    0.515580177307D-06 0.942399200517D-02 0.743009150028D-05 0.515360024033D+04
    0.352784000000D+06 0.173225998878D-06-0.155617706640D+01-0.223517417908D-07
    0.941150154158D+00 0.235125000000D+03-0.317107890920D+01-0.826248702224D-08
   -0.237152735568D-09 0.100000000000D+01 0.159000000000D+04 0.000000000000D+00
    0.240000000000D+01 0.000000000000D+00-0.172294676304D-07 0.700000000000D+01
    0.345600000000D+06 0.400000000000D+01
"""
GLONASS_2 = """\
     2.01           GLONASS NAV DATA                        RINEX VERSION / TYPE
                                                            END OF HEADER
 7 15  7  1  0 15  0.0 0.141607597470D-04 0.909494701773D-12 0.000000000000D+00
    0.157750390625D+04-0.309580326080D+01 0.000000000000D+00 0.000000000000D+00
    0.110107705078D+05 0.528105735779D+00-0.931322574615D-09 0.100000000000D+01
    0.229637500000D+05-0.390377044678D-01-0.279396772385D-08 0.000000000000D+00
"""
HEAD_3 = """\
     3.03           N: GNSS NAV DATA    M: MIXED            RINEX VERSION / TYPE
GPSA   5.5879E-09  1.4901E-08 -5.9605E-08 -1.1921E-07       IONOSPHERIC CORR
GPSB   8.3968E+04  9.8304E+04 -6.5536E+04 -5.2429E+05       IONOSPHERIC CORR
GAL    3.4000E+01  1.1719E-01  1.2848E-02  0.0000E+00       IONOSPHERIC CORR
                                                            END OF HEADER
"""
GALILEO_3 = """\
E01 2018 06 18 15 40 00-3.712491597980E-04-8.824940778140E-12 0.000000000000E+00
     2.190000000000E+02 1.109375000000E+01 2.664039539369E-09-8.880733438194E-01
     5.289912223816E-07 2.356963232160E-04 1.020915806293E-05 5.440610132217E+03
     1.428000000000E+05-2.980232238770E-08 6.416418689936E-01-5.960464477539E-08
     9.928924584820E-01 1.340937500000E+02 2.673344846926E+00-5.317721504445E-09
    -3.975165581602E-10 5.170000000000E+02 2.006000000000E+03
     3.440000000000E+00 0.000000000000E+00-4.889443516731E-09-5.587935447693E-09
     1.428060000000E+05
"""
GLONASS_3 = """\
R01 2018 06 18 18 15 00 2.783164381981E-05 0.000000000000E+00 1.512000000000E+05
     1.577503906250E+03-3.095803260803E+00-0.000000000000E+00 0.000000000000E+00
     1.101077050781E+04 5.281057357788E-01-9.313225746155E-10 1.000000000000E+00
     2.296375000000E+04-3.903770446777E-02-2.793967723846E-09 0.000000000000E+00
"""
SBAS_3 = """\
S23 2018 06 18 23 58 56 0.000000000000E+00 0.000000000000E+00 1.728220000000E+05
     3.594460000000E+04 0.000000000000E+00 0.000000000000E+00 6.300000000000E+01
     2.204414000000E+04 0.000000000000E+00 0.000000000000E+00 3.276700000000E+04
     0.000000000000E+00 0.000000000000E+00 0.000000000000E+00 1.200000000000E+01
"""


def own(tmp_path, text):
    path = tmp_path / "own.rnx"
    path.write_text(text)
    return path


def refusal(path):
    with pytest.raises(InputError) as refused:
        read_navigation(path)
    text = str(refused.value)
    assert "\n" not in text
    return text.removeprefix(f"{path}:").strip()


def test_every_field_of_a_gps_record_is_read(tmp_path):
    navigation = read_navigation(own(tmp_path, GPS_2))
    (record,) = navigation.ephemerides
    assert navigation.states == ()
    assert navigation.klobuchar == ((1.118e-8, 1.49e-8, -5.96e-8, -5.96e-8), (88060.0, 16380.0, -196600.0, -131100.0))
    assert (record.name, record.health) == ("G02", 0.0)
    assert record.toc == record.toe == gps_time(2010, 7, 1, 1, 59, 44)
    assert record.elements == {
        "clock_bias": 0.269107520580e-3, "clock_drift": 0.250111042988e-11, "clock_drift_rate": 0.0,
        "radius_sin": 11.6875, "mean_motion_difference": 0.519200208378e-8, "mean_anomaly": -2.31457342120,
        "latitude_cos": 0.515580177307e-6, "eccentricity": 0.942399200517e-2, "latitude_sin": 0.743009150028e-5,
        "root_axis": 5153.60024033, "week_second": 352784.0, "inclination_cos": 0.173225998878e-6,
        "node": -1.55617706640, "inclination_sin": -0.223517417908e-7, "inclination": 0.941150154158,
        "radius_cos": 235.125, "perigee": -3.17107890920, "node_rate": -0.826248702224e-8,
        "inclination_rate": -0.237152735568e-9, "data_source": 0.0, "group_delay": -0.172294676304e-7,
    }  # fmt: skip


def test_galileo_and_glonass_are_read_from_a_mixed_file_and_other_systems_passed_over(tmp_path):
    navigation = read_navigation(own(tmp_path, HEAD_3 + SBAS_3 + GALILEO_3 + GLONASS_3))
    (galileo,), (glonass,) = navigation.ephemerides, navigation.states
    of = galileo.elements
    assert (galileo.name, of["root_axis"], of["data_source"]) == ("E01", 5440.610132217, 517.0)
    assert (of["inclination_rate"], of["group_delay"]) == (-3.975165581602e-10, -4.889443516731e-9)
    assert galileo.toc == galileo.toe == gps_time(2018, 6, 18, 15, 40, 0)
    assert glonass.name == "R01"
    assert glonass.time == gps_time(2018, 6, 18, 18, 15, 18)  # the file counts UTC, 18 s behind GPS time
    assert glonass.clock_bias == 2.783164381981e-5
    assert glonass.r_e == pytest.approx((1577503.906250, 11010770.50781, 22963750.0))
    assert glonass.v_e == pytest.approx((-3095.803260803, 528.1057357788, -39.03770446777))
    assert glonass.a_e == pytest.approx((0.0, -9.313225746155e-7, -2.793967723846e-6))
    assert navigation.klobuchar[0] == (5.5879e-9, 1.4901e-8, -5.9605e-8, -1.1921e-7)


def test_a_glonass_file_of_version_2_counts_utc(tmp_path):
    (state,) = read_navigation(own(tmp_path, GLONASS_2)).states
    assert (state.name, state.health) == ("R07", 0.0)
    assert state.time == gps_time(2015, 7, 1, 0, 15, 17)  # the 17th leap second had come that midnight
    assert state.clock_drift == 0.909494701773e-12
    assert state.a_e[2] == pytest.approx(-2.79396772385e-6)


def test_a_reference_time_in_the_next_week_follows_its_clock(tmp_path):
    text = GPS_2.replace("10  7  1  1 59 44.0", "10  7  3 23 59 44.0").replace(
        "0.352784000000D+06", "0.000000000000D+00"
    )
    (record,) = read_navigation(own(tmp_path, text)).ephemerides
    assert record.toe == gps_time(2010, 7, 4, 0, 0, 0)
    assert record.toe - record.toc == 16.0


def test_further_lines_and_blank_flags_of_other_versions_of_the_format_are_no_mistake(tmp_path):
    more = "     0.000000000000E+00 0.000000000000E+00 0.000000000000E+00 0.000000000000E+00\n"
    text = HEAD_3.replace("3.03", "3.05") + GLONASS_3 + more + GALILEO_3.replace("-4.889443516731E-09", " " * 19)
    navigation = read_navigation(own(tmp_path, text))
    assert [state.name for state in navigation.states] == ["R01"]
    assert navigation.ephemerides[0].elements["group_delay"] == 0.0


def test_a_second_of_sixty_is_the_next_minute(tmp_path):
    at = {
        GPS_2: (" 1  1 59 44.0", " 1  1 59 60.0", " 1  2  0  0.0"),
        GLONASS_2: (" 1  0 15  0.0", " 1  0 14 60.0", None),
    }
    for text, (old, sixty, full) in at.items():
        found, expected = (read_navigation(own(tmp_path, text.replace(old, new or old))) for new in (sixty, full))
        assert (found.ephemerides, found.states) == (expected.ephemerides, expected.states)
    leap = GLONASS_2.replace("15  7  1  0 15  0.0", "15  6 30 23 59 60.0")
    assert read_navigation(own(tmp_path, leap)).states[0].time == gps_time(2015, 7, 1, 0, 0, 16)  # in the leap second
    assert refusal(own(tmp_path, GPS_2.replace(" 1  1 59 44.0", " 1  1 59 61.0"))).endswith("59 61.0' is not a time")


def test_a_packed_file_is_read_as_the_plain_one(tmp_path):
    packed = tmp_path / "own.rnx.gz"
    packed.write_bytes(gzip.compress((HEAD_3 + GALILEO_3).encode()))
    assert read_navigation(packed) == read_navigation(own(tmp_path, HEAD_3 + GALILEO_3))


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("     2              NAV", "     4.00           NAV", "1: RINEX version 4.00; versions 2 and 3 can be read"),
        ("NAVIGATION DATA    ", "OBSERVATION DATA   ", "1: 'OBSERVATION DATA' is not a RINEX navigation file"),
        ("RINEX VERSION / TYPE", "PGM / RUN BY / DATE",
         "1: not a RINEX file (the first line should end with 'RINEX VERSION / TYPE')"),
        ("END OF HEADER", "END OF HEAD", "12: ends without 'END OF HEADER'"),
        ("0.1490D-07 ", "0.14x0D-07 ", "2: ION ALPHA: '  0.14x0D-07' is not a number"),
        (" 2 10  7  1  1 59", " 2 10 17  1  1 59", "5: '10 17  1  1 59 44.0' is not a time"),
        (" 2 10  7  1  1 59 44.0", " 2 10  7  1  1 59 4_4.", "5: '10  7  1  1 59 4_4.' is not a time"),
        (" 2 10  7  1  1 59 44.0", " 2 10  7  1  1 59  inf", "5: '10  7  1  1 59  inf' is not a time"),
        (" 2 10  7  1  1 59 44.0", " 2 10  7  1_1 59  4.0", "5: '10  7  1_1 59  4.0' is not a time"),
        (" 2 10  7", "XX 10  7", "5: 'XX' is not a satellite"),
        ("0.942399200517D-02", "0.942399200517D+02", "7: G02 eccentricity: 0.942399200517D+02 is outside 0 to 0.999"),
        ("0.515360024033D+04", "0.5153a0024033D+04",
         "7: G02 root of the semi-major axis: ' 0.5153a0024033D+04' is not a number"),
        ("-0.317107890920D+01", "                   ", f"9: G02 omega: {' ' * 19!r} is not a number"),
        ("    0.345600000000D+06 0.400000000000D+01\n", "", "11: the record of G02 has 7 lines, not 8"),
    ],
)  # fmt: skip
def test_a_broken_line_is_refused_by_its_number(tmp_path, old, new, what):
    assert old in GPS_2
    assert refusal(own(tmp_path, GPS_2.replace(old, new))) == what


def test_a_file_of_other_systems_only_or_without_records_is_refused(tmp_path):
    for text in (HEAD_3, HEAD_3 + SBAS_3):
        assert refusal(own(tmp_path, text)) == "no record of GPS, Galileo, BeiDou or GLONASS"
    assert refusal(own(tmp_path, HEAD_3 + GALILEO_3[81:])).startswith("6: a record should begin here")
    assert refusal(own(tmp_path, HEAD_3 + GALILEO_3.replace("E01", "E?1"))) == "6: 'E?1' is not a satellite such as G05"


def test_recorded_files_are_read_whole(refdata):
    assert len(read_navigation(refdata / "gnss/rinex2/brdc1820.10n").ephemerides) == 421
    mixed = read_navigation(refdata / "gnss/rinex3/VILL00ESP_R_20181700000_01D_MN.rnx.gz")
    count = {letter: sum(item.name[0] == letter for item in mixed.ephemerides) for letter in "GE"}
    assert (count, len(mixed.states)) == ({"G": 263, "E": 961}, 476)


def test_offsets_from_gps_time_are_read_from_the_header():
    lines = [
        "GPUT -9.3132257462E-10-3.552713679E-15 405504 2006          TIME SYSTEM CORR",
        "GAUT  3.3527612686E-08-1.243449788E-14 172800 2006          TIME SYSTEM CORR",
        "GPGA  2.2322637960E-08-1.021405183E-14 259200 2006          TIME SYSTEM CORR",
        "GLGP -1.2000000000E-08 0.000000000E+00      0    0          TIME SYSTEM CORR",
    ]
    found = {offset.system: offset for offset in _offsets("a.rnx", lines)}
    assert set(found) == {"E", "R"}
    assert found["E"][1:] == (2.2322637960e-08, -1.021405183e-14, 2006 * 604800.0 + 259200.0)
    assert found["R"][1:] == (-1.2e-08, 0.0, 0.0)
    renamed = [lines[2].replace("GPGA", "GAGP")]
    assert next(iter(_offsets("a.rnx", renamed))) == found["E"]


def test_a_broken_offset_has_its_place():
    with pytest.raises(InputError, match=r"a\.rnx:1: GAGP"):
        list(_offsets("a.rnx", ["GAGP  2.23x2637960E-08-1.021405183E-14 259200 2006          TIME SYSTEM CORR"]))


def test_the_recorded_file_states_galileos_offset(refdata):
    (offset,) = read_navigation(refdata / "gnss/rinex3/VILL00ESP_R_20181700000_01D_MN.rnx.gz").offsets
    assert offset == ("E", 2.2322637960e-08, -1.021405183e-14, gps_time(2018, 6, 20))


def test_superscript_digits_are_no_number_of_a_satellite(tmp_path):
    file = tmp_path / "a.rnx"
    file.write_bytes(GPS_2.replace("\n 2 10  7", "\n\u00b2\u00b2 10  7").encode("latin-1"))
    assert refusal(file).endswith("'\u00b2\u00b2' is not a satellite")
