import gzip

import pytest

from lvnav_trade.gnss.navigation_lines import NumberBounds, number, read_lines
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.input_files import integer


@pytest.mark.parametrize(("text", "value"), [("1.5", 1.5), (" -0.25D-01", -0.025), ("3E2 ", 300.0), ("2d0", 2.0)])
def test_numbers_are_read_with_fortran_exponents(text, value):
    assert number("here", text, NumberBounds(-1.0, 1e3)) == value


@pytest.mark.parametrize(
    ("text", "bounds", "what"),
    [
        ("x", NumberBounds(0.0, 1.0), "'x' is not a number"),
        ("1.5", NumberBounds(0, 9, integer), "'1.5' is not a whole number"),
        ("1_0", NumberBounds(0, 99, integer), "'1_0' is not a whole number"),
        ("1_0.5", NumberBounds(0.0, 99.0), "'1_0.5' is not a number"),
        ("\u0661", NumberBounds(0.0, 9.0), "'\u0661' is not a number"),
        ("2", NumberBounds(0.0, 1.0), "2 is outside 0 to 1"),
        ("nan", NumberBounds(0.0, 1.0), "nan is outside 0 to 1"),
        ("inf", NumberBounds(0.0, 1.0), "inf is outside 0 to 1"),
    ],
)
def test_what_is_no_number_or_out_of_bounds_is_refused_where_it_stands(text, bounds, what):
    with pytest.raises(InputError) as refused:
        number("file:3: field", text, bounds)
    assert str(refused.value) == f"file:3: field: {what}"


def test_a_packed_file_is_read_as_the_plain_one(tmp_path):
    plain, packed = tmp_path / "a.txt", tmp_path / "b.txt"  # known by content, whatever its name
    plain.write_text("one\ntwo\n")
    packed.write_bytes(gzip.compress(b"one\ntwo\n"))
    assert read_lines(plain, "list") == read_lines(packed, "list") == ["one", "two"]


def test_a_truncated_packed_file_an_absent_one_and_a_picture_are_refused(tmp_path):
    packed, absent, picture, old = (tmp_path / name for name in ("b.gz", "absent", "c.png", "d.Z"))
    old.write_bytes(b"\x1f\x9d\x90abc")
    packed.write_bytes(gzip.compress(b"one\n" * 1000)[:-12])
    picture.write_bytes(b"\x89PNG\r\n\x1a\n\xff\x00")
    for path, what in [
        (packed, f"{packed}: a broken or truncated gzip file"),
        (absent, f"{absent}: cannot be read: No such file or directory"),
        (old, f"{old}: packed by 'compress' (.Z); unpack it, or pack it by gzip"),
        (picture, f"{picture}:1: not a text file, so not a list"),
    ]:
        with pytest.raises(InputError) as refused:
            read_lines(path, "list")
        assert str(refused.value) == what


def test_a_name_beyond_ascii_in_a_remark_is_no_mistake(tmp_path):
    path = tmp_path / "a.txt"
    path.write_bytes("Málaga\n1.5\n".encode("latin-1"))
    assert read_lines(path, "list")[1] == "1.5"


def test_a_file_that_unpacks_to_too_much_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("lvnav_trade.gnss.navigation_lines.DATA_BYTES", 1_000)
    packed = tmp_path / "big.gz"
    packed.write_bytes(gzip.compress(b"1" * 100_000))
    with pytest.raises(InputError, match="unpacked more than 1000 bytes"):
        read_lines(packed, "almanac")
