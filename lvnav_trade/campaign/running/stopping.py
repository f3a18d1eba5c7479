"""Sequential stopping: a case ends once its runs, taken in order, decide every requirement."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.definition.schema import Campaign, Requirement
from lvnav_trade.campaign.running.case_arrays import CaseArrays
from lvnav_trade.results.registry import metric_of
from lvnav_trade.results.statistics.case_results import parse_number

# Number of runs of a block that violate each requirement; None if the case does not have the metric
Counts = tuple[int | None, ...]


class Stopping:
    """Decides which blocks of runs are still needed: all of them, unless the campaign may stop early.

    The requirements are tested after each block in the order of the runs, not in the order in which blocks arrive. So
    neither the number of workers nor an interruption changes the result. Blocks computed beyond the decision are not
    counted.
    """

    def __init__(self, campaign: Campaign) -> None:
        card = campaign.monte_carlo
        self.is_early = card is not None and card.stop is not None
        self.run_limit = card.runs if card is not None else 0
        self.block = card.block if card is not None else 0
        self.requirements = campaign.requirements
        self._counts: dict[str, dict[int, Counts]] = {}
        self._runs: dict[str, int] = {}
        if card is not None and card.selected:
            self._runs = {case.id: card.runs_of(case.axes) for case in cases(campaign)}

    def note(self, case: str, first_run: int, n_run: int, counts: Counts) -> None:
        """Record the violating runs of a block; an incomplete block is ignored.

        Parameters
        ----------
        case : str
            Digest of the case.
        first_run, n_run : int
            Number of the first run of the block, and number of its runs.
        counts : Counts
            Number of violating runs of the block for each requirement; None for a requirement without its metric.
        """
        if self.is_early and n_run == self.block and case not in self._runs:
            self._counts.setdefault(case, {})[first_run] = counts
            runs = self._decided_runs(case)
            if runs is not None:
                self._runs[case] = runs

    def wants(self, case: str, first_run: int) -> bool:
        """Whether a block of a case may still be needed."""
        return first_run < self.runs(case)

    def runs(self, case: str) -> int:
        """Return the number of runs after which a case ends, as far as it is decided yet."""
        return self._runs.get(case, self.run_limit)

    def _decided_runs(self, case: str) -> int | None:
        """Return the number of runs after which all requirements are decided; None if one is still undecided."""
        counts = self._counts[case]
        consecutive_blocks = []  # only blocks without a gap before them count
        first_run = 0
        while first_run in counts:
            consecutive_blocks.append(counts[first_run])
            first_run += self.block
        last_decision = 0
        for k, requirement in enumerate(self.requirements):
            runs = _decision_run(k, requirement, consecutive_blocks, self.block)
            if runs is None:
                return None
            last_decision = max(last_decision, runs)
        return min(last_decision, self.run_limit) if self.requirements else None


def _decision_run(k: int, requirement: Requirement, blocks: Sequence[Counts], block: int) -> int | None:
    """Return the number of runs after which requirement `k` is decided; None if it is undecided or has no metric.

    Parameters
    ----------
    k : int
        Index of the requirement.
    requirement : Requirement
        The requirement.
    blocks : sequence of Counts
        Violating runs of each complete block, in the order of the runs.
    block : int
        Runs per block.
    """
    from lvnav_trade.results.requirements.requirements import decide

    violation_counts = []
    for counts in blocks:
        count = counts[k]
        if count is None:
            return None
        violation_counts.append(count)
    cumulative = list(itertools.accumulate(violation_counts))
    verdict, runs = decide(cumulative, requirement.probability, requirement.confidence, block)
    return None if verdict == "undecided" else runs


def violating_runs(
    requirements: Sequence[Mapping[str, Any]], case: str, prepared_case: Any, covariance: Any, summary: Any
) -> Counts:
    """Return the number of runs of a block that violate each requirement, counted as the verdicts count them.

    Parameters
    ----------
    requirements : sequence of mapping
        Requirements, as in the campaign.
    case : str
        Digest of the case.
    prepared_case : PreparedCase
        The prepared case.
    covariance : CovHistory
        Its linear covariance.
    summary : BlockSummary
        Summary of the runs of the block.

    Returns
    -------
    Counts
        Number by requirement; None for a requirement without its metric.
    """
    results = CaseArrays(prepared_case, covariance, summary)
    return tuple(_violation_count(results, requirement) for requirement in requirements)


def _violation_count(results: CaseArrays, requirement: Mapping[str, Any]) -> int | None:
    """Return the number of runs whose error reaches the limit of a requirement; None without the metric."""
    errors = metric_of(str(requirement["metric"])).errors(results, requirement)
    if errors is None:
        return None
    limit = parse_number(requirement["below"], errors.unit)
    return int((errors.magnitude >= limit).sum())
