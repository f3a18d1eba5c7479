"""Every unit is what NIST and BIPM say it is, and no spelling is read that is not in the list.

Definitions: BIPM, The International System of Units, 9th edition (tables 3, 4, 7, 8); NIST SP 811 (2008), appendix B.8;
NATO STANAG 2049 (mil); IAU (Julian year); IS-GPS and ITU-T usage of TECU.
"""

from __future__ import annotations

import math
import re
from fractions import Fraction
from pathlib import Path

import pytest

from lvnav_trade.quantities import units as quantities
from lvnav_trade.quantities.unit_spelling import AMBIGUOUS, product, units
from lvnav_trade.quantities.units import parse

ROOT = Path(__file__).parents[2]
TURN = 2.0 * math.pi
INCH = Fraction("0.0254")
FOOT = 12 * INCH
MILE = 5280 * FOOT
POUND = Fraction("0.45359237")
GRAVITY = Fraction("9.80665")
YEAR = Fraction("365.25") * 86400
# By SI unit: the value of 1 of each unit, for each of its spellings without a prefix.
DEFINITIONS = {
    "m": {
        "m metre metres meter meters": 1, "in inch inches": INCH, "ft foot feet": FOOT, "mi mile miles": MILE,
        "nmi NM nautical_mile nautical_miles": 1852,
    },
    "s": {
        "s sec second seconds": 1, "min minute minutes": 60, "h hr hrs Hr hour hours": 3600, "d day days": 86400,
        "week weeks": 7 * 86400, "month months": YEAR / 12, "yr year years": YEAR,
    },
    "rad": {
        "rad radian radians": 1, "deg \u00b0 \u00ba \u02da degree degrees": TURN / 360,
        "arcmin arc-min \u2032 arcminute arcminutes": TURN / 360 / 60,
        "arcsec arc-sec asec \u2033 arcsecond arcseconds": TURN / 360 / 3600, "mas": TURN / 360 / 3600 / 1000,
        "mil mils": TURN / 6400, "gon": TURN / 400, "rev revolution revolutions turn turns": TURN,
    },
    "rad/s": {"dps": TURN / 360, "dph": TURN / 360 / 3600, "rpm RPM": TURN / 60},
    "m/s": {
        "mps": 1, "fps": FOOT, "kph": Fraction(1000, 3600), "mph": MILE / 3600,
        "kn kt kts knot knots": Fraction(1852, 3600),
    },
    "m/s**2": {
        "g": GRAVITY, "milli-g milli_g": GRAVITY / 1000, "micro-g micro_g": GRAVITY / 10**6, "Gal": Fraction(1, 100),
    },
    "Hz": {"Hz hz HZ hertz": 1, "khz KHz": 1000},
    "kg": {
        "kg kilogram kilograms": 1, "gram grams": Fraction(1, 1000), "t tonne tonnes Mg": 1000,
        "lb lbs lbm pound pounds": POUND, "oz ounce ounces": POUND / 16, "slug slugs": POUND * GRAVITY / FOOT,
    },
    "N": {"N newton newtons": 1, "lbf": POUND * GRAVITY, "kgf": GRAVITY},
    "Pa": {
        "Pa pascal pascals": 1, "bar": 100_000, "atm": 101_325, "torr Torr": Fraction(101_325, 760),
        "psi psia": POUND * GRAVITY / INCH**2, "mmHg": Fraction("13595.1") * GRAVITY / 1000,
        "inHg": Fraction("13595.1") * GRAVITY * INCH,
    },
    "W": {"W watt watts": 1},
    "m**3": {"l L litre litres liter liters": Fraction(1, 1000), "cc": Fraction(1, 10**6)},
    "T": {"T tesla teslas": 1, "G Gs gauss Gauss": Fraction(1, 10_000)},
    "dimensionless": {
        "dimensionless": 1, "% percent": Fraction(1, 100), "\u2030": Fraction(1, 1000), "ppm PPM": Fraction(1, 10**6),
        "ppb PPB": Fraction(1, 10**9),
    },
    "1/m**2": {"TECU": 10**16},
    "K": {"K kelvin kelvins": 1},
}  # fmt: skip
SCALES = {
    "degC \u00b0C \u00baC \u02daC \u2103 celsius": (Fraction("273.15"), Fraction(1)),
    "degF \u00b0F \u00baF \u02daF \u2109 fahrenheit": (Fraction("459.67") * 5 / 9, Fraction(5, 9)),
}
PREFIXES = {
    "q": -30, "r": -27, "y": -24, "z": -21, "a": -18, "f": -15, "p": -12, "n": -9, "u": -6, "\u00b5": -6, "\u03bc": -6,
    "m": -3, "c": -2, "d": -1, "da": 1, "h": 2, "k": 3, "M": 6, "G": 9, "T": 12, "P": 15, "E": 18, "Z": 21, "Y": 24,
    "milli": -3, "kilo": 3, "micro": -6, "nano": -9, "mega": 6, "centi": -2, "deci": -1, "hecto": 2, "giga": 9,
}  # fmt: skip
MICRO = "u\u00b5\u03bc"
# What takes prefixes as letters; micro in each of its three letters.
PREFIXED = {
    "m": f"{MICRO}mcdk", "ft": "k", "s": f"n{MICRO}m", "sec": f"n{MICRO}m", "rad": f"n{MICRO}m",
    "deg": f"{MICRO}m", "\u00b0": f"{MICRO}m", "\u00ba": f"{MICRO}m", "\u02da": f"{MICRO}m", "dps": f"{MICRO}m",
    "g": f"n{MICRO}m", "Gal": f"{MICRO}m", "Hz": "mkMG", "N": f"{MICRO}mkM", "lbf": "k", "Pa": "mhkM", "bar": "m",
    "W": f"{MICRO}mk", "l": "mcd", "L": "mcd", "K": "m", "T": f"n{MICRO}m", "G": f"{MICRO}m", "Gs": f"{MICRO}m",
    "Gauss": f"{MICRO}m",
}  # fmt: skip
NAMED = {
    "metre meter": "micro milli centi deci kilo", "second": "nano micro milli", "radian": "nano micro milli",
    "degree": "micro milli", "arcsecond": "micro milli", "hertz": "milli kilo mega giga", "tesla": "nano micro milli",
    "newton": "micro milli kilo mega", "pascal": "milli hecto kilo mega", "watt": "micro milli kilo",
    "litre liter": "milli centi deci", "kelvin": "milli", "gauss": "micro milli",
}  # fmt: skip


