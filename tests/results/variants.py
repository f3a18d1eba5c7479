"""Results whose runs are those of other results, changed: candidates with a known difference."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from ruamel.yaml import YAML

from lvnav_trade.report.compare import keep_base
from lvnav_trade.results.tables.read import Tables, load
from tests import synthetic

Change = Callable[[pd.DataFrame], pd.DataFrame]


def variant(source: Tables, target: Path, **changes: Change) -> Tables:
    """Copy what a comparison reads and change tables, such as ``runs=worse(1.05)``; `campaign` takes the mapping."""
    synthetic.unsealed(keep_base(source, target))
    campaign = changes.pop("campaign", None)
    for name, change in changes.items():
        path = target / f"{name}.parquet"
        change(pd.read_parquet(path)).to_parquet(path, index=False)
    if campaign:
        path = target / "campaign.resolved.yaml"
        with path.open("w") as file:
            YAML(typ="safe", pure=True).dump(campaign(dict(source.campaign)), file)
    return load(target)


def errors(runs: pd.DataFrame) -> list[str]:
    """Return the columns of errors."""
    return [name for name in runs.columns if "_error_" in name]


def worse(factor: float, noise: float = 0.0) -> Change:
    """Multiply all errors, and each by a random factor of its own about one (one sigma `noise`)."""

    def change(runs: pd.DataFrame) -> pd.DataFrame:
        draw = np.random.default_rng(1).standard_normal((len(runs), 1))
        runs[errors(runs)] = runs[errors(runs)].to_numpy() * factor * (1.0 + noise * draw)
        return runs

    return change


def failing(numbers: tuple[int, ...]) -> Change:
    """Let runs fail."""

    def change(runs: pd.DataFrame) -> pd.DataFrame:
        runs.loc[runs.run_number.isin(numbers), "failure"] = "diverged"
        return runs

    return change


def relabelled(**names: str) -> Change:
    """Give levels of the axis imu other names."""

    def change(cases: pd.DataFrame) -> pd.DataFrame:
        for k, text in enumerate(cases["axes"]):
            level = names.get(json.loads(text)["imu"], json.loads(text)["imu"])
            cases.loc[k, "axes"], cases.loc[k, "label"] = json.dumps({"imu": level}), f"imu={level}"
        return cases

    return change
