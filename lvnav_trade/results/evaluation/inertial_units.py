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
    factors = {si: factor for si, (_, factor) in _PEOPLE.items()}
    factor = rows.unit.map(factors).astype(float)
    deviations = rows.assign(
        case=rows.case.map(tables.labels),
        unit=rows.unit.map({si: unit for si, (unit, _) in _PEOPLE.items()}),
        ratio=rows.simulated_si / rows.card_si,
        simulated=rows.simulated_si * factor,
        card=rows.card_si * factor,
        white_noise=rows.white_noise_si * factor,
        bias_instability=rows.bias_instability_si * factor,
        random_walk=rows.random_walk_si * factor,
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
    rows = []
    decisions = tables.integrity[tables.integrity.isolated_element == "unit"]
    for (case, unit), exclusion in decisions.groupby(["case", "channel"], sort=False):
        fault_rows = faults(tables, str(case))
        runs = int(pick(tables.cases, case=str(case)).run_count.iloc[0])
        count = exclusion.run_number.nunique()
        low, high = success_bounds(runs, runs - count, 0.975)
        t = float(exclusion.t_s.median())
        is_after_fault = len(fault_rows) and t >= fault_rows.t_s.iloc[0]
        row = {
            "case": tables.labels[str(case)],
            "unit": unit,
            "faults": ", ".join(fault_rows.event),
            "run_count": runs,
            "excluded_count": count,
            "share_ratio": count / runs,
            "low_ratio": low,
            "high_ratio": high,
            "t_s": t,
            "after_s": t - float(fault_rows.t_s.iloc[0]) if is_after_fault else np.nan,
        }
        rows.append(row)
    return pd.DataFrame(rows, columns=EXCLUDED)
