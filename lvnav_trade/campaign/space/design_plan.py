"""Time, disk and memory of a design space, and selection of the designs for a full analysis."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from lvnav_trade.campaign.definition.axes import cases, probes
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.running.plan import covariance_seconds, estimate
from lvnav_trade.campaign.space.numbered_designs import DesignSpace
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.records import Floats, Ints
from lvnav_trade.results.evaluation.resources import dominating
from lvnav_trade.results.metric import NAVIGATION_UNITS

AT_RANDOM = 8
"""Number of randomly drawn designs whose runs check linear covariance."""

Selection = dict[str, list[int]]
"""Numbers of the selected designs, by reason."""


def select_designs(table: pa.Table, campaign: Campaign) -> Selection:
    """Select designs of a campaign for a full analysis, from the table of all designs.

    The selection has the best design; with a spot check random designs; with Monte Carlo the designs on the Pareto
    front, or those whose largest error is closest to its limit.
    """
    case = np.array(table["case"].to_pylist())
    possible = np.flatnonzero(case != "")
    numbers = table["design_number"].to_numpy()
    ratio = _column(table, "error_ratio")
    best = _best_row(table, possible, ratio)
    selection: Selection = {"best": numbers[best].tolist()}
    if campaign.covariance.spot_check:
        rng = np.random.default_rng([campaign.seed, len(possible)])
        n_sample = min(AT_RANDOM, len(possible))
        sample = np.sort(rng.choice(possible, n_sample, replace=False))
        selection["at random"] = numbers[sample].tolist()
    card = campaign.monte_carlo
    if card is not None:
        candidates = front_rows(table, possible) if card.cases == "front" else nearest_rows(possible, ratio)
        selected_rows = candidates[: card.case_limit]
        selection[card.cases or "undecided"] = numbers[selected_rows].tolist()
    return selection


def _column(table: pa.Table, name: str) -> Floats:
    """Return a column of numbers; all NaN if the table does not have it."""
    if name not in table.column_names:
        return np.full(table.num_rows, np.nan)
    return np.asarray(table[name].to_numpy(), dtype=float)


def _best_row(table: pa.Table, possible: Ints, ratio: Floats) -> Ints:
    """Return the row with the smallest ratio of error to limit; without requirements the smallest velocity error."""
    value = ratio if np.isfinite(ratio[possible]).any() else _column(table, "velocity_m_per_s")
    evaluated_rows = possible[np.isfinite(value[possible])]
    if not len(evaluated_rows):
        return possible[:1]
    ascending = np.argsort(value[evaluated_rows], kind="stable")
    return evaluated_rows[ascending][:1]


def nearest_rows(possible: Ints, ratio: Floats) -> Ints:
    """Return the rows sorted by the distance of the largest error from its limit, as |log(error / limit)|.

    Parameters
    ----------
    possible : (m,) array of int
        Rows of the possible designs.
    ratio : (n,) array
        Largest ratio of error to limit, by row.
    """
    possible_ratio = ratio[possible]
    has_logarithm = np.isfinite(possible_ratio) & (possible_ratio > 0.0)
    evaluated_rows = possible[has_logarithm]
    distance = np.abs(np.log(ratio[evaluated_rows]))
    return evaluated_rows[np.argsort(distance, kind="stable")]


def front_rows(table: pa.Table, possible: Ints) -> Ints:
    """Return the rows on the Pareto front of error and totals of the devices, sorted by the error over its limit."""
    names = ["error_ratio", "cost", "mass_kg", "power_w", "volume_m3"]
    columns = [_column(table, name)[possible] for name in names]
    criteria = [column for column in columns if np.isfinite(column).any()]
    if not criteria:
        return possible
    values = np.stack(criteria, axis=1)
    is_complete = np.isfinite(values).all(axis=1)
    rows = possible[is_complete]
    values = values[is_complete]
    on_front = np.array([dominating(values, k) < 0 for k in range(len(rows))], dtype=bool)
    ascending = np.argsort(values[on_front, 0], kind="stable")
    return rows[on_front][ascending]


# Measured on one core of a small virtual machine: time of preparation, metrics and row of a design, in addition to its
# covariance; memory per design of the process that distributes them
_DESIGN_S, _DESIGN_BYTES = 0.035, 6e3
# Bytes of a design on disk: table and CSV table; report; until the end the part in which it was evaluated
_ROW_BYTES, _PAGE_BYTES, _PART_BYTES = 1020.0, 150.0, 1160.0
_EVENT_BYTES, _EVENT_PART_BYTES = 27.0, 8.0  # bytes of one more number, in the tables and in the part
_CASE_TABLES = 2.0  # size of the tables of single cases until the end, over that of the final tables


class DesignsPlan(NamedTuple):
    """Estimated cost of a design space.

    store : Data stored for each design: metrics or events.
    designs : Number of designs.
    whole : Largest number of designs with a full analysis.
    runs : Largest number of runs of these together.
    seconds : Time (s) on one core, without compilation.
    disk_mb : Size (MB) of the results.
    most_mb : Peak size (MB) on disk, before parts, blocks of runs and tables of single designs are removed.
    memory_mb : Memory (MB) of the process that distributes the designs.
    seconds_of_designs : Part of `seconds` for the rows.
    """

    store: str
    designs: int
    whole: int
    runs: int
    seconds: float
    disk_mb: float
    most_mb: float
    memory_mb: float
    seconds_of_designs: float


def estimate_designs(campaign: Campaign, folder: Path, flights: Mapping[str, Mapping[str, float]]) -> DesignsPlan:
    """Estimate the cost of a design space, with one covariance pass per design; shared passes take less time.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    folder : Path
        Folder of its results, which need not exist.
    flights : mapping of str to mapping of str to float
        Times (s) of the events by digest of the case and by name; the first and last give the duration.
    """
    n_designs = len(DesignSpace(campaign))
    duration = max(max(times.values()) - min(times.values()) for times in flights.values())
    probe_cases = probes(campaign)
    probe_seconds = sum(covariance_seconds(case, duration) for case in probe_cases)
    row_seconds = n_designs * (probe_seconds / len(probe_cases) + _DESIGN_S)
    card = campaign.monte_carlo
    selected_count = 1
    if campaign.covariance.spot_check:
        selected_count += AT_RANDOM
    if card is not None:
        selected_count += card.case_limit
    selected_count = min(selected_count, n_designs)
    one_design = campaign.probe.model_copy(update={"axes": (), "design": "grid", "references": ()})
    per_case = estimate(one_design, folder, {case.id: duration for case in cases(one_design)})
    event_numbers = _event_numbers(campaign, flights)
    table_bytes = selected_count * 1e6 * (per_case.disk_mb - per_case.blocks_mb)
    final_bytes = n_designs * (_ROW_BYTES + _PAGE_BYTES + event_numbers * _EVENT_BYTES) + table_bytes
    temporary_bytes = n_designs * (_PART_BYTES + event_numbers * _EVENT_PART_BYTES)
    temporary_bytes += selected_count * 1e6 * per_case.blocks_mb + _CASE_TABLES * table_bytes
    return DesignsPlan(
        store=str(campaign.store),
        designs=n_designs,
        whole=selected_count,
        runs=selected_count * card.runs if card is not None else 0,
        seconds=row_seconds + selected_count * per_case.seconds,
        disk_mb=final_bytes / 1e6,
        most_mb=(final_bytes + temporary_bytes) / 1e6,
        memory_mb=per_case.memory_mb + n_designs * _DESIGN_BYTES / 1e6,
        seconds_of_designs=row_seconds,
    )


def _event_numbers(campaign: Campaign, flights: Mapping[str, Mapping[str, float]]) -> int:
    """Return the number of columns of a row that are errors at events, all events together."""
    if campaign.store != "events":
        return 0
    n_events = max(map(len, flights.values()))
    at_events = sum(requirement.at is not None for requirement in campaign.requirements)
    return n_events * (len(NAVIGATION_UNITS) + at_events)


def refuse_too_large(plan: DesignsPlan, folder: Path) -> None:
    """Raise an InputError if the disk of a folder or the memory is too small for a planned design space."""
    place = folder
    if not folder.exists():  # the results will be in its first parent that exists
        place = next(path for path in folder.absolute().parents if path.exists())
    free = shutil.disk_usage(place).free / 1e6
    if plan.most_mb > free:
        raise InputError(f"{plan.designs} designs take about {plan.most_mb:.0f} MB of disk; {free:.0f} MB are free")
    memory = _memory_mb()
    if plan.memory_mb > memory:
        raise InputError(
            f"{plan.designs} designs take about {plan.memory_mb:.0f} MB of memory; there are {memory:.0f} MB"
        )


def _memory_mb() -> float:
    """Return the memory of this machine (MB); infinite if it is not known."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e6
    except (AttributeError, OSError, ValueError):
        return float("inf")
