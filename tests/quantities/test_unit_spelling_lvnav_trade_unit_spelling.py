"""Products, quotients, powers and roots of units, as datasheets spell them."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lvnav_trade.quantities.unit_spelling import UnknownUnitError, conversion, product
from lvnav_trade.quantities.units import parse
from tests.quantities.test_unit_spelling import KNOWN, OFFSET

DEG, HOUR, MICRO_G = math.pi / 180.0, 3600.0, 9.80665e-6
SPELLINGS = {
    ("rad/s**0.5", DEG / 60.0): (
        "deg/sqrt(h) deg/sqrt(hr) deg/\u221ah deg/\u221ahr deg/\u221a(h) deg/rt-h deg/rt-hr deg/rt(h) deg/rth deg/rthr "
        "deg/root-h deg/SQRT(h) \u00b0/\u221ah \u00b0/\u221ahr \u00ba/\u221ahr deg/h^0.5 deg/h^(1/2) deg/h^1/2 "
        "deg/hr**0.5 deg/h\u00bd deg*h^-0.5 degree/sqrt(hour) deg\u00b7h^-1/2"
    ),
    ("rad/s**0.5", DEG / HOUR): (
        "deg/h/sqrt(Hz) deg/hr/sqrt(Hz) \u00b0/h/\u221aHz \u00b0/hr/\u221aHz deg/h/rt-Hz deg/h/rtHz deg/h/\u221ahz "
        "(deg/h)/sqrt(Hz) (deg/hr)/\u221aHz dph/\u221aHz deg/hr/Hz^0.5 deg/hr/Hz^(1/2) deg/hr/\u221a(Hz)"
    ),
    ("m/s**1.5", MICRO_G): (
        "ug/sqrt(Hz) \u00b5g/\u221aHz \u03bcg/\u221aHz ug/rt-Hz ug/rtHz \u00b5g/rt(Hz) micro-g/\u221aHz"
    ),
    (
        "m/s**1.5",
        0.3048 / 60.0,
    ): "fps/rt-h ft/s/sqrt(h) ft/sec/\u221ahr (ft/s)/\u221ah fps/\u221ah fps/rt(hr)",
    ("rad/s", DEG): "deg/s deg/sec dps \u00b0/s \u00b0/sec deg/second deg*s^-1 deg\u00b7s\u207b\u00b9 deg\u2215s",
    ("rad/s", 1e-3 * DEG): "mdps mdeg/s mdeg/sec m\u00b0/s",
    ("m/s**2", 1.0): "m/s^2 m/s\u00b2 m/s**2 m/s/s m\u00b7s\u207b\u00b2 m\u22c5s^-2 (m/s)/s m/(s*s) m/(s^2)",
    ("m**2/s**3", MICRO_G**2): "ug^2/Hz \u00b5g\u00b2/Hz (ug)^2/Hz (\u00b5g/\u221aHz)^2",
    ("rad", math.pi / 648_000.0): "arcsec arc-sec asec \u2033 arcsecond",
    ("dimensionless", 1e-6): "ppm PPM",
}


@pytest.mark.parametrize(("unit", "value"), SPELLINGS)
def test_the_spellings_of_datasheets_are_one_unit(unit: str, value: float) -> None:
    read = {spelled: parse(f"1 {spelled}", unit) for spelled in SPELLINGS[unit, value].split()}
    assert read == pytest.approx(dict.fromkeys(read, value), rel=1e-13, abs=0.0)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("deg/srt(h)", "srt"), ("furlong/s", "furlong"), ("deg/rt-q", "q"), ("m-s", "m-s"), ("kmg/h", "kmg"),
        ("deg/sqrt(h", "deg/sqrt(h"), ("deg/", "deg/"), ("/s", "/s"), ("deg//s", "deg//s"), ("2*m", "2*m"), ("1", "1"),
        ("m^10", "m^10"), ("m^1/0", "m^1/0"), ("\u221a\u221am", "\u221a\u221am"), ("m)", "m)"),
        ("((((((((((((m", "(" * 12 + "m"),
        ("m**9**9", "m**9**9"), ("\uff4d", "\uff4d"), ("m\u0663", "m\u0663"), ("", ""),
    ],
)  # fmt: skip
def test_the_part_of_a_spelling_that_is_no_unit_is_named(text: str, part: str) -> None:
    with pytest.raises(UnknownUnitError) as caught:
        product(text)
    assert caught.value.unknown_text == part


def test_what_cancels_cancels_exactly() -> None:
    for text in ("deg/deg", "h/hr", "km/s*s/km", "deg/h/sqrt(h)*h/deg*\u221ahr"):
        assert conversion(product(text), product("dimensionless")) == 1.0


_FACTORS = st.lists(st.tuples(st.sampled_from(sorted(KNOWN)), st.sampled_from(["*", "/"])), min_size=1, max_size=4)


@given(_FACTORS, st.sampled_from(["", "^2", "^-1", "^0.5"]))
def test_a_product_of_units_is_the_product_of_their_values(factors: list[tuple[str, str]], power: str) -> None:
    spelled, value, si = "1/m*m", 1.0, "1/m*m"
    exponent = float(power[1:] or 1)
    for name, sign in factors:
        spelled, si = f"{spelled}{sign}{name}{power}", f"{si}{sign}({KNOWN[name][0]}){power}"
        value *= KNOWN[name][1] ** (exponent if sign == "*" else -exponent)
    si = si.replace("(dimensionless)", "(m/m)")
    assert conversion(product(spelled), product(si)) == pytest.approx(value, rel=1e-12)


@given(st.text(st.sampled_from("kgmtMGhdegrs\u221a()/*^-12\u00b2\u00b5\u00b0%."), min_size=1, max_size=8))
def test_what_is_read_is_made_of_units_of_the_list(text: str) -> None:
    """An independent reader: without operators, digits and roots only names of the list are left."""
    try:
        product(text)
    except ValueError:
        return
    left = text
    for operator in ("sqrt", "root", "rt-", "rt", "\u221a", "\u00b2", *"()/*^-.0123456789"):
        left = left.replace(operator, " ")
    assert left.strip()
    assert set(left.split()) <= {*KNOWN, *OFFSET}