def known() -> dict[str, tuple[str, float]]:
    """Return SI unit and value of every spelling that is to be read, temperature scales apart."""
    plain = {
        name: (si, float(value))
        for si, listed in DEFINITIONS.items()
        for names, value in listed.items()
        for name in names.split()
    }
    pairs = [(prefix, name) for name, prefixes in PREFIXED.items() for prefix in prefixes]
    for names, prefixes in NAMED.items():
        for name in names.split():
            more = ("",) if name.endswith(("s", "z")) else ("", "s")
            pairs += [(prefix, name + end) for prefix in prefixes.split() for end in more]
    return plain | {
        prefix + name: (plain[name][0], plain[name][1] * 10.0 ** PREFIXES[prefix]) for prefix, name in pairs
    }


KNOWN = known()
OFFSET = [name for names in SCALES for name in names.split()]


@pytest.mark.parametrize("si", DEFINITIONS)
def test_every_unit_has_the_value_of_its_definition(si: str) -> None:
    read = {name: parse(f"1 {name}", si) for name, (unit, _) in KNOWN.items() if unit == si}
    assert read == pytest.approx({name: KNOWN[name][1] for name in read}, rel=1e-14, abs=0.0)


def test_the_list_has_no_spelling_beyond_those_that_are_defined() -> None:
    assert set(units()) == {*KNOWN, *OFFSET}


def test_no_unit_is_of_two_dimensions() -> None:
    """Two entries of the list with one spelling would leave the later one."""
    for name, (si, _) in KNOWN.items():
        others = [other for other in DEFINITIONS if product(other).dimension != product(si).dimension]
        for other in others:
            with pytest.raises(ValueError, match="has the wrong unit"):
                parse(f"1 {name}", other)


