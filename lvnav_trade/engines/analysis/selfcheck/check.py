"""A check: the value found, the value allowed, the verdict."""

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

FAMILY = 0.01
"""Probability that a campaign whose statistics are all as they should be has a check that fails."""


class Check(NamedTuple):
    """One check. kind of check and what it is about; figure; low, high: allowed; where it was found.

    law: of a statistic, its distribution where all is as it should be (a frozen distribution of scipy), from which the
    bounds follow once it is known how many statistics there are (`bounded`); reason: why nothing was checked, empty if
    it was.
    """

    kind: str
    what: str
    figure: float = math.nan
    low: float = -math.inf
    high: float = math.inf
    where: str = ""
    law: Any = None
    reason: str = ""

    @property
    def verdict(self) -> str:
        """Passed, failed or not checked; a figure that is no number has failed."""
        if self.reason:
            return "not checked"
        return "passed" if self.low <= self.figure <= self.high else "failed"

    @property
    def words(self) -> tuple[str, str, str]:
        """Figure, what is allowed (or why nothing was checked) and verdict."""
        if self.reason:
            return "", self.reason, self.verdict
        allowed = f"{self.low:.4g} to {self.high:.4g}" if math.isfinite(self.low) else f"at most {self.high:.4g}"
        return f"{self.figure:.4g}", allowed, self.verdict

    def content(self) -> dict[str, Any]:
        """Return the check for programs; a number that is none, or no bound, is None."""
        numbers = {name: getattr(self, name) for name in ("figure", "low", "high")}
        finite = {name: value if math.isfinite(value) else None for name, value in numbers.items()}
        return {
            "kind": self.kind,
            "what": self.what,
            **finite,
            "verdict": self.verdict,
            "where": self.where,
            "reason": self.reason,
        }


def bounded(checks: Iterable[Check]) -> list[Check]:
    """Return checks with the bounds of their statistics: all of them together fail by chance with `FAMILY`."""
    found = list(checks)
    tail = FAMILY / (2.0 * max(1, sum(check.law is not None for check in found)))
    bounds = [(float(check.law.ppf(tail)), float(check.law.isf(tail))) if check.law else check[3:5] for check in found]
    return [check._replace(law=None, low=low, high=high) for check, (low, high) in zip(found, bounds, strict=True)]
