"""Stage of a campaign that evaluates a design space, part by part, and selects designs for a full analysis."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa

from lvnav_trade.campaign.definition.axes import Case
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.running import work
from lvnav_trade.campaign.space.design_plan import Chosen, chosen
from lvnav_trade.campaign.space.evaluate_designs import HISTORY, EvaluatedDesigns, EvaluationRequest, evaluate
from lvnav_trade.campaign.space.numbered_designs import DesignBatch, DesignSpace
from lvnav_trade.campaign.space.passes import shared_axes
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.results.tables import design_tables as stored
from lvnav_trade.results.tables import scratch

PART = 100  # designs per work item
_SHOWN = 5  # largest number of reasons in a message

Stage = Callable[[str, Callable[..., Any], Sequence[tuple[Any, ...]]], Iterator[Any]]


class SpaceResult(NamedTuple):
    """Result of the stage.

    cases : Cases for a full analysis.
    remark : Entry of the manifest: numbers of designs, and of cases for a full analysis by reason.
    """

    cases: tuple[Case, ...]
    remark: dict[str, Any]


class SpaceEvaluation:
    """Design space of a campaign, evaluated while the campaign runs.

    campaign : A loaded campaign with a design space.
    """

    def __init__(self, campaign: Campaign) -> None:
        self.campaign = campaign
        self.designs = DesignSpace(campaign)

    def evaluate(self, job: work.Job, stage: Stage, parts: Sequence[int] | None = None) -> None:
        """Evaluate all designs that are not stored yet, or those of some parts; each part is stored when finished."""
        if parts is None and self._stored(job) is not None:
            return
        question = self._question
        order = self._order(question)
        wanted = range(self.parts) if parts is None else parts
        units = [
            (job, question, number, self.designs.part(order[number * PART : (number + 1) * PART])) for number in wanted
        ]
        for _ in stage("designs", evaluate_part, units):
            pass

    def finish(self, job: work.Job) -> SpaceResult:
        """Store the table of all designs; return the cases for a full analysis. InputError if all are impossible."""
        earlier = self._stored(job)
        if earlier is None:
            places = [_place(job, self._question, number) for number in range(self.parts)]
            rows = [scratch.read(file, EvaluatedDesigns, identity) for file, identity in places]
            identity = _identity(job, self._question, "designs")
            table = stored.table_of(rows, identity, sum(part.passes for part in rows))
        else:
            table = earlier
        impossible = stored.impossible(table)
        if len(impossible) and sum(impossible.values()) == len(self.designs):
            first = "; ".join(f"{reason} ({n})" for reason, n in list(impossible.items())[:_SHOWN])
            raise InputError(f"all {len(self.designs)} designs are impossible: {first}")
        found = chosen(table, self.campaign)
        if earlier is None:
            job.results.write_designs(table)
        remark = {
            "designs": len(self.designs),
            "impossible": impossible,
            "passes": stored.passes(table),
            "whole": {name: len(numbers) for name, numbers in found.items()},
        }
        return SpaceResult(self._whole(found), remark)

    @property
    def parts(self) -> int:
        """Number of work items."""
        return -(-len(self.designs) // PART)

    def count(self, parts: Sequence[int]) -> int:
        """Return the number of designs of some work items."""
        return sum(min(len(self.designs), (number + 1) * PART) - number * PART for number in parts)

    def names(self, folder: Path) -> list[str]:
        """Return the names of the evaluated parts in a folder of scratch files."""
        return sorted(path.name.partition(".")[0] for path in folder.glob("part-*.designs"))

    def _whole(self, found: Chosen) -> tuple[Case, ...]:
        numbers = dict.fromkeys(number for group in found.values() for number in group)
        return tuple(self.designs.case(number) for number in numbers)

    def _stored(self, job: work.Job) -> pa.Table | None:
        """Return the table of all designs of an earlier run, if it has the same origin."""
        return stored.earlier_table(job.results.folder / stored.FILE, _identity(job, self._question, "designs"))

    @cached_property
    def _question(self) -> EvaluationRequest:
        """Data to evaluate for every design."""
        requirements = self.campaign.requirements
        has_phase = any(requirement.during for requirement in requirements)
        history = self.campaign.keep.history if has_phase else HISTORY
        shared = shared_axes(self.designs, history)
        settings = tuple(requirement.model_dump(mode="json") for requirement in requirements)
        return EvaluationRequest(settings, history, shared, self.campaign.store == "events")

    def _order(self, question: EvaluationRequest) -> list[int]:
        """Return the numbers of the designs in an order in which designs that share passes are adjacent."""

        def others(number: int) -> tuple[str, ...]:
            labels = self.designs.labels(number)
            return tuple(label for axis, label in enumerate(labels) if axis not in question.shared)

        if not question.shared:
            return list(range(len(self.designs)))
        return sorted(range(len(self.designs)), key=others)


def _identity(job: work.Job, question: EvaluationRequest, name: str) -> str:
    """Return the origin of a part or table of designs, as text."""
    asked = hashlib.sha256(f"{job.request!r} {question!r}".encode()).hexdigest()[:16]
    return f"{job.results.identity_of_case(name)} {job.history!r} {asked}"


def _place(job: work.Job, question: EvaluationRequest, number: int) -> tuple[Path, str]:
    """Return the scratch file of a part, and its origin."""
    identity = _identity(job, question, f"part {number}")
    return job.scratch / f"part-{number:05d}.{identity.rpartition(' ')[2]}.designs", identity


def evaluate_part(job: work.Job, question: EvaluationRequest, number: int, part: DesignBatch) -> work.WorkOutcome:
    """Evaluate a part and write it to disk; an existing part is not evaluated again."""
    file, identity = _place(job, question, number)
    try:
        if not scratch.is_sound(file, EvaluatedDesigns, identity):
            scratch.write(file, evaluate(question, part), identity)
        return work.WorkOutcome(file.name, 0, len(part.numbers))
    except Exception as error:
        return work.WorkOutcome(file.name, 0, len(part.numbers), error=work.message_of(error))
