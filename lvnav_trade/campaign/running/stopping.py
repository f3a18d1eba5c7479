"""When a case has flown enough: once every requirement is decided, by its runs in order and by nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from lvnav_trade.campaign.definition.schema import Campaign, Requirement

Counts = tuple[int | None, ...]
"""Runs of a block beyond each requirement's bound; None where the case does not hold its metric."""


class BlockResult(NamedTuple):
    """A stored block: its first run, how many, and the runs beyond each requirement's bound."""

    first_run: int
    n_run: int
    counts: Counts


class Stopping:
    """Follows the blocks of every case and says which are still wanted.

    A look is taken after each block, in the order of the runs and however the blocks came in, so that the number of
    workers, or a campaign that was interrupted, changes nothing: blocks flown ahead of a decision are not counted.
    """

    def __init__(self, campaign: Campaign) -> None:
        card = campaign.monte_carlo
        assert card is not None
        self.most, self.block, self.requirements = card.runs, card.block, campaign.requirements
        self._counts: dict[str, dict[int, Counts]] = {}
        self._runs: dict[str, int] = {}

    @classmethod
    def of(cls, campaign: Campaign) -> Stopping | None:
        """Return the rule of a campaign; None where it flies the runs that it says."""
        card = campaign.monte_carlo
        return cls(campaign) if card is not None and card.stop is not None else None

    def note(self, case: str, block: BlockResult) -> None:
        """Take in a block of a case; one that is not whole is not looked at."""
        if block.n_run == self.block and case not in self._runs:
            self._counts.setdefault(case, {})[block.first_run] = block.counts
            decided = self._decided(case)
            if decided is not None:
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
        ordered: list[Counts] = []
        while len(ordered) * self.block in known:
            ordered.append(known[len(ordered) * self.block])
        found = [_decided(k, requirement, ordered, self.block) for k, requirement in enumerate(self.requirements)]
        runs = [one for one in found if one is not None]
        return min(max(runs), self.most) if runs and len(runs) == len(found) else None


def _decided(k: int, requirement: Requirement, blocks: Sequence[Counts], block: int) -> int | None:
    from lvnav_trade.metrics.requirements.sequential import decide

    total, failures = 0, []
    for counts in blocks:
        count = counts[k]
        if count is None:
            return None
        total += count
        failures.append(total)
    found = decide(failures, requirement.probability, requirement.confidence, block)
    return None if found.verdict == "undecided" else found.runs


def beyond(
    requirements: Sequence[Mapping[str, Any]], case: str, prepared: Any, covariance: Any, summary: Any
) -> Counts:
    """Return how many runs of a block are beyond each requirement's bound, as the verdicts will count them."""
    from lvnav_trade.metrics.requirements import requirements as verdicts
    from lvnav_trade.store.read import Tables
    from lvnav_trade.store.tables import requirement_tables

    tables = Tables.of(requirement_tables(case, prepared, covariance, summary))
    return tuple(verdicts.beyond(tables, case, requirement) for requirement in requirements)
