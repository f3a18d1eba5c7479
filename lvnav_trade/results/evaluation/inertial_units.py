"""IMUs: Allan deviation of a simulated stream compared with the card's, and IMUs that a test excludes."""

import numpy as np
import pandas as pd

from lvnav_trade.results.statistics.probability import success_bounds
from lvnav_trade.results.statistics.select import faults, pick
from lvnav_trade.results.tables.read import Tables

COLUMNS = [
    "case",
    "sensor",
    "unit",
    "tau_s",
    "simulated",
    "card",
    "ratio",
    "white_noise",
    "bias_instability",
    "random_walk",
]
_PEOPLE = {"rad/s": ("deg/h", 206264.80624709636), "m/s^2": ("mg", 1e3 / 9.80665)}


def allan(tables: Tables) -> pd.DataFrame:
    """Return Allan deviations over the averaging time, simulated and of the card, in deg/h and mg.

    ratio: simulated over card. white_noise, bias_instability, random_walk: contributions to that of the card.
    white_noise includes quantisation.
    """
    rows = tables.allan
    factor = rows.unit.map(lambda unit: _PEOPLE[unit][1]).astype(float)
    deviations = rows.assign(
        case=rows.case.map(tables.labels),
        unit=rows.unit.map(lambda unit: _PEOPLE[unit][0]),
        ratio=rows.simulated_si / rows.card_si,
        **{
            name: rows[f"{name}_si"] * factor
            for name in ("simulated", "card", "white_noise", "bias_instability", "random_walk")
        },
    )
    return deviations[COLUMNS].reset_index(drop=True)


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
    """Return the IMUs that the test between IMUs excludes.

    share_ratio, low_ratio, high_ratio: fraction of the runs in which the IMU is excluded, with its exact 95 % interval.
    t_s: median time of the exclusion. after_s: this time minus that of the first fault of the case; NaN if there is no
    fault before.
    """
    rows = tables.integrity[tables.integrity.isolated_element == "unit"]
    excluded = []
    for (case, unit), chosen in rows.groupby(["case", "channel"], sort=False):
        of_case, runs = faults(tables, str(case)), int(pick(tables.cases, case=str(case)).run_count.iloc[0])
        count, t = chosen.run_number.nunique(), float(chosen.t_s.median())
        after = t - float(of_case.t_s.iloc[0]) if len(of_case) and t >= of_case.t_s.iloc[0] else np.nan
        low, high = success_bounds(runs, runs - count, 0.975)
        names = ", ".join(of_case.event)
        excluded.append((tables.labels[str(case)], unit, names, runs, count, count / runs, low, high, t, after))
    return pd.DataFrame(excluded, columns=EXCLUDED)
