"""A folder of results from Python: tables, summary, figures, exit code."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lvnav_trade.api.display import DisplayBase, DisplayContent
from lvnav_trade.api.plotting import Plots
from lvnav_trade.api.table_names import Frames
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.results.tables import remote
from lvnav_trade.results.tables.dictionary import SI_SUFFIX, TABLES, TABLES_OF_VERSION_2, unit_suffix
from lvnav_trade.results.tables.read import load as read

if TYPE_CHECKING:
    import pandas as pd

# Exit codes: all requirements met, one violated, input error, undecided, some runs failed, internal error, Ctrl-C
MET, VIOLATED, USAGE, UNDECIDED, FAILED, INTERNAL, INTERRUPTED = 0, 1, 2, 3, 4, 5, 130


@dataclass(frozen=True)
class Summary(DisplayBase):
    """Main results of a campaign.

    Attributes
    ----------
    campaign : str
        Name of the campaign.
    description : str
        Question that the campaign answers, as written in its file.
    cases : int
        Number of cases.
    runs : tuple of int
        Smallest and largest number of runs of a case.
    verdicts : dict of str to int
        Number of verdicts by word: met, violated, undecided, not confirmed, not applicable.
    requirements : pandas.DataFrame
        Verdict on every requirement in every case, as `Results.requirements`.
    ranking : pandas.DataFrame
        3-D errors of every case at injection, as `Results.ranking`.
    failures : list of str
        One line per failed run.
    exit_code : int
        Exit code of the command line for these results.
    """

    campaign: str
    description: str
    cases: int
    runs: tuple[int, int]
    verdicts: dict[str, int]
    requirements: pd.DataFrame
    ranking: pd.DataFrame
    failures: list[str]
    exit_code: int

    def _display_content(self) -> DisplayContent:
        from lvnav_trade.results.requirements.requirements import verdict_texts

        low, high = self.runs
        runs = f"{high}" if low == high else f"{low} to {high}"
        verdicts = ", ".join(f"{verdict} {count}" for verdict, count in self.verdicts.items())
        lines = [
            self.description,
            f"{self.cases} cases, {runs} runs each; {verdicts or 'no requirements'}",
            *(f"failed: {line}" for line in self.failures[:10]),
        ]
        tables = {}
        if len(self.requirements):
            tables["Requirements"] = verdict_texts(self.requirements)
        if len(self.ranking):
            tables["Errors at injection"] = self.ranking
        return DisplayContent(self.campaign, tuple(line for line in lines if line), tables)


class Results(Frames, DisplayBase):
    """A folder of results.

    The tables of `Frames` are attributes, such as ``results.runs`` and ``results.requirements``. A stored table
    identifies a case by its digest, its label and its level of every axis as written (``axis_imu``). An axis of
    quantities also has a column with the number in SI units (``axis_gyro_bias_rad_per_s``). ``results.cases`` is the
    table of designs: one row per case with its axes, errors, requirements and cost in SI.

    Attributes
    ----------
    folder : Path
        Folder of the results.
    plot : Plots
        Figures by name: ``results.plot.budget(quantity="position")``.
    failures : list of str
        One line per failed run, with the command that replays it, and per lost work item.
    exit_code : int
        Exit code of the command line for these results.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.tables = read(folder)

    def __getattr__(self, name: str) -> pd.DataFrame:
        if name.startswith("_") or name == "tables":
            raise AttributeError(name)
        if name == "cases":
            return self.metric("designs")
        if name in TABLES:
            return with_units(self._add_axes(getattr(self.tables, name)))
        return self.metric(name, AttributeError)

    def metric(self, name: str, error: type[Exception] = InputError) -> pd.DataFrame:
        """Return a computed table by name; the same table is next to a report as CSV.

        Parameters
        ----------
        name : str
            Name of the table, such as ``budget``; ``lvnav-trade metrics`` lists them. Some computed tables have the
            name of a stored table: ``results.budget`` is the stored table, ``results.metric("budget")`` the computed.
        error : type of Exception
            Exception to raise if there is no such table.

        Returns
        -------
        pandas.DataFrame
            One row per observation; the unit is in the name of a column, or in a column `unit`.

        Raises
        ------
        InputError
            There is no such table.
        """
        from lvnav_trade.campaign.syntax.tree import hint
        from lvnav_trade.results.evaluation import METRICS

        if name not in METRICS:
            new_names = {old_name: new_name for new_name, old_name in TABLES_OF_VERSION_2.items()}
            rename_hint = f"; its name is {new_names[name]}" if name in new_names else ""
            raise error(f"no table {name!r}{rename_hint or hint(name, [*TABLES, *METRICS])}")
        return with_units(METRICS[name](self.tables).copy(deep=False))

    def errors(self, quantity: str | None = None, axis: str = "3d", at: str = "injection") -> pd.DataFrame:
        """Return the errors of every case at an event or in a phase, in display units.

        Parameters
        ----------
        quantity : str, optional
            attitude, velocity, position or another state; all if absent.
        axis : str
            Axis of the reporting frame or of the body axes, or 3d for the magnitude.
        at : str
            Event, or phase such as ``liftoff to stage1_cutoff``; ``flight`` is the whole flight.

        Returns
        -------
        pandas.DataFrame
            Rows of the table `rms`: case, metric, unit, rms with its interval, formal and true sigma.

        Raises
        ------
        InputError
            There is no such quantity, axis, event or phase.
        """
        rows = self.metric("rms")
        choices = {"phase_or_event": at, "axis": axis, "metric": f"{quantity}_error" if quantity else None}
        for column, value in choices.items():
            if value is None:
                continue
            if value not in set(rows[column]):
                values = ", ".join(dict.fromkeys(rows[column]))
                raise InputError(f"{column.replace('_', ' ')} {value!r}: there are {values}")
            rows = rows[rows[column] == value]
        return rows.reset_index(drop=True)

    @property
    def plot(self) -> Plots:
        """Figures by name."""
        return Plots(self.tables)

    def __dir__(self) -> list[str]:
        from lvnav_trade.results.evaluation import METRICS

        return sorted({*super().__dir__(), *TABLES, *METRICS})

    def __repr__(self) -> str:
        counts = self.tables.cases.run_count
        runs = f"{counts.max()}"
        if counts.min() < counts.max():
            runs = f"{counts.min()} to {counts.max()}"
        designs = ""
        if self.tables.has_designs:
            designs = f"{len(self.tables.designs)} designs, of which whole "
        return f"<Results of {self.tables.manifest.get('campaign')}: {designs}{len(counts)} cases, {runs} runs each>"

    __str__ = __repr__

    def _display_content(self) -> DisplayContent:
        return self.summary()._display_content()

    def summary(self) -> Summary:
        """Return the main results of the campaign; a notebook and `print` display them.

        Returns
        -------
        Summary
            Counts, verdicts, errors at injection.
        """
        requirements, counts = self.requirements, self.tables.cases.run_count
        verdicts = requirements.verdict.value_counts(sort=False).to_dict()
        return Summary(
            campaign=str(self.tables.manifest.get("campaign", self.folder.name)),
            description=str(self.tables.campaign.get("description") or ""),
            cases=len(counts),
            runs=(int(counts.min()), int(counts.max())) if len(counts) else (0, 0),
            verdicts=verdicts,
            requirements=requirements,
            ranking=self.ranking,
            failures=self.failures,
            exit_code=exit_code(list(requirements.verdict), self.failures),
        )

    def copy_to(self, place: str) -> int:
        """Copy the results to a remote location.

        Parameters
        ----------
        place : str
            Address that fsspec supports, such as ``s3://bucket/demo``.

        Returns
        -------
        int
            Number of files copied.

        Raises
        ------
        InputError
            The location cannot be written, or contains other files.
        """
        return remote.copy_to(self.folder, place)

    def _add_axes(self, frame: pd.DataFrame) -> pd.DataFrame:
        """Return a table with the label and, for each axis, the level as text and as number, inserted after `case`."""
        from lvnav_trade.results.requirements.limit_crossings import si_axes

        levels = self.tables.levels
        axis_by_column: dict[str, str] = {}
        for case_levels in levels.values():
            for axis in case_levels:
                axis_by_column[_axis_column(axis)] = axis

        table = frame.drop(columns="axes", errors="ignore")
        place = table.columns.get_loc("case") + 1
        # Each column is inserted in front of the previous one, so the order is reversed.
        for column, axis in reversed(axis_by_column.items()):
            _insert_texts(table, place, column, {case: levels[case].get(axis) for case in levels})
        _insert_texts(table, place, "label", {**self.tables.labels})

        for si_axis in si_axes(self.tables):
            column = _axis_column(si_axis.name)
            number_column = f"{column}_{unit_suffix(si_axis.unit)}"
            if number_column not in table:
                numbers = {case: si_axis.values.get(levels[case].get(si_axis.name, "")) for case in levels}
                place = table.columns.get_loc(column) + 1
                table.insert(place, number_column, table.case.map(numbers).astype(float))
        return table

    @property
    def failures(self) -> list[str]:
        """One line per failed run, with the command that replays it, and per lost work item."""
        runs = self.tables.runs
        failed_runs = runs[runs.failure != ""].drop_duplicates(["case", "run_number"])
        lines: list[str] = [*self.tables.manifest.get("lost", [])]
        for row in failed_runs.itertuples(index=False):
            run = f"{self.tables.labels[row.case]}, run {row.run_number} {row.failure} at {row.t_failed_s:g} s"
            lines.append(f"{run}; lvnav-trade replay {self.folder} {row.case} {row.run_number}")
        return lines

    @property
    def exit_code(self) -> int:
        """Exit code of the command line for these results."""
        return exit_code(list(self.requirements.verdict), self.failures)


