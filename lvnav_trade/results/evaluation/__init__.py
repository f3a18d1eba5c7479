"""Metrics of results. Each metric is an object in `registry`; `METRICS` has the computed tables by name.

Read `metric.py` first, then `results/metrics/state_errors.py` and `results/requirements/requirements.py`.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lvnav_trade.results.evaluation.computed_tables import CSV as CSV
    from lvnav_trade.results.evaluation.computed_tables import METRICS as METRICS


def __getattr__(name: str) -> Any:
    """Import the tables on first use, because worker processes and the reading of campaigns need no pandas."""
    import importlib

    if name in ("CSV", "METRICS"):
        return getattr(importlib.import_module("lvnav_trade.results.evaluation.computed_tables"), name)
    raise AttributeError(f"module 'lvnav_trade.results.evaluation' has no attribute {name!r}")
