"""Parquet tables: what a campaign leaves on disk (schema), how it is written and read back.

While a campaign runs: ``results = open_results(folder, name, resolved_yaml, manifest, "resume")``; each worker calls
``results.write_part(case_id, summary)`` (or ``parts.write`` where the object is not at hand); at the end, in the order
of the plan, ``results.write_case(case, prepared, cov, results.parts(case_id))`` and ``results.finish({...})``.
Afterwards: ``tables = load(folder)``; ``tables.history`` is a pandas frame.
"""

from typing import TYPE_CHECKING, Any

from lvnav_trade.store.schema import TABLES
from lvnav_trade.store.write import CaseInfo, Results, open_results

if TYPE_CHECKING:
    from lvnav_trade.store.read import Tables, load

__all__ = ["TABLES", "CaseInfo", "Results", "Tables", "load", "open_results"]


def __getattr__(name: str) -> Any:
    """Import what reads only when it is asked for: a worker that writes need not hold pandas in memory."""
    if name in ("Tables", "load"):
        from lvnav_trade.store import read

        return getattr(read, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
