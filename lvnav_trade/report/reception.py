"""The sections on the signals: satellites and their C/N0, what channels do, delays and latency, the filter's logic."""

from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.metrics import METRICS
from lvnav_trade.plots import PLOTS
from lvnav_trade.plots.signals import LAYERS, layers_of
from lvnav_trade.report.blocks import Block, Text, distinct, few, figures, named, number, of, picture, stated, table
from lvnav_trade.report.escape import note
from lvnav_trade.store import Tables

_FLOWN = 1e-6
"""Seconds: what is younger counts as present."""


def satellites(tables: Tables) -> list[Block]:
    """Return satellites in view with their C/N0, and the sky, once per distinct sky."""
    columns = ["t_s", "satellite", "tracked", "state", "cn0_db_hz", "antenna_number"]
    group, blocks = few(distinct(tables, "satellites", columns, tables.labels))
    for k, case in enumerate(group, 1):
        rows, label = tables.satellites[tables.satellites.case == case], named(tables, case, group)
        signal = " and their C/N0" * bool(rows.cn0_db_hz.notna().any())
        caption = f"Satellites in view{signal}; events as lines, faults shaded.{label}"
        blocks.append(picture(f"satellites-{k}", PLOTS["satellites"](tables, case), caption))
        blocks.append(picture(f"sky-{k}", PLOTS["sky"](tables, case), f"The sky at the antenna.{label}"))
        blocks += _measured(rows, label)
    return blocks


def _measured(rows: pd.DataFrame, label: str) -> list[Block]:
    """Return C/N0 and noise of each satellite while it is tracked, where there is a link budget."""
    mine = rows[rows.tracked & rows.cn0_db_hz.notna()]
    if mine.empty:
        return []
    groups = mine.assign(elevation_deg=np.degrees(mine.elevation_rad)).groupby("satellite")
    frame = pd.DataFrame(
        {
            "tracked from (s)": groups.t_s.min().map("{:.0f}".format),
            "to (s)": groups.t_s.max().map("{:.0f}".format),
            "elevation (deg)": _range(groups.elevation_deg, 0),
            "antennas": groups.antenna_number.unique().map(lambda antennas: ", ".join(map(str, sorted(antennas)))),
            "C/N0 (dB-Hz)": _range(groups.cn0_db_hz, 1),
            "range noise (m)": _range(groups.range_sigma_m, 2),
            "rate noise (m/s)": _range(groups.rate_sigma_m_per_s, 3),
        }
    )
    caption = f"Satellites while they are tracked, least to most; noise is one sigma.{label}"
    return [table(frame.rename_axis("satellite").reset_index(), caption)]


def _range(groups: Any, digits: int) -> pd.Series:
    low, high = (values.map(f"{{:.{digits}f}}".format) for values in (groups.min(), groups.max()))
    return low.where(low == high, low + " to " + high)


def tracking(tables: Tables) -> list[Block]:
    """Return what channels do with every satellite, fixes, losses by reason, and recovery after every fault.

    Empty where no receiver has channels and no fault takes satellites.
    """
    changes = METRICS["transitions"](tables)
    if changes.empty and not (METRICS["recovery"](tables).lost_count > 0).any():
        return []
    group, more = few(distinct(tables, "satellites", ["t_s", "satellite", "tracked", "state"], tables.labels))
    caption = "What the receiver does with every satellite; events as lines, faults shaded."
    frames = {name: METRICS[name](tables) for name in ("tracking", "losses", "recovery")}
    blocks = [stated(name, frame, alike=True) for name, frame in frames.items() if len(frame)] + more
    blocks += figures(tables, "timeline", group, caption)
    if len(changes):
        blocks.append(Text(note("searches")))
    return blocks


def delays(tables: Tables) -> list[Block]:
    """Return delays of the atmosphere, what the correction leaves of them, and latency; empty where there is none."""
    columns = [f"{layer}{kind}_m" for layer in LAYERS for kind in ("", "_left")]
    delayed = [case for case in tables.labels if _layers(tables, case)]
    group, blocks = few(distinct(tables, "satellites", ["t_s", "satellite", *columns], delayed))
    if group:
        blocks.append(_delay_table(tables))
    caption = "Delays of the signals of every satellite tracked, and what the filter's correction leaves of them."
    blocks += figures(tables, "delays", group, caption)
    aged = set(tables.satellites.case[tables.satellites.latency_s > _FLOWN])
    late = [case for case in tables.labels if case in aged]
    group, more = few(distinct(tables, "satellites", ["t_s", "latency_s"], late))
    return [*blocks, *more, *figures(tables, "latency", group, "Age of the measurements when they reach the filter.")]


def _layers(tables: Tables, case: str) -> list[str]:
    return layers_of(tables.satellites[tables.satellites.case == case])


def _delay_table(tables: Tables) -> Block:
    """Return root mean square and extremes of true and left delays by case and layer, where satellites are tracked."""
    rows = []
    for case, label in tables.labels.items():
        mine = tables.satellites[(tables.satellites.case == case) & tables.satellites.tracked]
        for layer in _layers(tables, case):
            true, left = mine[f"{layer}_m"], mine[f"{layer}_left_m"]
            worst = mine.loc[left.abs().idxmax()]
            sizes = [float((delay**2).mean() ** 0.5) for delay in (true, left)]
            which = f"{worst.satellite} at {worst.t_s:.0f} s, {np.degrees(worst.elevation_rad):.0f} deg"
            extremes = f"{number(round(true.min(), 6))} to {number(true.max())}"
            rows.append((label, layer, extremes, *sizes, float(left.mean()), left[worst.name], which))
    return stated("delays", pd.DataFrame(rows), alike=True)


@of("stops")
def logic_tables(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return what filters with a logic did: starts, stops and restarts, and every kind of change."""
    ratios = ["started_ratio", "corrected_ratio", "ended_ratio"]
    percents = frame.assign(**{ratio: 100.0 * frame[ratio] for ratio in ratios})
    return [stated("stops", percents), *_changes(tables)]


@of("logic")
def _changes(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    return [stated("logic", frame.assign(run_ratio=100.0 * frame.run_ratio))]


def logic(tables: Tables) -> list[Block]:
    """Return what filters with a logic did, in tables, and their modes over time."""
    cases = tables.cases.case[tables.cases.logic.fillna(False).astype(bool)]
    columns = [name for name in tables.logic.columns if name != "case"]
    group, more = few(distinct(tables, "logic", columns, cases))
    return [*logic_tables(tables), *figures(tables, "logic", group, "What the filter does."), *more]
