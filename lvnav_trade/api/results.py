"""A folder of results from Python: tables, summary, figures, exit code."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lvnav_trade.api.display import Displayed, Shown
from lvnav_trade.api.frames import Frames
from lvnav_trade.api.plotting import Plots
from lvnav_trade.errors import InputError
from lvnav_trade.store import remote
from lvnav_trade.store.read import load as read
from lvnav_trade.store.schema import SI_SUFFIX, TABLES, unit_suffix

if TYPE_CHECKING:
    import pandas as pd

# Exit codes: all requirements met, one violated, bad usage or file, undecided, some runs failed, our fault, Ctrl-C
MET, VIOLATED, USAGE, UNDECIDED, FAILED, INTERNAL, INTERRUPTED = 0, 1, 2, 3, 4, 5, 130


@dataclass(frozen=True)
class Summary(Displayed):
    """What a campaign found, in short.

    Attributes
    ----------
    campaign : str
        Name of the campaign.
    description : str
        Its question.
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
        What the command line would return.
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

    def _shown(self) -> Shown:
        from lvnav_trade.metrics.requirements.requirements import in_words

        low, high = self.runs
        counted = f"{self.cases} cases, {high if low == high else f'{low} to {high}'} runs each"
        said = ", ".join(f"{verdict} {count}" for verdict, count in self.verdicts.items())
        lines = [self.description, f"{counted}; {said or 'no requirements'}"]
        lines += [f"failed: {line}" for line in self.failures[:10]]
        tables = {"Requirements": in_words(self.requirements)} if len(self.requirements) else {}
        tables |= {"Errors at injection": self.ranking} if len(self.ranking) else {}
        return Shown(self.campaign, tuple(line for line in lines if line), tables)


class Results(Frames, Displayed):
    """A folder of results.

    The tables of `Frames` are attributes, such as ``results.runs`` and ``results.requirements``. A stored table has
    beside the digest of a case its label, its level of every axis as it is written (``axis_imu``), and of an axis of
    quantities the number in SI units (``axis_gyro_bias_rad_per_s``). ``results.cases`` is the table of designs: one
    row per case with its axes, errors, requirements and cost in SI.

    Attributes
    ----------
    folder : Path
        Folder of the results.
    plot : Plots
        Figures by name: ``results.plot.budget(quantity="position")``.
    failures : list of str
        One line per failed run, with the command that repeats it, and per work item that was lost.
    exit_code : int
        What the command line would return.
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
            return with_units(self._joined(getattr(self.tables, name)))
        return self.metric(name, AttributeError)

    def metric(self, name: str, error: type[Exception] = InputError) -> pd.DataFrame:
        """Return a computed table by name, as it is next to a report as CSV.

        Parameters
        ----------
        name : str
            Name of the table, such as ``budget``; ``lvnav-trade metrics`` lists them. Some are called like a stored
            table: ``results.budget`` is the stored one, ``results.metric("budget")`` the one computed from it.
        error : type of Exception
            Raised where there is no such table.

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
        from lvnav_trade.metrics import METRICS

        if name not in METRICS:
            raise error(f"no table {name!r}{hint(name, [*TABLES, *METRICS])}")
        return with_units(METRICS[name](self.tables).copy(deep=False))

    def errors(self, quantity: str | None = None, axis: str = "3d", at: str = "injection") -> pd.DataFrame:
        """Return the errors of every case at an event or in a phase, in units for people.

        Parameters
        ----------
        quantity : str, optional
            attitude, velocity, position or another state; all if absent.
        axis : str
            Axis of the reporting frame or of the body, or 3d.
        at : str
            Event, or phase such as ``liftoff to stage1_cutoff``; ``flight`` is all of it.

        Returns
        -------
        pandas.DataFrame
            Rows of the table `rms`: case, metric, unit, rms with its interval, formal and true sigma.

        Raises
        ------
        InputError
            There is no such quantity, axis, event or phase.
        """
        found = self.metric("rms")
        wanted = {"phase_or_event": at, "axis": axis, "metric": f"{quantity}_error" if quantity else None}
        for column, value in wanted.items():
            if value is not None and value not in set(found[column]):
                known = ", ".join(dict.fromkeys(found[column]))
                raise InputError(f"{column.replace('_', ' ')} {value!r}: there are {known}")
            found = found if value is None else found[found[column] == value]
        return found.reset_index(drop=True)

    @property
    def plot(self) -> Plots:
        """Figures by name."""
        return Plots(self.tables)

    def __dir__(self) -> list[str]:
        from lvnav_trade.metrics import METRICS

        return sorted({*super().__dir__(), *TABLES, *METRICS})

    def __repr__(self) -> str:
        counts = self.tables.cases.run_count
        runs = f"{counts.min()} to {counts.max()}" if counts.min() < counts.max() else counts.max()
        many = f"{len(self.tables.designs)} designs, of which whole " if self.tables.has_designs else ""
        return f"<Results of {self.tables.manifest.get('campaign')}: {many}{len(counts)} cases, {runs} runs each>"

    __str__ = __repr__

    def _shown(self) -> Shown:
        return self.summary()._shown()

    def summary(self) -> Summary:
        """Return what the campaign found, in short; a notebook and `print` show it.

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
        """Copy the results to a place that fsspec knows.

        Parameters
        ----------
        place : str
            Address, such as ``s3://bucket/demo``.

        Returns
        -------
        int
            Number of files copied.

        Raises
        ------
        InputError
            The place cannot be used, or holds other files.
        """
        return remote.copy_to(self.folder, place)

    def _joined(self, frame: pd.DataFrame) -> pd.DataFrame:
        """Return a table with the label of every row's case and, by axis, its level as text and as a number."""
        import pandas as pd

        from lvnav_trade.metrics.requirements.curves import si_axes

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
        for axis in si_axes(self.tables):
            numbers = {case: axis.values.get(levels[case].get(axis.name, "")) for case in levels}
            name = f"{names[axis.name]}_{unit_suffix(axis.unit)}"
            if name not in found:
                beside = found.columns.get_loc(names[axis.name]) + 1
                found.insert(beside, name, found.case.map(numbers).astype(float))
        return found

    @property
    def failures(self) -> list[str]:
        """One line per failed run, with the command that flies it again, and per work item that was lost."""
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


def with_units(frame: pd.DataFrame) -> pd.DataFrame:
    """Return a table with the SI units of its columns in ``attrs["units"]``, as the ends of their names say.

    Parameters
    ----------
    frame : pandas.DataFrame
        The table; it is changed.

    Returns
    -------
    pandas.DataFrame
        The same table.
    """
    by_end = sorted(((f"_{end}", unit) for unit, end in SI_SUFFIX.items()), key=lambda one: -len(one[0]))
    ends = {column: [unit for end, unit in by_end if str(column).endswith(end)] for column in frame.columns}
    frame.attrs["units"] = {column: units[0] for column, units in ends.items() if units}
    return frame


def exit_code(verdicts: Sequence[str], failures: Sequence[Any]) -> int:
    """Return the exit code of a finished campaign; failed runs come first, because no verdict is safe beside them.

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
    undecided = {"undecided", "not confirmed", "not applicable"} & set(verdicts)
    return VIOLATED if "violated" in verdicts else UNDECIDED if undecided else MET
