"""A check: figure, allowed range, verdict."""

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

FAMILY = 0.01
"""Probability that any statistical check of a correct campaign fails."""


class CheckResult(NamedTuple):
    """Result of one check.

    kind : Kind of the check.
    what : Quantity that is checked.
    figure : Value found.
    low : Smallest allowed value.
    high : Largest allowed value.
    where : Place or circumstances of the figure.
    law : Distribution of a statistic if everything is correct (a frozen distribution of scipy). Its bounds follow when
        the number of statistics is known, see `bounded`.
    reason : Reason why nothing was checked; empty if it was.
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
        """Passed, failed or not checked; a figure that is not a number has failed."""
        if self.reason:
            return "not checked"
        return "passed" if self.low <= self.figure <= self.high else "failed"

    @property
    def words(self) -> tuple[str, str, str]:
        """Figure, allowed range (or reason why nothing was checked), and verdict."""
        if self.reason:
            return "", self.reason, self.verdict
        allowed = f"{self.low:.4g} to {self.high:.4g}" if math.isfinite(self.low) else f"at most {self.high:.4g}"
        return f"{self.figure:.4g}", allowed, self.verdict

    def content(self) -> dict[str, Any]:
        """Return the check as a dictionary; numbers that are not finite are None."""

        def finite(value: float) -> float | None:
            return value if math.isfinite(value) else None

        return {
            "kind": self.kind,
            "what": self.what,
            "figure": finite(self.figure),
            "low": finite(self.low),
            "high": finite(self.high),
            "verdict": self.verdict,
            "where": self.where,
            "reason": self.reason,
        }


def bounded(checks: Iterable[CheckResult]) -> list[CheckResult]:
    """Return checks with the bounds of their statistics, chosen so that any of them fails by chance with `FAMILY`."""
    listed = list(checks)
    n_statistic = sum(check.law is not None for check in listed)
    tail = FAMILY / (2.0 * max(1, n_statistic))  # Bonferroni, for each side of each statistic
    results = []
    for check in listed:
        low, high = check.low, check.high
        if check.law:
            low, high = float(check.law.ppf(tail)), float(check.law.isf(tail))
        results.append(check._replace(law=None, low=low, high=high))
    return results
