"""The sections on the signals: satellites and their C/N0, what channels do, delays and latency."""

from __future__ import annotations

from collections.abc import Iterable

import pandas as pd

from lvnav_trade.metrics import METRICS
from lvnav_trade.plots import PLOTS
from lvnav_trade.plots.delays import LAYERS, layers_of
from lvnav_trade.report.blocks import Block, Text, alike, number, picture, table
from lvnav_trade.report.evidence import MOST_CASES, distinct, named_if_several
from lvnav_trade.store import Tables

_FLOWN = 1e-6
"""Seconds: what is younger counts as present."""


def satellites(tables: Tables) -> list[Block]:
    """Return satellites in view with their C/N0, and the sky, once per distinct sky."""
    columns = ["satellite", "tracked", "state", "cn0_db_hz", "antenna_number"]
    group, blocks = _alike(tables, tables.labels, columns)
    for number_, case in enumerate(group, start=1):
        rows = tables.satellites[tables.satellites.case == case]
        what = "Satellites in view and their C/N0" if rows.cn0_db_hz.notna().any() else "Satellites in view"
        note = named_if_several(tables, case, group)
        caption = f"{what}; events as lines, faults shaded.{note}"
        blocks.append(picture(f"satellites-{number_}", PLOTS["satellites"](tables, case), caption))
        blocks.append(picture(f"sky-{number_}", PLOTS["sky"](tables, case), f"The sky at the antenna.{note}"))
        blocks += _measured(rows, note)
    return blocks


def _alike(tables: Tables, cases: Iterable[str], columns: list[str]) -> tuple[list[str], list[Block]]:
    """Return one of these cases for each group that has the same rows, no more than are drawn, and what to say then."""
    group = [case for case in distinct(tables, "satellites", ["t_s", *columns]) if case in set(cases)]
    more = len(group) - MOST_CASES
    return group[:MOST_CASES], [Text(f"{more} more cases that differ here are in the tables.")] * (more > 0)


def _measured(rows: pd.DataFrame, note: str) -> list[Block]:
    """Return C/N0 and noise of each satellite while it is tracked, where there is a link budget."""
    mine = rows[rows.tracked & rows.cn0_db_hz.notna()]
    if mine.empty:
        return []
    groups = mine.groupby("satellite")
    shown = pd.DataFrame(
        {
            "satellite": list(groups.groups),
            "tracked from (s)": groups.t_s.min().map(lambda t: f"{t:.0f}").to_list(),
            "to (s)": groups.t_s.max().map(lambda t: f"{t:.0f}").to_list(),
            "elevation (deg)": [_range(one.elevation_rad * 57.29577951308232, 0) for _, one in groups],
            "antennas": [", ".join(f"{k:.0f}" for k in sorted(one.antenna_number.unique())) for _, one in groups],
            "C/N0 (dB-Hz)": [_range(one.cn0_db_hz, 1) for _, one in groups],
            "range noise (m)": [_range(one.range_sigma_m, 2) for _, one in groups],
            "rate noise (m/s)": [_range(one.rate_sigma_m_per_s, 3) for _, one in groups],
        }
    )
    caption = f"Satellites while they are tracked, least to most; noise is one sigma.{note}"
    return [table(shown, caption)]


def _range(values: pd.Series, digits: int) -> str:
    low, high = f"{values.min():.{digits}f}", f"{values.max():.{digits}f}"
    return low if low == high else f"{low} to {high}"