def with_units(frame: pd.DataFrame) -> pd.DataFrame:
    """Add the SI units of the columns to a table, as ``attrs["units"]``; the suffixes of the names give the units.

    Parameters
    ----------
    frame : pandas.DataFrame
        The table; it is changed in place.

    Returns
    -------
    pandas.DataFrame
        The same table.
    """
    # the longest suffix first: m_per_s before s
    suffixes = sorted(((suffix, unit) for unit, suffix in SI_SUFFIX.items()), key=lambda pair: -len(pair[0]))
    units = {}
    for column in frame.columns:
        for suffix, unit in suffixes:
            if str(column).endswith(f"_{suffix}"):
                units[column] = unit
                break
    frame.attrs["units"] = units
    return frame


def _axis_column(axis: str) -> str:
    """Return the name of the column with the level of an axis."""
    return "axis_" + re.sub(r"\W", "_", axis)


def _insert_texts(table: pd.DataFrame, place: int, name: str, text_by_case: dict[str, str | None]) -> None:
    """Insert a column of texts by case at a place of a table, unless it has a column of that name."""
    import pandas as pd

    if name not in table:
        categories = list(dict.fromkeys(text_by_case.values()))
        table.insert(place, name, pd.Categorical(table.case.map(text_by_case), categories=categories))


def exit_code(verdicts: Sequence[str], failures: Sequence[Any]) -> int:
    """Return the exit code of a finished campaign; failed runs have priority, because they make every verdict doubtful.

    Parameters
    ----------
    verdicts : sequence of str
        Verdict of every requirement in every case.
    failures : sequence
        Failed runs.

    Returns
    -------
    int
        0 all met, 1 one violated, 3 one undecided, 4 some runs failed.
    """
    if failures:
        return FAILED
    if "violated" in verdicts:
        return VIOLATED
    if {"undecided", "not confirmed", "not applicable"} & set(verdicts):
        return UNDECIDED
    return MET
