"""A check: figure, allowed range, verdict."""

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

FAMILY = 0.01
"""Probability that any statistical check of a correct campaign fails."""


class CheckResult(NamedTuple):
    """Result of one check.

    check_type : Type of the check.
    quantity : Quantity that is checked.
    figure : Value found.
    lower_limit : Smallest allowed value.
    upper_limit : Largest allowed value.
    remark : Place or circumstances of the figure.
    distribution : Distribution of a statistic if everything is correct (a frozen distribution of scipy). Its limits
        follow when the number of statistics is known, see `set_bounds`.
    reason : Reason why nothing was checked; empty if it was.
    """

    check_type: str
    quantity: str
    figure: float = math.nan
    lower_limit: float = -math.inf
    upper_limit: float = math.inf
    remark: str = ""
    distribution: Any = None
    reason: str = ""

    @property
    def verdict(self) -> str:
        """Passed, failed or not checked; a figure that is not a number has failed."""
        if self.reason:
            return "not checked"
        return "passed" if self.lower_limit <= self.figure <= self.upper_limit else "failed"

    @property
    def cell_texts(self) -> tuple[str, str, str]:
        """Figure, allowed range (or reason why nothing was checked), and verdict."""
        if self.reason:
            return "", self.reason, self.verdict
        if math.isfinite(self.lower_limit):
            range_text = f"{self.lower_limit:.4g} to {self.upper_limit:.4g}"
        else:
            range_text = f"at most {self.upper_limit:.4g}"
        return f"{self.figure:.4g}", range_text, self.verdict

    def content(self) -> dict[str, Any]:
        """Return the check as a dictionary; numbers that are not finite are None."""

        def finite(value: float) -> float | None:
            return value if math.isfinite(value) else None

        return {
            "kind": self.check_type,
            "what": self.quantity,
            "figure": finite(self.figure),
            "low": finite(self.lower_limit),
            "high": finite(self.upper_limit),
            "verdict": self.verdict,
            "where": self.remark,
            "reason": self.reason,
        }


def set_bounds(checks: Iterable[CheckResult]) -> list[CheckResult]:
    """Return checks with the bounds of their statistics, chosen so that any of them fails by chance with `FAMILY`."""
    check_list = list(checks)
    n_statistic = sum(check.distribution is not None for check in check_list)
    tail = FAMILY / (2.0 * max(1, n_statistic))  # Bonferroni, for each side of each statistic
    results = []
    for check in check_list:
        lower_limit, upper_limit = check.lower_limit, check.upper_limit
        if check.distribution:
            lower_limit, upper_limit = float(check.distribution.ppf(tail)), float(check.distribution.isf(tail))
        results.append(check._replace(distribution=None, lower_limit=lower_limit, upper_limit=upper_limit))
    return results
