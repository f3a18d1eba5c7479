"""The table of many designs, from the parts in which they were evaluated."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from lvnav_trade.store.columns import column
from lvnav_trade.store.schema import arrow_schema

FILE = "designs.parquet"
_IDENTITY, _PASSES = b"lvnav_trade.identity", b"lvnav_trade.passes"


def table_of(parts: Sequence[Any], identity: str, passes: int) -> pa.Table:
    """Return the table `designs` of parts, each with number (n,), texts and numbers by column, in the order of the
    designs' numbers. A column that a part lacks is empty there.

    identity : What the designs are computed from, for `earlier_table`.
    passes : Passes of linear covariance that they took.
    """
    number = np.concatenate([one.number for one in parts])
    order = np.argsort(number, kind="stable")
    names = list(dict.fromkeys(name for one in parts for name in one.numbers))
    schema = arrow_schema("designs", tuple(names))
    found: dict[str, Any] = {"design_number": number[order]}
    for field in schema:
        if field.name in found:
            continue
        if field.type == pa.string():
            texts = [text for one in parts for text in one.texts[field.name]]
            found[field.name] = [texts[k] for k in order]
        else:
            empty = [one.numbers.get(field.name, np.full(len(one.number), np.nan)) for one in parts]
            found[field.name] = np.concatenate(empty)[order]
    table = pa.table([column(found[field.name], field.type) for field in schema], schema=schema)
    return table.replace_schema_metadata({_IDENTITY: identity, _PASSES: str(passes)})


def earlier_table(file: Path, identity: str) -> pa.Table | None:
    """Return the table in a file; None where there is none, it is damaged, or it was computed from something else."""
    try:
        table = pq.read_table(file, page_checksum_verification=True)
    except (OSError, pa.ArrowException):
        return None
    return table if (table.schema.metadata or {}).get(_IDENTITY) == identity.encode() else None


def passes(table: pa.Table) -> int:
    """Return how many passes of linear covariance the designs of a table took."""
    return int(table.schema.metadata[_PASSES])


def impossible(table: pa.Table) -> dict[str, int]:
    """Return how many designs have no numbers, by why, the most frequent reason first."""
    pairs = zip(table["case"].to_pylist(), table["reason"].to_pylist(), strict=True)
    return dict(Counter(reason for case, reason in pairs if not case).most_common())
