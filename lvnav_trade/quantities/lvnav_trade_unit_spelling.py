"""Units as datasheets spell them: products, quotients, powers and roots of the units of `unit_list`.

``deg/sqrt(h)``, ``deg/rt-h``, ``deg/hr/\u221aHz``, ``m/s^2``, ``(deg/h)/sqrt(Hz)``, ``rad*s/m``, ``1/s``.
"""

import re
from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

from lvnav_trade.quantities.limits import EXPONENT
from lvnav_trade.quantities.unit_spelling import AMBIGUOUS, Dimension, Unit, units

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
    """An unknown unit: `part` is the part of the text that is unknown, `remedy` a suggestion."""

    def __init__(self, part: str, remedy: str = "") -> None:
        super().__init__(part)
        self.part, self.remedy = part, remedy


class Product(NamedTuple):
    """A product of units.

    above, below : Numbers in numerator and denominator of its size in SI, each with its power (> 0).
    dimension : Powers of the base units.
    offset : K. Offset of a temperature scale, if it is the only factor.
    """

    above: Mapping[float, float]
    below: Mapping[float, float]
    dimension: Dimension
    offset: float


@lru_cache(maxsize=4096)
def product(text: str) -> Product:
    """Return the product of units in a text; `UnknownUnitError` names the part that is unknown."""
    spelled = _SUPERSCRIPT.sub(lambda match: f"^{match[0].translate(_RAISED)}", text)
    spelled = spelled.translate(_SIGNS).replace("\u00bd", "^0.5")
    reader = _Reader(text, spelled)
    factors = reader.factors(0)
    if reader.at < len(spelled):
        raise UnknownUnitError(text)
    above: dict[float, float] = {}
    below: dict[float, float] = {}
    dimension: dict[str, float] = {}
    for unit, exponent in factors:
        for number, power in unit.size.items():
            side, power = (above, power * exponent) if power * exponent > 0.0 else (below, -power * exponent)
            side[number] = side.get(number, 0.0) + power
        for base, power in unit.dimension.items():
            dimension[base] = dimension.get(base, 0.0) + power * exponent
    alone = len(factors) == 1 and factors[0][1] == 1.0
    remaining = {base: power for base, power in dimension.items() if power != 0.0}
    return Product(above, below, remaining, factors[0][0].offset if alone else 0.0)


def conversion(source: Product, target: Product) -> float:
    """Return the factor from numbers in `source` to numbers in `target`, a unit of the same dimension.

    Numbers in numerator and denominator cancel before the multiplication, so that the factor is exact where possible.
    """
    above, below = dict(source.above), dict(source.below)
    for number, power in target.above.items():
        below[number] = below.get(number, 0.0) + power
    for number, power in target.below.items():
        above[number] = above.get(number, 0.0) + power
    for number in above.keys() & below.keys():
        both = min(above[number], below[number])
        above[number], below[number] = above[number] - both, below[number] - both
    factor = 1.0
    for number, power in above.items():
        factor *= number**power
    for number, power in below.items():
        factor *= number**-power
    return factor


class _Reader:
    """Parser of the factors of `spelled`, the normalised form of `text` as the user wrote it."""

    def __init__(self, text: str, spelled: str) -> None:
        self.text, self.spelled, self.at, self.depth = text, spelled, 0, 0

    def factors(self, depth: int) -> list[tuple[Unit, float]]:
        """Return the factors of a product or quotient, each with its exponent."""
        if depth > _DEEPEST:
            raise UnknownUnitError(self.text)
        factors = self._power(depth)
        while self.at < len(self.spelled) and self.spelled[self.at] in "*/":
            sign = -1.0 if self.spelled[self.at] == "/" else 1.0
            self.at += 1
            factors += [(unit, sign * exponent) for unit, exponent in self._power(depth)]
        return factors

    def _power(self, depth: int) -> list[tuple[Unit, float]]:
        root = self._taken(_ROOT)
        factors = self._atom(depth)
        exponent = 0.5 if root else 1.0
        if stated := self._taken(_EXPONENT):
            above, _, below = (stated[1] or stated[2]).partition("/")
            exponent *= float(above) / float(below or 1)
            if abs(float(above)) > EXPONENT:
                raise UnknownUnitError(self.text)
        return [(unit, exponent * power) for unit, power in factors]

    def _atom(self, depth: int) -> list[tuple[Unit, float]]:
        if self.spelled.startswith("1/", self.at):
            self.at += 1
            return []
        if self.spelled.startswith("(", self.at):
            self.at += 1
            inside = self.factors(depth + 1)
            if not self.spelled.startswith(")", self.at):
                raise UnknownUnitError(self.text)
            self.at += 1
            return inside
        name = self._taken(_NAME)
        if name is None or not name[0]:
            raise UnknownUnitError(self.text)
        if name[0] in AMBIGUOUS:
            raise UnknownUnitError(name[0], AMBIGUOUS[name[0]])
        if name[0] not in units():
            raise UnknownUnitError(name[0])
        return [(units()[name[0]], 1.0)]

    def _taken(self, pattern: re.Pattern[str]) -> re.Match[str] | None:
        match = pattern.match(self.spelled, self.at)
        if match is not None:
            self.at = match.end()
        return match