def tracking(tables: Tables) -> list[Block]:
    """Return what channels do with every satellite, fixes, losses by reason, and recovery after every fault.

    Empty where no receiver has channels and no fault takes satellites.
    """
    changes, back = METRICS["transitions"](tables), METRICS["recovery"](tables)
    if changes.empty and not (back.lost_count > 0).any():
        return []
    blocks: list[Block] = [_fixes(tables), *_losses(tables), *_recovery(back)]
    group, more = _alike(tables, tables.labels, ["satellite", "tracked", "state"])
    blocks += more
    for number_, case in enumerate(group, start=1):
        caption = "What the receiver does with every satellite; events as lines, faults shaded."
        note = named_if_several(tables, case, group)
        blocks.append(picture(f"timeline-{number_}", PLOTS["timeline"](tables, case), caption + note))
    if len(changes):
        blocks.append(
            Text(
                "Searches take their time from draws that belong to the receiver's numbered realisation: the same in "
                "all runs, and another one of the same kind with another number. Every change: transitions.csv."
            )
        )
    return blocks


def _fixes(tables: Tables) -> Block:
    frame = METRICS["tracking"](tables)
    shown = pd.DataFrame(
        {
            "case": frame.case,
            "first fix at (s)": frame.first_fix_s.map(_time),
            "after (s)": frame.to_fix_s.map(_time),
            "satellites, mean": frame.mean_count.map(lambda count: f"{count:.1f}" if count == count else "–"),
            "least": frame.least_count,
            "times without a fix": frame.gap_count,
            "longest (s)": frame.longest_gap_s.map(_time),
            "satellites lost": frame.loss_count,
        }
    )
    caption = (
        "Four satellites make a fix. Counted from the first one on, to the second; lost is whatever ends tracking."
    )
    return table(alike(shown), caption)


def _losses(tables: Tables) -> list[Block]:
    frame = METRICS["losses"](tables)
    if frame.empty:
        return []
    shown = pd.DataFrame(
        {
            "case": frame.case,
            "reason": frame.reason,
            "losses": frame.loss_count,
            "satellites": frame.satellite_count,
            "first (s)": frame.first_s.map(lambda t: f"{t:.1f}"),
            "last (s)": frame.last_s.map(lambda t: f"{t:.1f}"),
        }
    )
    return [table(alike(shown), "Why tracking ended; out of view: the satellite set or was hidden by the Earth.")]


def _recovery(frame: pd.DataFrame) -> list[Block]:
    if frame.empty:
        return []
    shown = pd.DataFrame(
        {
            "case": frame.case,
            "fault": frame.fault.str.replace("_", " "),
            "from (s)": frame.t_start_s.map(lambda t: f"{t:.1f}"),
            "to (s)": frame.t_end_s.map(lambda t: f"{t:.1f}"),
            "tracked before": frame.before_count,
            "least in it": frame.least_count,
            "lost": frame.lost_count,
            "to four (s)": frame.to_fix_s.map(_time),
            "to all (s)": frame.to_all_s.map(_time),
            "not again": frame.gone_count,
        }
    )
    caption = (
        "Satellites around every fault, times counted from its end: until four are tracked, and until every one that "
        "was lost and ever comes back is; not again: set meanwhile, or the flight ends."
    )
    return [table(alike(shown), caption)]


def _time(value: float) -> str:
    return f"{value:.0f}" if value == value else "never"


def delays(tables: Tables) -> list[Block]:
    """Return delays of the atmosphere, what the correction leaves of them, and latency; empty where there is none."""
    columns = [f"{layer}{kind}_m" for layer in LAYERS for kind in ("", "_left")]
    delayed = [case for case in tables.labels if _layers(tables, case)]
    group, blocks = _alike(tables, delayed, ["satellite", *columns])
    if group:
        blocks.append(_delay_table(tables))
    for number_, case in enumerate(group, start=1):
        caption = "Delays of the signals of every satellite tracked, and what the filter's correction leaves of them."
        note = named_if_several(tables, case, group)
        blocks.append(picture(f"delays-{number_}", PLOTS["delays"](tables, case), caption + note))
    aged = set(tables.satellites.case[tables.satellites.latency_s > _FLOWN])
    late, more = _alike(tables, [case for case in tables.labels if case in aged], ["latency_s"])
    blocks += more
    for number_, case in enumerate(late, start=1):
        caption = "Age of the measurements when they reach the filter."
        note = named_if_several(tables, case, late)
        blocks.append(picture(f"latency-{number_}", PLOTS["latency"](tables, case), caption + note))
    return blocks


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
            rows.append(
                (
                    label, layer, f"{number(round(true.min(), 6))} to {number(true.max())}",
                    float((true**2).mean() ** 0.5), float((left**2).mean() ** 0.5), float(left.mean()),
                    worst[f"{layer}_left_m"],
                    f"{worst.satellite} at {worst.t_s:.0f} s, {worst.elevation_rad * 57.29577951308232:.0f} deg",
                )
            )  # fmt: skip
    head = ["case", "layer", "true (m)", "RMS (m)", "left, RMS (m)", "left, mean (m)", "left, worst (m)", "which"]
    caption = (
        "Delays of pseudoranges over the flight, true and left by the filter's correction (true less corrected). What "
        "is common to all satellites goes into the clock."
    )
    return table(alike(pd.DataFrame(rows, columns=head)), caption)


