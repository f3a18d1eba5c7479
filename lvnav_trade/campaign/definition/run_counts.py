"""Number of Monte Carlo runs of each case of a campaign, and the cases that are selected for all runs."""

from collections.abc import Iterator, Mapping
from typing import Literal

from pydantic import Field, field_validator

from lvnav_trade.quantities import input_limits, units
from lvnav_trade.quantities.errors import quoted

_OTHER_RUNS = 40  # runs of an unselected case
_SIMULATED_DESIGNS = 10  # designs of a design space that are simulated


class MonteCarlo(units.Card):
    """Number of runs per case; without this block, linear covariance only."""

    runs: int = Field(description="runs per case; with stop, their largest number")
    stop: Literal["decided"] | None = Field(
        None, description="'decided': a case stops once all its requirements are met or violated"
    )
    block: int = Field(
        40,
        ge=8,
        le=input_limits.RUNS,
        multiple_of=8,
        description="runs per work item; part of the digest of the results",
    )
    selected: dict[str, str] = Field(
        {},
        description="level of some axes: only these cases have all runs; the others have `other_runs`, and their "
        "verdicts are linear covariance's where that many runs do not decide",
    )
    cases: Literal["undecided", "front"] | None = Field(
        None,
        description="with one row per design: selection of designs with runs; undecided (default): those nearest to a"
        " limit; front: those on the Pareto front of error and cost",
    )
    most_cases: int | None = Field(
        None, ge=1, le=input_limits.CASES, description="maximum number of these cases; 10 if absent"
    )
    other_runs: int | None = Field(
        None, ge=0, description="runs of each case that is not selected; 40 if absent, 0: linear covariance only"
    )

    @property
    def case_limit(self) -> int:
        """The largest number of cases that `cases` selects."""
        return _SIMULATED_DESIGNS if self.most_cases is None else self.most_cases

    def runs_of(self, levels: Mapping[str, str]) -> int:
        """Return the number of runs of the case with these levels (by name of the axis)."""
        if all(levels.get(axis) == level for axis, level in self.selected.items()):
            return self.runs
        return min(self.runs, _OTHER_RUNS if self.other_runs is None else self.other_runs)

    @field_validator("runs")
    @classmethod
    def _check_runs(cls, runs: int) -> int:
        if runs > input_limits.RUNS:
            raise ValueError(f"{quoted(runs)} runs; give {input_limits.RUNS} at most")
        if runs < 1:
            raise ValueError(f"{runs} runs; give at least 1, or leave monte_carlo out for linear covariance alone")
        return runs

    def _faults(self) -> Iterator[str]:
        if self.stop and self.selected:
            yield "stop and selected both determine the number of runs; choose one"
        if self.other_runs is not None and not self.selected:
            yield "other_runs has no effect: no cases are selected"
        if (self.other_runs or 0) > self.runs:
            yield f"other_runs: {self.other_runs} are more than the {self.runs} of the selected cases"
        if self.stop and self.runs % self.block:
            next_multiple = self.runs + self.block - self.runs % self.block
            yield f"stop tests after every block of {self.block} runs; {next_multiple} runs are a multiple of it"
