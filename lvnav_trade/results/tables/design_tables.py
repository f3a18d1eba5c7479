"""Table of a design space, from the parts in which the designs were evaluated."""

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


def table_of(parts: Sequence[Any], identity: str, passes: int) -> pa.Table:
    """Return the table `designs`, in the order of the designs' numbers.

    Parameters
    ----------
    parts : sequence of evaluate.EvaluatedDesigns
        Evaluated designs: number (n,), texts and numbers by column. A column missing in a part is empty there.
    identity : str
        Origin of the designs, for `earlier_table`.
    passes : int
        Number of covariance passes that were computed.
    """
    number = np.concatenate([part.number for part in parts])
    order = np.argsort(number, kind="stable")
    names = list(dict.fromkeys(name for part in parts for name in part.numbers))
    schema = arrow_schema("designs", tuple(names))
    columns: dict[str, Any] = {"design_number": number[order]}
    for field in schema:
        if field.name in columns:
            continue
        if field.type == pa.string():
            texts = [text for part in parts for text in part.texts[field.name]]
            columns[field.name] = [texts[k] for k in order]
        else:
            numbers = [part.numbers.get(field.name, np.full(len(part.number), np.nan)) for part in parts]
            columns[field.name] = np.concatenate(numbers)[order]
    table = pa.table([column(columns[field.name], field.type) for field in schema], schema=schema)
    return table.replace_schema_metadata({_IDENTITY: identity, _PASSES: str(passes)})


def earlier_table(file: Path, identity: str) -> pa.Table | None:
    """Return the table in a file; None if the file is missing or damaged, or the table has another origin."""
    try:
        table = pq.read_table(file, page_checksum_verification=True)
    except (OSError, pa.ArrowException):
        return None
    return table if (table.schema.metadata or {}).get(_IDENTITY) == identity.encode() else None


def passes(table: pa.Table) -> int:
    """Return the number of covariance passes that were computed for a table."""
    return int(table.schema.metadata[_PASSES])


def impossible(table: pa.Table) -> dict[str, int]:
    """Return the number of impossible designs by reason, the most frequent reason first."""
    pairs = zip(table["case"].to_pylist(), table["reason"].to_pylist(), strict=True)
    return dict(Counter(reason for case, reason in pairs if not case).most_common())
