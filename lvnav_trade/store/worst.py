"""The table of each run's largest and root mean square errors between events, for requirements over a phase."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lvnav_trade.engines.simulate.statistics import BlockSummary, columns
from lvnav_trade.records import Output
from lvnav_trade.store.schema import error_column, rms_column


def worst_table(
    outputs: tuple[Output, ...], summary: BlockSummary | None, failures: Mapping[int, str]
) -> dict[str, Any]:
    """Return the columns of `worst`: one row per run and span from an event to the next; none without runs.

    failures: the words for the codes of failed runs.
    """
    every = columns(outputs)
    names = [error_column(output.quantity, output.axis, output.unit) for output in every]
    means = [rms_column(output.quantity, output.axis, output.unit) for output in every]
    if summary is None:
        return {name: [] for name in ("run_number", "t_s", "t_end_s", "failure", *names, *means)}
    n_span = summary.worst.shape[1]
    content: dict[str, Any] = {
        "run_number": np.repeat(summary.runs, n_span),
        "t_s": np.tile(summary.t_bound[:-1], summary.n_run),
        "t_end_s": np.tile(summary.t_bound[1:], summary.n_run),
        "failure": [failures.get(int(code), f"code {code}") for code in summary.failed for _ in range(n_span)],
    }
    content |= {name: summary.worst[:, :, k].ravel() for k, name in enumerate(names)}
    return content | {name: np.sqrt(summary.mean_square[:, :, k]).ravel() for k, name in enumerate(means)}
