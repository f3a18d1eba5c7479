"""Inertial units: Allan deviation of a simulated stream beside the curve of the card; units that a test excludes."""

import numpy as np
import pandas as pd

from lvnav_trade.metrics.basics.probability import success_bounds
from lvnav_trade.metrics.basics.select import faults, pick
from lvnav_trade.store.read import Tables

COLUMNS = ["case", "sensor", "unit", "tau_s", "stream", "card", "ratio", "white", "instability", "walk"]
_PEOPLE = {"rad/s": ("deg/h", 206264.80624709636), "m/s^2": ("mg", 1e3 / 9.80665)}


def allan(tables: Tables) -> pd.DataFrame:
    """Return Allan deviations over the averaging time: of the stream, of the card, their ratio, and the card's parts
    (white noise with quantisation, bias instability, random walk), in deg/h and mg.
    """
    rows = tables.allan
    factor = rows.unit.map(lambda unit: _PEOPLE[unit][1]).astype(float)
    found = rows.assign(
        case=rows.case.map(tables.labels),
        unit=rows.unit.map(lambda unit: _PEOPLE[unit][0]),
        ratio=rows.stream_si / rows.card_si,
        **{name: rows[f"{name}_si"] * factor for name in ("stream", "card", "white", "instability", "walk")},
    )
    return found[COLUMNS].reset_index(drop=True)


EXCLUDED = [
    "case",
    "unit",
    "faults",
    "run_count",
    "excluded_count",
    "share_ratio",
    "low_ratio",
    "high_ratio",
    "t_s",
    "after_s",
]


def exclusions(tables: Tables) -> pd.DataFrame:
    """Return which inertial units their test against each other has excluded: share of the runs with its exact interval
    (95 %), median time, and time after the first fault of the case (NaN before one, or without).
    """
    rows = tables.integrity[tables.integrity.isolated == "unit"]
    found = []
    for (case, unit), chosen in rows.groupby(["case", "channel"], sort=False):
        known, runs = faults(tables, str(case)), int(pick(tables.cases, case=str(case)).run_count.iloc[0])
        count, t = chosen.run_number.nunique(), float(chosen.t_s.median())
        after = t - float(known.t_s.iloc[0]) if len(known) and t >= known.t_s.iloc[0] else np.nan
        low, high = success_bounds(runs, runs - count, 0.975)
        names = ", ".join(known.event)
        found.append((tables.labels[str(case)], unit, names, runs, count, count / runs, low, high, t, after))
    return pd.DataFrame(found, columns=EXCLUDED)
