"""Records that the public functions return; a notebook displays them as tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from lvnav_trade.api.display import DisplayBase, DisplayContent
from lvnav_trade.results.comparison import comparison

if TYPE_CHECKING:
    from lvnav_trade.campaign.definition.axes import Case
    from lvnav_trade.campaign.definition.schema import Campaign
    from lvnav_trade.campaign.derived_cards import ProcessNoise
    from lvnav_trade.campaign.running.selfcheck import CombinedCheck
    from lvnav_trade.campaign.space.design_plan import DesignsPlan
    from lvnav_trade.filter.card import FilterCard


@dataclass(frozen=True)
class CheckedCampaign(DisplayBase):
    """A valid campaign.

    Attributes
    ----------
    campaign : Campaign
        The campaign, an argument of `run`.
    cases : tuple of Case
        Its cases: id (digest), label, axes (level by axis), scenario.
    beyond_limits, warnings, notes : tuple of str
        Remarks: settings outside validated limits, requirements that need more runs, other remarks.
    designs : int
        Number of designs of a design-space campaign, which stores one row per design; 0 for other campaigns. In this
        case `cases` are the cases that were checked: the base, and the two ends of each axis alone.
    """

    campaign: Campaign
    cases: tuple[Case, ...]
    beyond_limits: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    designs: int = 0

    @property
    def remarks(self) -> dict[str, list[str]]:
        """Remarks by kind, without the kinds that have none."""
        remarks = {name: list(getattr(self, name)) for name in ("beyond_limits", "warnings", "notes")}
        return {name: lines for name, lines in remarks.items() if lines}

    def _display_content(self) -> DisplayContent:
        lines = [line for remarks in self.remarks.values() for line in remarks]
        cases = pd.DataFrame([{"case": case.id, "label": case.label} for case in self.cases])
        return DisplayContent(f"{self.campaign.name}: valid", tuple(lines), {"Cases": cases})


@dataclass(frozen=True)
class Plan(DisplayBase):
    """Estimated cost of a campaign, and its progress.

    Attributes
    ----------
    cases : pandas.DataFrame
        One row per case: id, label, runs, done (number of stored runs).
    blocks : int
        Number of blocks of runs still to be computed.
    seconds : float
        Time on one core (s), without compilation.
    disk_mb, memory_mb : float
        Size of the results, and memory of a worker process (MB). For a design space, `designs` has the peak size on
        disk, which is reached before blocks of runs are deleted.
    warnings : tuple of str
        Requirements that the planned number of runs cannot demonstrate.
    designs : DesignsPlan or None
        Estimates for a design space; None for a campaign that stores every case completely.
    """

    cases: pd.DataFrame
    blocks: int
    seconds: float
    disk_mb: float
    memory_mb: float
    warnings: tuple[str, ...] = ()
    designs: DesignsPlan | None = None

    @property
    def cost(self) -> str:
        """Time, disk and memory in one line."""
        peak_disk_mb = self.disk_mb if self.designs is None else self.designs.most_mb
        peak_text = f" ({peak_disk_mb:.0f} MB meanwhile)" if peak_disk_mb > 1.1 * self.disk_mb else ""
        cost = f"{self.disk_mb:.0f} MB of disk{peak_text}, {self.memory_mb:.0f} MB a job"
        return f"about {self.seconds:.0f} s of one core once compiled, {cost}"

    def _display_content(self) -> DisplayContent:
        return DisplayContent("", (*self.warnings, self.cost), {"Cases": self.cases})


@dataclass(frozen=True)
class SelfCheck(DisplayBase):
    """Checks of the configuration of every case.

    Attributes
    ----------
    checks : tuple of CombinedCheck
        Each check, with the labels of the cases to which it applies.
    """

    checks: tuple[CombinedCheck, ...]

    def count(self, verdict: str) -> int:
        """Return the number of checks with a verdict: passed, failed or not checked."""
        return sum(combined_check.check.verdict == verdict for combined_check in self.checks)

    @property
    def passed(self) -> bool:
        """Whether no check has failed."""
        return not self.count("failed")

    @property
    def frame(self) -> pd.DataFrame:
        """One row per check: case, check, of, figure, allowed, verdict, where."""
        n_cases = len({label for combined_check in self.checks for label in combined_check.cases})
        rows = [
            [
                "all" if len(cases) == n_cases else "; ".join(cases),
                check.check_type,
                check.quantity,
                *check.cell_texts,
                check.remark,
            ]
            for check, cases in self.checks
        ]
        return pd.DataFrame(rows, columns=["case", "check", "of", "figure", "allowed", "verdict", "where"])

    def _display_content(self) -> DisplayContent:
        counts = {verdict: self.count(verdict) for verdict in ("passed", "failed", "not checked")}
        summary = ", ".join(f"{count} {verdict}" for verdict, count in counts.items() if count)
        return DisplayContent("Self-check", (summary,), {"": self.frame})


@dataclass(frozen=True)
class ReplayedRun(DisplayBase):
    """A replayed run.

    Attributes
    ----------
    case, label : str
        Digest and label of the case.
    run : int
        Number of the run.
    failure : str
        Reason why the run failed; empty if it succeeded.
    events : pandas.DataFrame
        Magnitudes of the errors at the events: event, t_s, quantity, error, unit (of the error in the same row).
    history : pandas.DataFrame
        Errors and formal sigmas at every covariance step, units in the names of the columns.
    trace : Path
        Parquet file with the history.
    """

    case: str
    label: str
    run: int
    failure: str
    events: pd.DataFrame
    history: pd.DataFrame
    trace: Path

    def _display_content(self) -> DisplayContent:
        failure_text = f": {self.failure}" if self.failure else ""
        return DisplayContent(
            f"{self.label}, run {self.run}{failure_text}", (f"trace: {self.trace}",), {"": self.events}
        )


class Comparison(comparison.ResultComparison, DisplayBase):
    """Comparison of two result sets: `frame` (one row per case and metric), `notes`, `confidence`, `verdict`."""

    def _display_content(self) -> DisplayContent:
        return DisplayContent(f"The candidate is {self.verdict}", self.notes, {"": self.frame})


@dataclass(frozen=True)
class ReportFiles:
    """Files of a report.

    Attributes
    ----------
    page : Path
        report.html, or brief.html if a brief report was requested.
    kept : Path or None
        report.md in the folder of the kept report; None if no report is kept.
    """

    page: Path
    kept: Path | None = None


@dataclass(frozen=True)
class EstimatedNoise(DisplayBase):
    """Process noise estimated from runs.

    Attributes
    ----------
    noise : ProcessNoise
        Densities over the flight and by phase, error per step, filter card.
    card : Path
        Filter card that was written.
    files : tuple of Path
        Error per step as CSV and PNG.
    """

    noise: ProcessNoise
    card: Path
    files: tuple[Path, Path]

    @property
    def densities(self) -> pd.DataFrame:
        """Root spectral densities, SI: phase, attitude, velocity, position; the whole flight first."""
        phases = {
            "whole flight": self.noise.flight_densities,
            **{name: densities for name, _, _, densities in self.noise.phases},
        }
        return pd.DataFrame([{"phase": name, **densities._asdict()} for name, densities in phases.items()])

    def _display_content(self) -> DisplayContent:
        return DisplayContent("Process noise", (f"card: {self.card}",), {"Densities, SI": self.densities})


@dataclass(frozen=True)
class Study:
    """Outcome of a study of several campaigns.

    Attributes
    ----------
    page : Path
        report.md, which compares the published numbers with the results.
    campaigns : dict of str to tuple of int
        By campaign: number of published values that are evidence, because no input determines them, and how many of
        these the results reproduce.
    published, hold : int
        The same two numbers, summed over all campaigns.
    failures : list of str
        One line per failed run.
    """

    page: Path
    campaigns: dict[str, tuple[int, int]]
    published: int
    hold: int
    failures: list[str]


@dataclass(frozen=True)
class Solution(DisplayBase):
    """Solution of an inverse problem.

    Attributes
    ----------
    answers : pandas.DataFrame
        One row per case: the largest value that meets the requirements, or the totals of the cases that meet them.
    confirmed : pandas.DataFrame
        Verdicts by Monte Carlo runs on both sides of each solution; empty if the campaign has no Monte Carlo.
    seconds : float
        Wall time (s).
    page : Path
        The report of the search, its tables next to it.
    """

    answers: pd.DataFrame
    confirmed: pd.DataFrame
    seconds: float
    page: Path

    def _display_content(self) -> DisplayContent:
        tables = {"": self.answers} | ({"Confirmed by runs": self.confirmed} if len(self.confirmed) else {})
        return DisplayContent("Solution", (f"{self.seconds:.0f} s; report: {self.page}",), tables)


@dataclass(frozen=True)
class Sensitivity(DisplayBase):
    """Global sensitivity to the sigmas of error sources.

    Attributes
    ----------
    indices : pandas.DataFrame
        Indices of the largest sources.
    case, error : str
        Case and error to which the indices apply.
    predicted : float
        Coefficient of determination of the fit for designs excluded from it; 1 for an exact fit.
    samples : int
        Number of designs.
    remark : str
        Reason why linear covariance does not describe the case; empty if it does.
    seconds : float
        Wall time (s).
    page : Path
        The report of the search, its tables next to it.
    """

    indices: pd.DataFrame
    case: str
    error: str
    predicted: float
    samples: int
    remark: str
    seconds: float
    page: Path

    def _display_content(self) -> DisplayContent:
        lines = (f"{self.samples} designs, {self.seconds:.0f} s; report: {self.page}", self.remark)
        return DisplayContent(f"{self.error}, {self.case}", tuple(line for line in lines if line), {"": self.indices})


@dataclass(frozen=True)
class Tuning(DisplayBase):
    """A tuned filter.

    Attributes
    ----------
    values : pandas.DataFrame
        One row per tuned setting, with its value before and after.
    cases : pandas.DataFrame
        One row per case: ratio of the error to its limit before and after; validation cases are marked.
    card : FilterCard
        The tuned filter.
    file : Path
        File of the filter card.
    evaluations : int
        Number of evaluations; each computes the linear covariance of all cases.
    seconds : float
        Wall time (s).
    page : Path
        The report of the search, its tables next to it.
    """

    values: pd.DataFrame
    cases: pd.DataFrame
    card: FilterCard
    file: Path
    evaluations: int
    seconds: float
    page: Path

    def _display_content(self) -> DisplayContent:
        line = f"{self.evaluations} evaluations, {self.seconds:.0f} s; report: {self.page}"
        return DisplayContent("Tuning", (line, f"card: {self.file}"), {"Values": self.values, "Cases": self.cases})


@dataclass(frozen=True)
class MetricNames(DisplayBase):
    """Metrics that a campaign can name, and tables that are computed from results.

    Attributes
    ----------
    metrics : pandas.DataFrame
        One row per metric: metric, unit, meaning, named_by.
    tables : dict of str to str
        Content of each computed table, by name.
    """

    metrics: pd.DataFrame
    tables: Mapping[str, str]

    def _display_content(self) -> DisplayContent:
        tables = pd.DataFrame(list(self.tables.items()), columns=["table", "content"])
        return DisplayContent("", (), {"Metrics": self.metrics, "Tables": tables})