def logic_tables(tables: Tables) -> list[Block]:
    """Return what filters with a logic did: starts, stops and restarts, and every kind of change."""
    stops, changes = METRICS["stops"](tables), METRICS["logic"](tables)
    if stops.empty:
        return []
    shown = pd.DataFrame(
        {
            "case": stops.case,
            "runs": stops.run_count,
            "started (%)": (100.0 * stops.started_ratio).map(lambda part: f"{part:.4g}"),
            "corrected (%)": (100.0 * stops.corrected_ratio).map(lambda part: f"{part:.4g}"),
            "stops": stops.stop_count,
            "restarts": stops.restart_count,
            "corrected at the end (%)": (100.0 * stops.ended_ratio).map(lambda part: f"{part:.4g}"),
        }
    )
    caption = (
        "The filter waits for good samples, converges while the outputs are the inertial system's own, then aids; it "
        "predicts through a loss of data, stops where an error persists, and starts again. Linear covariance knows no "
        "such logic: it knows where samples pass the checks at the input, and nothing else."
    )
    blocks: list[Block] = [table(shown, caption)]
    if len(changes):
        kinds = pd.DataFrame(
            {
                "case": changes.case,
                "from": changes.from_mode,
                "to": changes.to_mode,
                "reason": changes.reason,
                "times": changes.change_count,
                "runs (%)": (100.0 * changes.run_ratio).map(lambda part: f"{part:.4g}"),
                "first (s)": changes.first_s.map(lambda t: f"{t:.0f}"),
                "median (s)": changes.median_s.map(lambda t: f"{t:.0f}"),
                "last (s)": changes.last_s.map(lambda t: f"{t:.0f}"),
            }
        )
        blocks.append(table(kinds, "Every kind of change: logic.csv; every single one: the table logic."))
    return blocks


def logic(tables: Tables) -> list[Block]:
    """Return what filters with a logic did, in tables, and their modes over time."""
    blocks = logic_tables(tables)
    watched = tables.cases[tables.cases.logic.fillna(False).astype(bool)].case
    group, more = _different(tables, list(watched))
    for number_, case in enumerate(group, start=1):
        note = named_if_several(tables, case, group)
        blocks.append(picture(f"logic-{number_}", PLOTS["logic"](tables, case), f"What the filter does.{note}"))
    return blocks + more


def _different(tables: Tables, cases: list[str]) -> tuple[list[str], list[Block]]:
    """Return one case of each group whose runs change alike, no more than are drawn, and what to say then."""
    seen: dict[int, str] = {}
    for case in cases:
        rows = tables.logic[tables.logic.case == case].drop(columns="case")
        seen.setdefault(int(pd.util.hash_pandas_object(rows, index=False).sum()), case)
    more = len(seen) - MOST_CASES
    said: list[Block] = [Text(f"{more} more cases that differ here are in the tables.")] if more > 0 else []
    return list(seen.values())[:MOST_CASES], said
