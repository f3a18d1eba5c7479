"""Sections on the satellites: geometry and signals, tracking, atmospheric delays and latency."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.report.blocks import (
    Block,
    Picture,
    Text,
    case_sentence,
    figures,
    formatted_table,
    number,
    table,
)
from lvnav_trade.report.escape import note
from lvnav_trade.report.figures import PLOTS
from lvnav_trade.report.figures.signals import LAYERS, layers_of
from lvnav_trade.report.selection import distinct_cases, first_cases
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.statistics.select import pick, pick_columns
from lvnav_trade.results.tables.read import Tables

_CURRENT = 1e-6  # s, largest age of data that count as current


_DELAYS = [f"{layer}{suffix}_m" for layer in LAYERS for suffix in ("", "_left")]  # columns of the table `satellites`


def satellites(tables: Tables) -> list[Block]:
    """Return the satellites in view with their C/N0, and the sky plot, once for each distinct geometry."""
    columns = ["t_s", "satellite", "tracked", "state", "cn0_db_hz", "antenna_number"]
    group, blocks = first_cases(distinct_cases(tables, "satellites", columns, tables.labels))
    for index, case in enumerate(group, 1):
        rows = pick(tables.satellites, case=case)
        label = case_sentence(tables, case, group)
        signal = " and their C/N0" if rows.cn0_db_hz.notna().any() else ""
        blocks += [
            Picture(
                f"satellites-{index}",
                PLOTS["satellites"](tables, case),
                note("satellites", "figures", signal=signal) + label,
            ),
            Picture(
                f"sky-{index}",
                PLOTS["sky"](tables, case),
                note("sky", "figures") + label,
            ),
            *_signal_table(rows, label),
        ]
    return blocks


def _signal_table(rows: pd.DataFrame, label: str) -> list[Block]:
    """Return the ranges of elevation, C/N0 and noise of each tracked satellite; empty without a link budget.

    rows : rows of the table `satellites` for one case
    """
    tracked_rows = rows[rows.tracked & rows.cn0_db_hz.notna()]
    if tracked_rows.empty:
        return []
    tracked_rows = tracked_rows.assign(elevation_deg=np.degrees(tracked_rows.elevation_rad))
    groups = tracked_rows.groupby("satellite")
    frame = pd.DataFrame(
        {
            "tracked from (s)": groups.t_s.min().map("{:.0f}".format),
            "to (s)": groups.t_s.max().map("{:.0f}".format),
            "elevation (deg)": _range(groups.elevation_deg, 0),
            "antennas": groups.antenna_number.unique().map(_sorted_text),
            "C/N0 (dB-Hz)": _range(groups.cn0_db_hz, 1),
            "range noise (m)": _range(groups.range_sigma_m, 2),
            "rate noise (m/s)": _range(groups.rate_sigma_m_per_s, 3),
        }
    )
    caption = f"Smallest and largest values for each satellite while it is tracked; noise is one sigma.{label}"
    return [table(frame.rename_axis("satellite").reset_index(), caption)]


def _sorted_text(values: Iterable[Any]) -> str:
    return ", ".join(map(str, sorted(values)))


def _range(groups: Any, digits: int) -> pd.Series:
    """Return the smallest and the largest value of each group as text; a single number if they are equal.

    groups : grouped column of numbers
    digits : number of decimals
    """
    to_text = f"{{:.{digits}f}}".format
    low = groups.min().map(to_text)
    high = groups.max().map(to_text)
    return low.where(low == high, low + " to " + high)


def tracking(tables: Tables) -> list[Block]:
    """Return channel states of every satellite, fixes, losses of lock by reason, and recovery after every fault.

    The result is empty if no receiver models channels and no fault affects satellites.
    """
    changes = METRICS["transitions"](tables)
    if changes.empty and not (METRICS["recovery"](tables).lost_count > 0).any():
        return []
    blocks: list[Block] = []
    for name in ("tracking", "losses", "recovery"):
        frame = METRICS[name](tables)
        if len(frame):
            blocks.append(formatted_table(name, frame, combines_cases=True))
    columns = ["t_s", "satellite", "tracked", "state"]
    group, remark = first_cases(distinct_cases(tables, "satellites", columns, tables.labels))
    blocks += [*remark, *figures(tables, "timeline", group)]
    if len(changes):
        blocks.append(Text(note("searches")))
    return blocks


def delays(tables: Tables) -> list[Block]:
    """Return atmospheric delays, the residual delays after correction, and the latency; empty if there are none."""
    cases_with_delay = [case for case in tables.labels if _layers(tables, case)]
    distinct_delays = distinct_cases(tables, "satellites", ["t_s", "satellite", *_DELAYS], cases_with_delay)
    group, blocks = first_cases(distinct_delays)
    if group:
        blocks.append(_delay_table(tables))
    blocks += figures(tables, "delays", group)
    has_latency = tables.satellites.latency_s > _CURRENT
    with_latency = set(tables.satellites.case[has_latency])
    cases_with_latency = [case for case in tables.labels if case in with_latency]
    distinct_latencies = distinct_cases(tables, "satellites", ["t_s", "latency_s"], cases_with_latency)
    group, remark = first_cases(distinct_latencies)
    pictures = figures(tables, "latency", group)
    return [*blocks, *remark, *pictures]


def _layers(tables: Tables, case: str) -> list[str]:
    """Return the atmospheric layers with a delay or a correction in a case."""
    columns = pick_columns(tables.satellites, _DELAYS, case=case)
    return layers_of(pd.DataFrame(dict(zip(_DELAYS, columns, strict=True))))


def _delay_table(tables: Tables) -> Block:
    """Return the table of true and residual delays by case and layer."""
    rows = []
    for case, label in tables.labels.items():
        tracked_rows = tables.satellites[(tables.satellites.case == case) & tables.satellites.tracked]
        for layer in _layers(tables, case):
            true_delay = tracked_rows[f"{layer}_m"]
            residual_delay = tracked_rows[f"{layer}_left_m"]
            worst_row = tracked_rows.loc[residual_delay.abs().idxmax()]
            rows.append(
                (
                    label,
                    layer,
                    f"{number(round(true_delay.min(), 6))} to {number(true_delay.max())}",
                    float((true_delay**2).mean() ** 0.5),
                    float((residual_delay**2).mean() ** 0.5),
                    float(residual_delay.mean()),
                    residual_delay[worst_row.name],
                    f"{worst_row.satellite} at {worst_row.t_s:.0f} s, {np.degrees(worst_row.elevation_rad):.0f} deg",
                )
            )
    return formatted_table("delays", pd.DataFrame(rows), combines_cases=True)
