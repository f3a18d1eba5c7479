"""A folder of results from Python: tidy pandas frames with units in their column names, and the exit code."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lvnav_trade.store.read import load as read
from lvnav_trade.store.schema import TABLES

if TYPE_CHECKING:
    import pandas as pd

# Exit codes: all requirements met, one violated, bad usage or file, undecided, some runs failed, our fault, Ctrl-C
MET, VIOLATED, USAGE, UNDECIDED, FAILED, INTERNAL, INTERRUPTED = 0, 1, 2, 3, 4, 5, 130


class Results:
    """A folder of results.

    Attributes
    ----------
    cases, runs, history, budget, events, ... : pandas.DataFrame
        The stored tables, one row per observation, the unit at the end of every column's name; beside the digest of a
        case its label and its level of every axis (``axis_imu``).
    rms, agreement, requirements, curves, ... : pandas.DataFrame
        What is computed from them, every metric of ``lvnav-trade metrics`` that is no table: errors by case, phase or
        event, and axis, with their intervals; Monte Carlo against linear covariance; requirement, case, verdict (met,
        violated, undecided, not confirmed), estimate and what it rests on.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.tables = read(folder)

    def __getattr__(self, name: str) -> pd.DataFrame:
        if name.startswith("_") or name == "tables":
            raise AttributeError(name)
        from lvnav_trade.metrics import METRICS

        if name in METRICS and name not in TABLES:
            return METRICS[name](self.tables)
        return self._joined(getattr(self.tables, name))

    def __dir__(self) -> list[str]:
        from lvnav_trade.metrics import METRICS

        return sorted({*super().__dir__(), *TABLES, *METRICS})

    def __repr__(self) -> str:
        counts = self.tables.cases.run_count
        runs = f"{counts.min()} to {counts.max()}" if counts.min() < counts.max() else counts.max()
        return f"<Results of {self.tables.manifest.get('campaign')}: {len(counts)} cases, {runs} runs each>"

    def _joined(self, frame: pd.DataFrame) -> pd.DataFrame:
        """Return a table with the label of every row's case and, by axis, the level it has (``axis_imu``)."""
        import pandas as pd

        levels = self.tables.levels
        names = {axis: "axis_" + re.sub(r"\W", "_", axis) for case in levels.values() for axis in case}
        columns: dict[str, dict[str, str | None]] = {"label": {**self.tables.labels}}
        columns |= {column: {case: levels[case].get(axis) for case in levels} for axis, column in names.items()}
        found = frame.drop(columns="axes", errors="ignore")
        place = found.columns.get_loc("case") + 1
        for name, values in reversed(columns.items()):
            if name not in found:
                known = pd.Categorical(found.case.map(values), categories=list(dict.fromkeys(values.values())))
                found.insert(place, name, known)
        return found

    @property
    def failures(self) -> list[str]:
        """One line per failed run, with the command that flies it again, and per unit of work that was lost."""
        runs = self.tables.runs
        failed = runs[runs.failure != ""].drop_duplicates(["case", "run_number"])
        return self.tables.manifest.get("lost", []) + [
            f"{self.tables.labels[row.case]}, run {row.run_number} {row.failure} at {row.t_failed_s:g} s; "
            f"lvnav-trade replay {self.folder} {row.case} {row.run_number}"
            for row in failed.itertuples(index=False)
        ]

    @property
    def exit_code(self) -> int:
        """What the command line would leave with."""
        return exit_code(list(self.requirements.verdict), self.failures)


def exit_code(verdicts: Sequence[str], failures: Sequence[Any]) -> int:
    """Return the exit code of a finished campaign; failed runs come first, because no verdict is safe beside them."""
    if failures:
        return FAILED
    undecided = {"undecided", "not confirmed"} & set(verdicts)
    return VIOLATED if "violated" in verdicts else UNDECIDED if undecided else MET