@pytest.mark.parametrize("prefix", [*PREFIXES, "\u03a9", "k-", "K", "mm", "um", "kilo-"])
def test_a_prefix_is_read_where_the_list_has_it_and_refused_elsewhere(prefix: str) -> None:
    accepted = []
    for name in {*KNOWN, *OFFSET}:
        try:
            product(prefix + name)
        except ValueError:
            continue
        accepted.append(prefix + name)
    assert sorted(accepted) == sorted(prefix + name for name in {*KNOWN, *OFFSET} if prefix + name in {*KNOWN, *OFFSET})


@pytest.mark.parametrize("text", ["kmg", "kkg", "mkg", "Mt", "kt-", "mmil", "mlb", "kh", "Mm", "Tm", "pm", "kmin"])
def test_letters_that_only_look_like_a_prefixed_unit_are_refused_by_name(text: str) -> None:
    with pytest.raises(ValueError, match=f"has no unit that is known \\('{text}'\\)"):
        parse(f"1 {text}", "kg")


@pytest.mark.parametrize("name", AMBIGUOUS)
def test_what_means_two_units_is_refused_with_the_remedy(name: str) -> None:
    with pytest.raises(ValueError, match=f"'{name}' is .*; write "):
        parse(f"5 {name}", "m")


def test_a_kilogram_is_a_mass_and_g_an_acceleration() -> None:
    assert parse("5 kg", "kg") == parse("5 kilogram", "kg") == parse("5000 gram", "kg") == 5.0
    for text, unit in (("2 kg", "m/s**2"), ("9806.65 m/s^2", "kg"), ("1 t", "m/s**2"), ("5 kg/sqrt(Hz)", "m/s**1.5"),
                       ("4 kg/h", "m/s**3"), ("2 g", "kg"), ("2 mg", "kg"), ("5 G", "m/s**2")):  # fmt: skip
        with pytest.raises(ValueError, match="has the wrong unit"):
            parse(text, unit)


def test_a_quarter_of_a_turn_is_1600_mil_and_a_milliradian_is_another_unit() -> None:
    assert parse("1600 mil", "rad") == pytest.approx(0.5 * math.pi, rel=1e-15)
    assert parse("1 mil", "rad") == pytest.approx(0.98174770424681 * parse("1 mrad", "rad"), rel=1e-13)


@pytest.mark.parametrize("names", SCALES)
def test_a_temperature_scale_has_its_offset_alone_and_a_difference_in_a_product(names: str) -> None:
    offset, factor = SCALES[names]
    for name in names.split():
        assert parse(f"68 {name}", "K") == pytest.approx(float(offset + 68 * factor), rel=1e-14)
        assert parse(f"68 s*{name}", "s*K") == pytest.approx(float(68 * factor), rel=1e-14)
        with pytest.raises(ValueError, match="is below absolute zero"):
            parse(f"-{math.ceil(offset / factor) + 1} {name}", "K")
    with pytest.raises(ValueError, match="'-5 K' is below absolute zero"):
        parse("-5 K", "K")


@pytest.mark.parametrize("unit", sorted(quantities.EXAMPLES))
def test_the_units_of_a_messages_example_are_of_what_it_asks_for(unit: str) -> None:
    words = quantities.example(unit)
    for spelled in words[words.index("(") + 1 : -1].split(", "):
        assert math.isfinite(parse(f"1 {spelled}", unit))


def test_the_manual_lists_units_that_are_read() -> None:
    page = (ROOT / "docs" / "how_to.md").read_text(encoding="utf-8").partition("\n## Units\n")[2].partition("\n## ")[0]
    rows = [line for line in page.splitlines() if line.startswith("| ") and "`" in line]
    listed = [name for line in rows for name in re.findall(r"`([^`]+)`", line.split("|")[2])]
    levels = {name for spelled in quantities._LEVELS.values() for name in spelled}
    assert {name for name in listed if name in levels} == {*levels} - {"dBHz", "dB*Hz", "dB\u00b7Hz"}
    assert len(listed) > 80
    for name in set(listed) - levels:
        assert product(name).dimension is not None
    for refused in re.findall(r"`(\w+)`", page.rpartition("is refused:")[2]):
        assert refused in AMBIGUOUS
