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
from lvnav_trade.campaign.space.design_plan import Selection, select_designs
from lvnav_trade.campaign.space.evaluate_designs import HISTORY, EvaluatedDesigns, EvaluationRequest, evaluate
from lvnav_trade.campaign.space.numbered_designs import DesignBatch, DesignSpace
from lvnav_trade.campaign.space.passes import shared_axes
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.results.tables import design_tables, scratch

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

    def evaluate(self, job: work.Job, stage: Stage, item_numbers: Sequence[int] | None = None) -> None:
        """Evaluate all designs that are not stored yet, or those of some parts; each part is stored when finished."""
        if item_numbers is None and self._earlier_table(job) is not None:
            return
        order = self._evaluation_order()
        items = []
        for number in range(self.item_count) if item_numbers is None else item_numbers:
            design_batch = self.designs.batch(order[number * PART : (number + 1) * PART])
            items.append((job, self._request, number, design_batch))
        for _ in stage("designs", evaluate_part, items):
            pass  # each worker stores its part

    def finish(self, job: work.Job) -> SpaceResult:
        """Store the table of all designs; return the cases for a full analysis. InputError if all are impossible."""
        stored_table = self._earlier_table(job)
        table = self._merged_table(job) if stored_table is None else stored_table
        impossible = design_tables.impossible_design_counts(table)
        if len(impossible) and sum(impossible.values()) == len(self.designs):
            most_frequent = list(impossible.items())[:_SHOWN]
            reasons = "; ".join(f"{reason} ({count})" for reason, count in most_frequent)
            raise InputError(f"all {len(self.designs)} designs are impossible: {reasons}")
        selection = select_designs(table, self.campaign)
        if stored_table is None:
            job.results.write_designs(table)
        remark = {
            "designs": len(self.designs),
            "impossible": impossible,
            "passes": design_tables.passes(table),
            "whole": {reason: len(numbers) for reason, numbers in selection.items()},
        }
        return SpaceResult(self._selected_cases(selection), remark)

    def _merged_table(self, job: work.Job) -> pa.Table:
        """Return the table of all designs from the stored parts."""
        evaluated_parts = []
        for number in range(self.item_count):
            file, identity = _part_file(job, self._request, number)
            evaluated_parts.append(scratch.read(file, EvaluatedDesigns, identity))
        n_passes = sum(designs.passes for designs in evaluated_parts)
        identity = _identity(job, self._request, "designs")
        return design_tables.table_of(evaluated_parts, identity, n_passes)

    @property
    def item_count(self) -> int:
        """Number of work items."""
        return -(-len(self.designs) // PART)

    def count(self, item_numbers: Sequence[int]) -> int:
        """Return the number of designs of some work items."""
        total = 0
        for number in item_numbers:
            end = min(len(self.designs), (number + 1) * PART)
            total += end - number * PART
        return total

    def names(self, folder: Path) -> list[str]:
        """Return the names of the evaluated parts in a folder of scratch files."""
        return sorted(path.name.partition(".")[0] for path in folder.glob("part-*.designs"))

    def _selected_cases(self, selection: Selection) -> tuple[Case, ...]:
        """Return the cases of the selected designs, each once."""
        numbers = dict.fromkeys(number for group in selection.values() for number in group)
        return tuple(self.designs.case(number) for number in numbers)

    def _earlier_table(self, job: work.Job) -> pa.Table | None:
        """Return the table of all designs of an earlier run, if it has the same origin."""
        return design_tables.earlier_table(
            job.results.folder / design_tables.FILE, _identity(job, self._request, "designs")
        )

    @cached_property
    def _request(self) -> EvaluationRequest:
        """Data to evaluate for every design."""
        requirements = self.campaign.requirements
        has_phase = any(requirement.during for requirement in requirements)
        history = self.campaign.keep.history if has_phase else HISTORY
        sigma_axes = shared_axes(self.designs, history)
        settings = tuple(requirement.model_dump(mode="json") for requirement in requirements)
        return EvaluationRequest(settings, history, sigma_axes, self.campaign.store == "events")

    def _evaluation_order(self) -> list[int]:
        """Return the numbers of the designs in an order in which designs that share passes are adjacent."""
        numbers = list(range(len(self.designs)))
        sigma_axes = self._request.sigma_axes

        def other_levels(number: int) -> tuple[str, ...]:
            labels = self.designs.labels(number)
            return tuple(label for axis, label in enumerate(labels) if axis not in sigma_axes)

        return sorted(numbers, key=other_levels) if sigma_axes else numbers


def _identity(job: work.Job, request: EvaluationRequest, name: str) -> str:
    """Return the origin of a part or table of designs, as text."""
    requests = f"{job.request!r} {request!r}"
    digest = hashlib.sha256(requests.encode()).hexdigest()[:16]
    return f"{job.results.identity_of_case(name)} {job.history_step!r} {digest}"


def _part_file(job: work.Job, request: EvaluationRequest, number: int) -> tuple[Path, str]:
    """Return the scratch file of a part, and its origin."""
    identity = _identity(job, request, f"part {number}")
    digest = identity.rpartition(" ")[2]
    return job.scratch / f"part-{number:05d}.{digest}.designs", identity


def evaluate_part(job: work.Job, request: EvaluationRequest, number: int, batch: DesignBatch) -> work.WorkOutcome:
    """Evaluate a part and write it to disk; an existing part is not evaluated again.

    Parameters
    ----------
    job : work.Job
        Data of the campaign for a worker.
    request : EvaluationRequest
        Data to evaluate.
    number : int
        Number of the part, from 0.
    batch : DesignBatch
        Designs of the part.

    Returns
    -------
    WorkOutcome
        Number of designs, and the error message if the part failed.
    """
    file, identity = _part_file(job, request, number)
    outcome = work.WorkOutcome(file.name, 0, len(batch.numbers))
    try:
        if not scratch.is_sound(file, EvaluatedDesigns, identity):
            scratch.write(file, evaluate(request, batch), identity)
        return outcome
    except Exception as error:
        return outcome._replace(error=work.message_of(error))
