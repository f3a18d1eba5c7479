"""Units as datasheets spell them: the units that are accepted, and their products, quotients, powers and roots.

Units and prefixes that are not listed are refused: a library with all units reads ``kg`` as a thousand standard
gravities where ``g`` is gravity, ``mil`` as a tenth of one, and finds a meaning for ``t`` or ``kmg``.
Reasons: docs/decisions/0068-units-are-a-list.md.

``deg/sqrt(h)``, ``deg/rt-h``, ``deg/hr/√Hz``, ``m/s^2``, ``(deg/h)/sqrt(Hz)``, ``rad*s/m``, ``1/s``.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from functools import cache, lru_cache
from typing import NamedTuple

from lvnav_trade.quantities.input_limits import EXPONENT

Powers = Mapping[float, float]
Dimension = Mapping[str, float]


class Unit(NamedTuple):
    """A unit.

    The size is a product of powers, so that common numbers in ``deg/h/sqrt(h)`` cancel exactly.

    size : Size in SI: powers of numbers.
    dimension : Powers of base units.
    offset : K. Offset of a temperature scale.
    """

    size: Powers
    dimension: Dimension
    offset: float = 0.0


class _UnitSpellings(NamedTuple):
    """A unit with all its spellings.

    symbols : Symbols, with prefixes as letters.
    words : Words, with prefixes in full and a plural.
    size, dimension, offset : As in `Unit`.
    prefixes : Letters of the allowed prefixes.
    """

    symbols: str
    words: str
    size: Powers
    dimension: Dimension
    prefixes: str = ""
    offset: float = 0.0


_PREFIXES = {
    "n": ("nano", 1e-9),
    "u": ("micro", 1e-6),
    "m": ("milli", 1e-3),
    "c": ("centi", 1e-2),
    "d": ("deci", 0.1),
    "h": ("hecto", 100.0),
    "k": ("kilo", 1e3),
    "M": ("mega", 1e6),
    "G": ("giga", 1e9),
}
MICRO = "u\u00b5\u03bc"
"""The letters of the prefix micro: u, the micro sign, the Greek mu."""
_DEGREE = math.pi / 180.0
_FOOT = 0.3048
_POUND = 0.45359237  # kg, exactly (NIST SP 811, B.8)
_GRAVITY = 9.80665
_RATE, _SPEED, _ACCELERATION = {"rad": 1, "s": -1}, {"m": 1, "s": -1}, {"m": 1, "s": -2}
_FORCE, _PRESSURE, _POWER = {"kg": 1, "m": 1, "s": -2}, {"kg": 1, "m": -1, "s": -2}, {"kg": 1, "m": 2, "s": -3}
_LIST = (
    # length
    _UnitSpellings("m", "metre meter", {}, {"m": 1}, "umcdk"),  # without n: nm is a nautical mile as well
    _UnitSpellings("in", "", {0.0254: 1}, {"m": 1}),
    _UnitSpellings("inch inches", "", {0.0254: 1}, {"m": 1}),
    _UnitSpellings("ft", "", {_FOOT: 1}, {"m": 1}, "k"),
    _UnitSpellings("foot feet", "", {_FOOT: 1}, {"m": 1}),
    _UnitSpellings("mi", "mile", {1609.344: 1}, {"m": 1}),
    _UnitSpellings("nmi NM", "nautical_mile", {1852.0: 1}, {"m": 1}),
    # time
    _UnitSpellings("s sec", "second", {}, {"s": 1}, "num"),
    _UnitSpellings("min", "minute", {60.0: 1}, {"s": 1}),
    _UnitSpellings("h hr hrs Hr", "hour", {60.0: 2}, {"s": 1}),
    _UnitSpellings("d", "day", {24.0: 1, 60.0: 2}, {"s": 1}),
    _UnitSpellings("", "week", {7.0: 1, 24.0: 1, 60.0: 2}, {"s": 1}),
    _UnitSpellings("", "month", {1.0 / 12.0: 1, 365.25: 1, 24.0: 1, 60.0: 2}, {"s": 1}),
    _UnitSpellings("yr", "year", {365.25: 1, 24.0: 1, 60.0: 2}, {"s": 1}),
    # angle
    _UnitSpellings("rad", "radian", {}, {"rad": 1}, "num"),
    _UnitSpellings("deg \u00b0 \u00ba \u02da", "degree", {_DEGREE: 1}, {"rad": 1}, "um"),
    _UnitSpellings("arcmin arc-min \u2032", "arcminute", {1.0 / 60.0: 1, _DEGREE: 1}, {"rad": 1}),
    _UnitSpellings("arcsec arc-sec asec \u2033", "", {1.0 / 60.0: 2, _DEGREE: 1}, {"rad": 1}),
    _UnitSpellings("", "arcsecond", {1.0 / 60.0: 2, _DEGREE: 1}, {"rad": 1}, "um"),
    _UnitSpellings("mas", "", {1e-3: 1, 1.0 / 60.0: 2, _DEGREE: 1}, {"rad": 1}),
    _UnitSpellings("mil mils", "", {2.0 * math.pi / 6400.0: 1}, {"rad": 1}),  # NATO: 1600 mil are 90 deg
    _UnitSpellings("gon", "", {math.pi / 200.0: 1}, {"rad": 1}),
    _UnitSpellings("rev", "revolution turn", {2.0 * math.pi: 1}, {"rad": 1}),
    # angular rate
    _UnitSpellings("dps", "", {_DEGREE: 1}, _RATE, "um"),
    _UnitSpellings("dph", "", {_DEGREE: 1, 60.0: -2}, _RATE),
    _UnitSpellings("rpm RPM", "", {2.0 * math.pi: 1, 60.0: -1}, _RATE),
    # speed
    _UnitSpellings("mps", "", {}, _SPEED),
    _UnitSpellings("fps", "", {_FOOT: 1}, _SPEED),
    _UnitSpellings("kph", "", {1000.0: 1, 60.0: -2}, _SPEED),
    _UnitSpellings("mph", "", {1609.344: 1, 60.0: -2}, _SPEED),
    _UnitSpellings("kn kt kts", "knot", {1852.0: 1, 60.0: -2}, _SPEED),
    # acceleration: g is standard gravity and never a gram
    _UnitSpellings("g", "", {_GRAVITY: 1}, _ACCELERATION, "num"),
    _UnitSpellings("milli-g milli_g", "", {1e-3: 1, _GRAVITY: 1}, _ACCELERATION),
    _UnitSpellings("micro-g micro_g", "", {1e-6: 1, _GRAVITY: 1}, _ACCELERATION),
    _UnitSpellings("Gal", "", {0.01: 1}, _ACCELERATION, "um"),
    # frequency
    _UnitSpellings("Hz", "hertz", {}, {"s": -1}, "mkMG"),
    _UnitSpellings("hz HZ", "", {}, {"s": -1}),
    _UnitSpellings("khz KHz", "", {1e3: 1}, {"s": -1}),
    # mass
    _UnitSpellings("kg", "kilogram", {}, {"kg": 1}),
    _UnitSpellings("", "gram", {1e-3: 1}, {"kg": 1}),
    _UnitSpellings("t Mg", "tonne", {1000.0: 1}, {"kg": 1}),
    _UnitSpellings("lb lbs lbm", "pound", {_POUND: 1}, {"kg": 1}),
    _UnitSpellings("oz", "ounce", {_POUND / 16.0: 1}, {"kg": 1}),
    _UnitSpellings("slug slugs", "", {_POUND: 1, _GRAVITY: 1, _FOOT: -1}, {"kg": 1}),
    # force, pressure, power
    _UnitSpellings("N", "newton", {}, _FORCE, "umkM"),
    _UnitSpellings("lbf", "", {_POUND: 1, _GRAVITY: 1}, _FORCE, "k"),
    _UnitSpellings("kgf", "", {_GRAVITY: 1}, _FORCE),
    _UnitSpellings("Pa", "pascal", {}, _PRESSURE, "mhkM"),
    _UnitSpellings("bar", "", {1e5: 1}, _PRESSURE, "m"),
    _UnitSpellings("atm", "", {101325.0: 1}, _PRESSURE),
    _UnitSpellings("torr Torr", "", {101325.0: 1, 760.0: -1}, _PRESSURE),
    _UnitSpellings("psi psia", "", {_POUND: 1, _GRAVITY: 1, 0.0254: -2}, _PRESSURE),
    _UnitSpellings("inHg", "", {25.4: 1, 13.5951: 1, _GRAVITY: 1}, _PRESSURE),  # mercury of 13595.1 kg/m^3
    _UnitSpellings("mmHg", "", {13.5951: 1, _GRAVITY: 1}, _PRESSURE),
    _UnitSpellings("W", "watt", {}, _POWER, "umk"),
    # volume
    _UnitSpellings("l L", "litre liter", {0.1: 3}, {"m": 3}, "mcd"),
    _UnitSpellings("cc", "", {0.01: 3}, {"m": 3}),
    # temperature
    _UnitSpellings("K", "kelvin", {}, {"K": 1}, "m"),
    _UnitSpellings("degC \u00b0C \u00baC \u02daC \u2103 celsius", "", {}, {"K": 1}, offset=273.15),
    _UnitSpellings(
        "degF \u00b0F \u00baF \u02daF \u2109 fahrenheit", "", {5.0 / 9.0: 1}, {"K": 1}, offset=459.67 * 5.0 / 9.0
    ),
    # magnetic flux density
    _UnitSpellings("T", "tesla", {}, {"T": 1}, "num"),
    _UnitSpellings("G Gs Gauss", "gauss", {1e-4: 1}, {"T": 1}, "um"),
    # fractions and electron content
    _UnitSpellings("ppm PPM", "", {1e-6: 1}, {}),
    _UnitSpellings("ppb PPB", "", {1e-9: 1}, {}),
    _UnitSpellings("\u2030", "", {1e-3: 1}, {}),
    _UnitSpellings("% percent", "", {0.01: 1}, {}),
    _UnitSpellings("dimensionless", "", {}, {}),
    _UnitSpellings("TECU", "", {1e16: 1}, {"m": -2}),
)


def _spellings(entry: _UnitSpellings) -> Iterator[tuple[str, Powers]]:
    """Yield every spelling of a unit with its size."""
    symbols = entry.symbols.split()
    words = []
    for word in entry.words.split():
        words.append(word)
        if not word.endswith(("s", "z")):
            words.append(word + "s")
    for name in (*symbols, *words):
        yield name, entry.size
    for prefix in entry.prefixes:
        prefix_word, factor = _PREFIXES[prefix]
        # the prefix first: the order in which numbers are multiplied decides the last bit
        size = {factor: 1.0, **entry.size}
        size[factor] = 1.0 + entry.size.get(factor, 0.0)
        letters = MICRO if prefix == "u" else prefix
        for name in symbols:
            for letter in letters:
                yield letter + name, size
        for name in words:
            yield prefix_word + name, size


def _units_by_spelling(entries: Iterable[_UnitSpellings]) -> Iterator[tuple[str, Unit]]:
    for entry in entries:
        for name, size in _spellings(entry):
            yield name, Unit(size, entry.dimension, entry.offset)


@cache
def units() -> Mapping[str, Unit]:
    """Return every unit of the list by each of its spellings."""
    return dict(_units_by_spelling(_LIST))


AMBIGUOUS = {
    "nm": "is a nanometre or a nautical mile; write nmi",
    "ton": "is one of three masses; write t (1000 kg) or lb",
    "tons": "is one of three masses; write t (1000 kg) or lb",
}
"""Spellings that mean more than one unit, with the remedy."""


_ROOT = re.compile(r"(?:\u221a|(?:sqrt|SQRT|rt|RT|root)(?=[-(]|[^\W\d_]))-?")
_SIGN = r"[um\u00b5\u03bc]?[%\u2030\u00b0\u00ba\u02da\u2032\u2033\u2103\u2109]"  # perhaps with the letter of a prefix
_NAME = re.compile(rf"(?:{_SIGN})?(?:[^\W\d_]+(?:[-_][^\W\d_]+)*)?")
_NUMBER = r"-?[0-9]+(?:\.[0-9]+)?(?:/[1-9])?"
_EXPONENT = re.compile(rf"(?:\^|\*\*)(?:({_NUMBER})|\(({_NUMBER})\))")
_RAISED = str.maketrans("\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079", "-0123456789")
_SUPERSCRIPT = re.compile("\u207b?[\u2070\u00b9\u00b2\u00b3\u2074-\u2079]+")
_SIGNS = str.maketrans({"\u2212": "-", "\u00b7": "*", "\u22c5": "*", "\u2215": "/", "\u2044": "/"})
_DEEPEST = 10  # brackets within each other


class UnknownUnitError(ValueError):
    """An unknown unit: `unknown_text` is the part of the text that is unknown, `remedy` a suggestion."""

    def __init__(self, unknown_text: str, remedy: str = "") -> None:
        super().__init__(unknown_text)
        self.unknown_text = unknown_text
        self.remedy = remedy


class Product(NamedTuple):
    """A product of units.

    numerator, denominator : Numbers in numerator and denominator of its size in SI, each with its power (> 0).
    dimension : Powers of the base units.
    offset : K. Offset of a temperature scale, if it is the only factor.
    """

    numerator: Mapping[float, float]
    denominator: Mapping[float, float]
    dimension: Dimension
    offset: float


@lru_cache(maxsize=4096)
def product(text: str) -> Product:
    """Return the product of units in a text; `UnknownUnitError` names the part that is unknown."""
    normalised_text = _SUPERSCRIPT.sub(lambda match: f"^{match[0].translate(_RAISED)}", text)
    normalised_text = normalised_text.translate(_SIGNS).replace("\u00bd", "^0.5")
    reader = _UnitParser(text, normalised_text)
    factors = reader.factors(0)
    if reader.position < len(normalised_text):
        raise UnknownUnitError(text)
    numerator: dict[float, float] = {}
    denominator: dict[float, float] = {}
    dimension: dict[str, float] = {}
    for unit, exponent in factors:
        for number, power in unit.size.items():
            total = power * exponent
            if total > 0.0:
                numerator[number] = numerator.get(number, 0.0) + total
            else:
                denominator[number] = denominator.get(number, 0.0) - total
        for base, power in unit.dimension.items():
            total = power * exponent
            dimension[base] = dimension.get(base, 0.0) + total
    remaining_powers = {base: power for base, power in dimension.items() if power != 0.0}
    offset = 0.0
    if len(factors) == 1:
        unit, exponent = factors[0]
        if exponent == 1.0:
            offset = unit.offset
    return Product(numerator, denominator, remaining_powers, offset)


def conversion(source: Product, target: Product) -> float:
    """Return the factor from numbers in `source` to numbers in `target`, a unit of the same dimension.

    Numbers in numerator and denominator cancel before the multiplication, so that the factor is exact where possible.
    """
    numerator = dict(source.numerator)
    denominator = dict(source.denominator)
    for number, power in target.numerator.items():
        denominator[number] = denominator.get(number, 0.0) + power
    for number, power in target.denominator.items():
        numerator[number] = numerator.get(number, 0.0) + power
    for number in numerator.keys() & denominator.keys():
        common = min(numerator[number], denominator[number])
        numerator[number] -= common
        denominator[number] -= common
    factor = 1.0
    for number, power in numerator.items():
        factor *= number**power
    for number, power in denominator.items():
        factor *= number**-power
    return factor


class _UnitParser:
    """Parser of the factors of `normalised_text`, the normalised form of `text` as the user wrote it."""

    def __init__(self, text: str, normalised_text: str) -> None:
        self.text = text
        self.normalised_text = normalised_text
        self.position = 0
        self.depth = 0

    def factors(self, depth: int) -> list[tuple[Unit, float]]:
        """Return the factors of a product or quotient, each with its exponent."""
        if depth > _DEEPEST:
            raise UnknownUnitError(self.text)
        factors = self._power(depth)
        while self.position < len(self.normalised_text) and self.normalised_text[self.position] in "*/":
            is_quotient = self.normalised_text[self.position] == "/"
            sign = -1.0 if is_quotient else 1.0
            self.position += 1
            next_factors = self._power(depth)
            factors += [(unit, sign * exponent) for unit, exponent in next_factors]
        return factors

    def _power(self, depth: int) -> list[tuple[Unit, float]]:
        root = self._match(_ROOT)
        factors = self._atom(depth)
        exponent = 0.5 if root else 1.0
        exponent_match = self._match(_EXPONENT)
        if exponent_match:
            numerator_text, _, denominator_text = (exponent_match[1] or exponent_match[2]).partition("/")
            numerator = float(numerator_text)
            exponent *= numerator / float(denominator_text or 1)
            if abs(numerator) > EXPONENT:
                raise UnknownUnitError(self.text)
        return [(unit, exponent * power) for unit, power in factors]

    def _atom(self, depth: int) -> list[tuple[Unit, float]]:
        if self.normalised_text.startswith("1/", self.position):
            self.position += 1
            return []
        if self.normalised_text.startswith("(", self.position):
            self.position += 1
            inner_factors = self.factors(depth + 1)
            if not self.normalised_text.startswith(")", self.position):
                raise UnknownUnitError(self.text)
            self.position += 1
            return inner_factors
        match = self._match(_NAME)
        if match is None or not match[0]:
            raise UnknownUnitError(self.text)
        name = match[0]
        if name in AMBIGUOUS:
            raise UnknownUnitError(name, AMBIGUOUS[name])
        if name not in units():
            raise UnknownUnitError(name)
        return [(units()[name], 1.0)]

    def _match(self, pattern: re.Pattern[str]) -> re.Match[str] | None:
        match = pattern.match(self.normalised_text, self.position)
        if match is not None:
            self.position = match.end()
        return match
