"""Several interpretations of one table side by side: improvements on the raw sample, and on it without its bias."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.metrics.published.published import cases_of, ours
from lvnav_trade.store import Tables

COLUMNS = ["during", "error", "case", "stated_percent", "raw_percent", "unbiased_percent"]
_RAW, _UNBIASED = "raw_", "corrected_"


def interpretations(tables: Tables) -> pd.DataFrame:
    """Return improvements by phase, error and case, where the campaign's references hold estimates against raw samples.

    case is what sets a case apart from the others that are held so. stated_percent: what is stated of that case, NaN
    where nothing is. raw_percent: the filter's own sigma against that of the sample as it is, which is charged with its
    bias. unbiased_percent: against the sample less its estimated bias. Empty where nothing is held so.
    """
    held = [one for one in tables.campaign.get("references") or () if str(one.get("than") or "").startswith(_RAW)]
    stated: dict[tuple[str, str, str], float] = {}
    for one in held:
        for case in cases_of(tables, one.get("case") or {}):
            stated[str(one["during"]), str(one["metric"]), case] = float(one["value"])
    names = short_names(tables, list(dict.fromkeys(case for _, _, case in stated)))
    rows = []
    for during in dict.fromkeys(key[0] for key in stated):
        for metric in dict.fromkeys(key[1] for key in stated):
            for case, name in names.items():
                below = [_below(tables, case, metric, during, prefix) for prefix in (_RAW, _UNBIASED)]
                known = stated.get((during, metric, case), np.nan)
                rows.append((during, metric.replace("_error_", " "), name, known, *below))
    return pd.DataFrame(rows, columns=COLUMNS)


def _below(tables: Tables, case: str, metric: str, during: str, prefix: str) -> float:
    """Return by how many percent the filter's sigma of a metric is below that of the prefixed one."""
    asked: Mapping[str, Any] = {"metric": metric, "during": during, "statistic": "formal"}
    unit = "deg/h" if metric.startswith("rate") else "mg"
    estimate, sample = (ours(tables, case, {**asked, "metric": name}, unit).value for name in (metric, prefix + metric))
    return 100.0 * (1.0 - estimate / sample)


def short_names(tables: Tables, cases: Sequence[str]) -> dict[str, str]:
    """Return by case, of those given, the levels of the axes that set them apart."""
    axes = {row.case: json.loads(row.axes) for row in tables.cases.itertuples() if row.case in cases}
    differ = [axis for axis in next(iter(axes.values()), {}) if len({levels.get(axis) for levels in axes.values()}) > 1]
    return {case: ", ".join(axes[case][axis] for axis in differ) or tables.labels[case] for case in cases}
