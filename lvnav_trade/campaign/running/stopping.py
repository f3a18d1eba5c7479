"""Sequential stopping of a case: once every requirement is decided, by its runs in order and nothing else."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.definition.schema import Campaign, Requirement
from lvnav_trade.campaign.running.case_arrays import CaseArrays
from lvnav_trade.metrics.basics.case import number_in
from lvnav_trade.metrics.registry import metric_of

# Runs of a block beyond each requirement's bound; None where the case does not hold its metric
Counts = tuple[int | None, ...]


class Stopping:
    """Follows the blocks of every case and says which are still wanted: all of them, unless a campaign may end early.

    A look is taken after each block, in the order of the runs and however the blocks came in, so that the number of
    workers, or a campaign that was interrupted, changes nothing: blocks flown ahead of a decision are not counted.
    """

    def __init__(self, campaign: Campaign) -> None:
        card = campaign.monte_carlo
        self.is_early = card is not None and card.stop is not None
        self.most, self.block = (card.runs, card.block) if card is not None else (0, 0)
        self.requirements = campaign.requirements
        self._counts: dict[str, dict[int, Counts]] = {}
        self._runs: dict[str, int] = {}
        if card is not None and card.selected:
            self._runs = {case.id: card.runs_of(case.axes) for case in cases(campaign)}

    def note(self, case: str, first_run: int, n_run: int, counts: Counts) -> None:
        """Take in the runs of a block beyond each bound; a block that is not whole is not looked at."""
        if self.is_early and n_run == self.block and case not in self._runs:
            self._counts.setdefault(case, {})[first_run] = counts
            if (decided := self._decided(case)) is not None:
                self._runs[case] = decided

    def wants(self, case: str, first_run: int) -> bool:
        """Whether a block of a case may still be needed."""
        return first_run < self.runs(case)

    def runs(self, case: str) -> int:
        """Return after how many runs a case ends, as far as is known."""
        return self._runs.get(case, self.most)

    def _decided(self, case: str) -> int | None:
        """Return after how many runs all requirements are decided; None while one is not."""
        known = self._counts[case]
        ordered = [known[first] for first in itertools.takewhile(known.__contains__, itertools.count(step=self.block))]
        found = [_decided(k, requirement, ordered, self.block) for k, requirement in enumerate(self.requirements)]
        runs = [one for one in found if one is not None]
        return min(max(runs), self.most) if runs and len(runs) == len(found) else None


def _decided(k: int, requirement: Requirement, blocks: Sequence[Counts], block: int) -> int | None:
    from lvnav_trade.metrics.requirements.requirements import decide

    beyond = [counts[k] for counts in blocks]
    known = [count for count in beyond if count is not None]
    if len(known) < len(beyond):
        return None
    counts = list(itertools.accumulate(known))
    verdict, runs = decide(counts, requirement.probability, requirement.confidence, block)
    return None if verdict == "undecided" else runs


def beyond(
    requirements: Sequence[Mapping[str, Any]], case: str, prepared: Any, covariance: Any, summary: Any
) -> Counts:
    """Return how many runs of a block are beyond each requirement's bound, as the verdicts will count them."""
    results = CaseArrays(prepared, covariance, summary)
    return tuple(_beyond(results, requirement) for requirement in requirements)


def _beyond(results: CaseArrays, requirement: Mapping[str, Any]) -> int | None:
    found = metric_of(str(requirement["metric"])).errors(results, requirement)
    return None if found is None else int((found.size >= number_in(requirement["below"], found.unit)).sum())
