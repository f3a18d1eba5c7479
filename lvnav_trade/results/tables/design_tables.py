"""Table of a design space, from the work items in which the designs were evaluated."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from lvnav_trade.results.tables.dictionary import arrow_schema
from lvnav_trade.results.tables.table_files import column

FILE = "designs.parquet"
_IDENTITY, _PASSES = b"lvnav_trade.identity", b"lvnav_trade.passes"


def table_of(evaluated_designs: Sequence[Any], identity: str, passes: int) -> pa.Table:
    """Return the table `designs`, in the order of the designs' numbers.

    Parameters
    ----------
    evaluated_designs : sequence of evaluate_designs.EvaluatedDesigns
        Evaluated designs by work item: design_number (n,), texts and number_columns by column. A column missing in an
        item is empty there.
    identity : str
        Origin of the designs, for `earlier_table`.
    passes : int
        Number of covariance passes that were computed.
    """
    number = np.concatenate([designs.design_number for designs in evaluated_designs])
    order = np.argsort(number, kind="stable")
    number_columns: dict[str, None] = {}  # names in order of their first item
    for designs in evaluated_designs:
        number_columns |= dict.fromkeys(designs.number_columns)
    schema = arrow_schema("designs", tuple(number_columns))
    arrays = []
    for field in schema:
        values: Any
        if field.name == "design_number":
            values = number[order]
        elif field.type == pa.string():
            texts: list[str] = []
            for designs in evaluated_designs:
                texts += designs.texts[field.name]
            values = [texts[k] for k in order]
        else:
            missing = [np.full(len(designs.design_number), np.nan) for designs in evaluated_designs]
            numbers = []
            for designs, nan in zip(evaluated_designs, missing, strict=True):
                numbers.append(designs.number_columns.get(field.name, nan))
            values = np.concatenate(numbers)[order]
        arrays.append(column(values, field.type))
    table = pa.table(arrays, schema=schema)
    return table.replace_schema_metadata({_IDENTITY: identity, _PASSES: str(passes)})


def earlier_table(file: Path, identity: str) -> pa.Table | None:
    """Return the table in a file; None if the file is missing or damaged, or the table has another origin."""
    try:
        table = pq.read_table(file, page_checksum_verification=True)
    except (OSError, pa.ArrowException):
        return None
    metadata = table.schema.metadata or {}
    if metadata.get(_IDENTITY) != identity.encode():
        return None
    return table


def passes(table: pa.Table) -> int:
    """Return the number of covariance passes that were computed for a table."""
    return int(table.schema.metadata[_PASSES])


def impossible_design_counts(table: pa.Table) -> dict[str, int]:
    """Return the number of impossible designs by reason, the most frequent reason first."""
    counts: Counter[str] = Counter()
    for case, reason in zip(table["case"].to_pylist(), table["reason"].to_pylist(), strict=True):
        if not case:
            counts[reason] += 1
    return dict(counts.most_common())
