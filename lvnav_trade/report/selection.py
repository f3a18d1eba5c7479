"""Selection of the cases that have figures, and notes on the others."""

import hashlib
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.quantities.state_layout import split_metric
from lvnav_trade.report.blocks import Block, Text, row_numbers
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.requirements.margins import key_cases
from lvnav_trade.results.statistics.select import NAVIGATION
from lvnav_trade.results.tables.read import Tables

MOST_CASES = 8
"""Largest number of cases with figures of their own; of more cases, the key cases and the best have figures."""


def chosen_cases(tables: Tables) -> dict[str, str]:
    """Return the cases with figures of their own, label by digest, in the order of the plan."""
    if len(tables.labels) <= MOST_CASES:
        return tables.labels
    order = [*key_cases(tables), *METRICS["ranking"](tables).case]
    selection = list(dict.fromkeys(order))[:MOST_CASES]
    return {case: label for case, label in tables.labels.items() if label in selection}


def key_cases_and_quantities(tables: Tables) -> tuple[list[str], list[str]]:
    """Return the cases (digests) and the quantities that decide the requirements; they are shown in the open sections.

    Without requirements: the best case, and all quantities.
    """
    required_quantities = []
    for requirement in tables.campaign.get("requirements") or ():
        quantity, _ = split_metric(str(requirement["metric"]))
        required_quantities.append(quantity.removeprefix("normalised_"))
    available = [quantity for quantity in NAVIGATION if (quantity, "3d") in tables.display_units]
    quantities = [quantity for quantity in available if quantity in required_quantities]
    labels = list(key_cases(tables))
    if not labels:
        ranking = METRICS["ranking"](tables)
        labels = list(ranking.case[:1])
    digests = {label: case for case, label in tables.labels.items()}
    cases = [digests[label] for label in labels]
    return cases, quantities or available


def omission_note(tables: Tables) -> list[Block]:
    """Return a note on the cases without figures; empty if every case has figures."""
    n_more = len(tables.labels) - len(chosen_cases(tables))
    if n_more <= 0:
        return []
    text = f"The decisive cases and the best ones are shown, {MOST_CASES} in all; {n_more} more are in the tables."
    return [Text(text)]


def distinct_cases(tables: Tables, name: str, columns: Sequence[str], cases: Iterable[str]) -> list[str]:
    """Return one case of each group of cases that have equal rows in a table.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    name : str
        Name of the table.
    columns : sequence of str
        Columns that are compared.
    cases : iterable of str
        Digests of the cases.
    """
    frame = getattr(tables, name)
    values = [_numbers(frame[column]) for column in columns]
    places = row_numbers(frame.case)
    first: dict[bytes, str] = {}
    for case in cases:
        case_places = places.get(case, np.empty(0, dtype=int))
        content = b"".join(column[case_places].tobytes() for column in values)
        checksum = hashlib.sha256(content).digest()
        first.setdefault(checksum, case)
    return list(first.values())


def _numbers(column: pd.Series) -> Any:
    """Return a column (n_row,) as numbers; equal texts become equal numbers."""
    if pd.api.types.is_numeric_dtype(column):
        return column.to_numpy()
    numbers, _ = pd.factorize(column)
    return numbers


def first_cases(group: Sequence[str]) -> tuple[Sequence[str], list[Block]]:
    """Return at most as many cases as are drawn, and a note on the others."""
    n_more = len(group) - MOST_CASES
    remark: list[Block] = []
    if n_more > 0:
        remark.append(Text(f"{n_more} more cases that differ here are in the tables."))
    return group[:MOST_CASES], remark
