"""Detailed sections of the report: flight, errors, consistency, agreement, published numbers, satellites, delays."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.report.blocks import (
    Block,
    Details,
    Picture,
    Table,
    Text,
    chosen_cases,
    deciding,
    distinct,
    few,
    figure,
    figures,
    left_out,
    named,
    number,
    of,
    percent,
    stated,
    table,
    words,
)
from lvnav_trade.report.escape import note
from lvnav_trade.report.figures import PLOTS
from lvnav_trade.report.figures.signals import LAYERS, layers_of
from lvnav_trade.report.validity import filter_verdict
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.covariances import by_case
from lvnav_trade.results.metric import where
from lvnav_trade.results.requirements.improvements import ABOVE_ONLY
from lvnav_trade.results.requirements.requirements import in_words
from lvnav_trade.results.statistics.select import final_event, flight_events, history_of, pick, pick_columns
from lvnav_trade.results.tables.read import Tables

_FACT_UNITS = (
    ("gee_m", "_m", "km", 1e-3),
    ("_m_per_s", "_m_per_s", "m/s", 1.0),
    ("_m_s", "_m_s", "m/s", 1.0),
    ("_rad", "_rad", "deg", 57.29577951308232),
    ("_pa", "_pa", "kPa", 1e-3),
    ("_m", "_m", "m", 1.0),
    ("_g", "_g", "g", 1.0),
    ("_kg", "_kg", "kg", 1.0),
    ("_s", "_s", "s", 1.0),
)
"""End of a fact's name, the SI unit in it, display unit, factor from the one to the other."""
_FEW = 3  # up to this number of cases, the table of errors has every event
NAVIGATION = ("position", "velocity", "attitude")
_FLOWN = 1e-6  # s, largest age of data that count as current


@of("requirements", "The campaign states no requirement.")
def requirements(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the table of verdicts with their numbers."""
    failed = np.isinf(frame.estimate).any()
    text = note("requirements") + (", ∞ where more runs failed." if failed else ".")
    frame = in_words(frame)
    frame = frame.assign(probability=frame.probability.map(percent), confidence=frame.confidence.map(percent))
    if (tables.campaign.get("monte_carlo") or {}).get("stop"):
        text += " " + note("stopping")
    return [table(frame.rename(columns=words)), Text(text), *_expected(tables)]


@of("windows")
def windows(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the worst errors in the windows around the events of the requirements."""
    return [stated("windows", frame.assign(by=frame.by.replace("LinCov", "linear covariance")))]


def _expected(tables: Tables) -> list[Block]:
    """Return the table of probabilities expected by linear covariance."""
    frame = in_words(METRICS["expected_verdicts"](tables))
    frame = frame.assign(
        expected=expectation(frame),
        asked=100.0 * frame.probability,
        estimate=frame.estimate.where(frame.reason != ABOVE_ONLY, "–").replace("", "–"),
        limit=frame.limit.replace("", "–"),
        remark=frame.reason.fillna(""),
    )
    layout = stated("expected", frame if frame.remark.any() else frame.drop(columns="remark"))
    return [layout, Text(note("expected"))]


def expectation(frame: pd.DataFrame) -> pd.Series[Any]:
    """Return the expected share of flights that comply (%); for a phase with an upper bound only, as text."""
    share, above = 100.0 * frame.expected_probability, frame.reason == ABOVE_ONLY
    return share.map(number).where(~above, "at most " + share.map(number)) if above.any() else share


def trajectory(tables: Tables) -> list[Block]:
    """Return the tables and figures of the trajectory, once for each distinct trajectory."""
    group = distinct(tables, "reference", ["t_s", "altitude_m"], tables.labels)
    blocks: list[Block] = []
    for case, drawn in zip(group, figures(tables, "trajectory", group), strict=True):
        events = tables.events[tables.events.case == case].sort_values("t_s", kind="stable")
        ends = events.t_end_s.map("{:.2f}".format).where(events.kind == "fault", "")
        blocks += [drawn, stated("events", events.assign(ends=ends))]
        facts = json.loads(tables.cases.set_index("case").facts[case])
        if facts:
            rows = tuple(fact(name, value) for name, value in facts.items())
            blocks.append(Table(("result of the ascent", "value"), rows, (False, True)))
    return blocks


def fact(name: str, value: float | str) -> tuple[str, str]:
    """Return name and value of a trajectory fact in display units.

    name : name with its SI unit at the end
    value : in that unit
    """
    if isinstance(value, str):
        return words(name), value
    for ending, suffix, unit, factor in _FACT_UNITS:
        if name.endswith(ending):
            return f"{words(name.removesuffix(suffix))} ({unit})", f"{value * factor:.5g}"
    return words(name), f"{value:.5g}"


def envelopes(tables: Tables) -> list[Block]:
    """Return the errors of all cases together, then of each case with its covariances, then the table of RMS errors."""
    quantities = [quantity for quantity in NAVIGATION if (quantity, "3d") in tables.people]
    key, required = deciding(tables)
    compared = [figure(tables, "comparison", quantity, name="compare") for quantity in (required or quantities)]
    folded: list[Block] = [
        figure(tables, "comparison", quantity, name="compare") for quantity in quantities if quantity not in required
    ]
    pairs = [(case, quantity) for case in dict.fromkeys([*key, *chosen_cases(tables)]) for quantity in quantities]
    open_ones = [(case, quantity) for case, quantity in pairs if case in key and quantity in required]
    simulated = [about for about in open_ones if _has_runs(tables, *about)]
    blocks: list[Block] = [*compared, *(figure(tables, "quantiles", *about) for about in simulated)]
    blocks += [figure(tables, "envelope", *about) for about in open_ones]
    folded += [*left_out(tables), *(figure(tables, "envelope", *about) for about in pairs if about not in open_ones)]
    frame = METRICS["rms"](tables)
    frame = frame[(frame.axis == "3d") & frame.metric.isin([f"{quantity}_error" for quantity in quantities])]
    places = _places(tables)
    frame = frame[[place in places[case] for case, place in zip(frame.case, frame.phase_or_event, strict=True)]]
    frame = frame.assign(metric=words(frame.metric), phase_or_event=words(frame.phase_or_event)).drop(columns="axis")
    return [
        *blocks,
        Details("Errors of other cases and quantities", folded),
        Details("Numbers", [stated("envelopes", frame)]),
    ]


def _has_runs(tables: Tables, case: str, quantity: str) -> bool:
    """Return whether quantiles of the 3-D error over the runs are stored."""
    return bool(history_of(tables, case, quantity, "3d").q95_si.notna().any())


def _places(tables: Tables) -> dict[str, set[str]]:
    """Return the places that the table of errors shows for each label: the whole flight, and events at distinct times.

    With many cases only the events of requirements and the final event.
    """
    required = {where(requirement) for requirement in tables.campaign.get("requirements") or ()}
    required.add(str((tables.campaign.get("covariance") or {}).get("at") or ""))
    places = {}
    for case, label in tables.labels.items():
        if len(tables.labels) <= _FEW:
            places[label] = {"flight", *separate_events(tables, case).event}
        else:
            places[label] = {"flight", final_event(tables, case), *(required & set(flight_events(tables, case).event))}
    return places


def separate_events(tables: Tables, case: str) -> pd.DataFrame:
    """Return the events at distinct times, in order; the final event represents those that coincide with it."""
    events = flight_events(tables, case)
    events = events.assign(last=events.event == final_event(tables, case))
    return events.sort_values(["t_s", "last"], kind="stable").drop_duplicates("t_s", keep="last")


def consistency(tables: Tables) -> list[Block]:
    """Return NEES, NIS and whiteness."""
    frame = METRICS["consistency"](tables)
    frame = frame.assign(inside_ratio=frame.inside_ratio * 100)
    verdicts = METRICS["filter_verdicts"](tables)
    verdict_texts = [filter_verdict(row.verdict, row.sigma_ratio) for row in verdicts.itertuples()]
    by = verdicts.by.replace("LinCov", "linear covariance")
    verdicts = verdicts.assign(shown=verdict_texts, moment=words(verdicts.moment), by=by)
    blocks: list[Block] = [Text(note("consistency")), stated("filter_verdicts", verdicts)]
    blocks += [stated("consistency", frame), *left_out(tables)]
    without = frame.case[(frame.test == "ANEES") & (frame.time_count == 0)]
    if len(without):
        blocks.append(
            Text(
                f"No ANEES of {'; '.join(without)}: the filter assumes that a state is known exactly, such as an "
                "extra state whose error the truth does not have. Its covariance has no inverse."
            )
        )
    blocks += [figure(tables, "consistency", case) for case in chosen_cases(tables)]
    return [*blocks, *_whiteness(tables)]


@of("whiteness")
def _whiteness(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    frame = frame.assign(size=frame.largest_ratio.abs())
    cases = frame.groupby("case", sort=False)
    worst = frame.loc[cases["size"].idxmax()].assign(
        channels=cases.size().to_numpy(), coloured=(cases.size() - cases.white.sum()).to_numpy().astype(int)
    )
    return [stated("whiteness", worst)]


def agreement(tables: Tables) -> list[Block]:
    """Return the verdict of each case and the quantities that disagree."""
    rows, cases = METRICS["agreement"](tables), by_case(tables)
    alpha = percent(float(cases.alpha_ratio.iloc[0])) if len(cases) else ""
    gate = tables.innovations.groupby("case", sort=False).false_rejection_ratio.max() * 100
    cases = cases.assign(
        source=[f"{row.source} ({100 * row.share_ratio:.0f} %)" if row.source else "–" for row in cases.itertuples()],
        rejected=[gate.get(case, 0.0) for case in tables.labels][: len(cases)],
    )
    blocks: list[Block] = [Text(note("agreement", alpha=alpha)), stated("agreement", cases)]
    blocks += [Text(f"{row.case}: {row.reason}.", "Not applicable.") for row in cases.itertuples() if row.reason]
    bad = rows[rows.agree == "disagree"].drop(columns="agree")
    if len(bad):
        bad = bad.assign(distance=(bad.ratio - 1.0).abs()).nlargest(12, "distance").drop(columns="distance")
        blocks.append(table(bad.rename(columns=words), "Largest disagreements (at most 12)."))
    return blocks + _controlled(tables)


@of("control_variates")
def _controlled(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    return [stated("controlled", frame, event=words(frame.event.iloc[0])), Text(note("controlled"))]


@of("outages", "No fault in any case.")
def outages(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the errors before, during and after every fault."""
    frame = frame.assign(fault=words(frame.fault), metric=words(frame.metric))
    return [stated("outages", frame)]


@of("references", "The campaign names no published number.")
def references(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return published numbers next to the computed numbers."""
    inside = int(frame.in_band.sum())
    return [Text(f"{inside} of {len(frame)} numbers are within their band."), stated("references", frame)]


def reproduce(tables: Tables) -> list[Block]:
    """Return the commands, the seed, the versions and the digests with which the results can be reproduced."""
    manifest = {**tables.manifest, "seed": tables.campaign.get("seed", tables.manifest.get("seed"))}
    keys = (
        "campaign",
        "seed",
        "campaign_digest",
        "tool",
        "code_digest",
        "commit",
        "python",
        "numpy",
        "numba",
        "scipy",
        "pyarrow",
        "system",
        "cpu",
        "created",
    )
    rows = tuple((words(key), str(manifest[key])) for key in keys if manifest.get(key))
    return [
        Text(note("reproduce")),
        Text("lvnav-trade run campaign.resolved.yaml --out again\nlvnav-trade report .", kind="code"),
        Table(("item", "value"), rows, (False, False), "Origin of these results."),
        stated("cases", tables.cases),
    ]


def satellites(tables: Tables) -> list[Block]:
    """Return the satellites in view with their C/N0, and the sky plot, once for each distinct geometry."""
    columns = ["t_s", "satellite", "tracked", "state", "cn0_db_hz", "antenna_number"]
    group, blocks = few(distinct(tables, "satellites", columns, tables.labels))
    for k, case in enumerate(group, 1):
        rows, label = pick(tables.satellites, case=case), named(tables, case, group)
        linked = " and their C/N0" if rows.cn0_db_hz.notna().any() else ""
        caption = note("satellites", "figures", signal=linked) + label
        blocks.append(Picture(f"satellites-{k}", PLOTS["satellites"](tables, case), caption))
        blocks.append(Picture(f"sky-{k}", PLOTS["sky"](tables, case), note("sky", "figures") + label))
        blocks += _measured(rows, label)
    return blocks


def _measured(rows: pd.DataFrame, label: str) -> list[Block]:
    tracked = rows[rows.tracked & rows.cn0_db_hz.notna()]
    if tracked.empty:
        return []
    groups = tracked.assign(elevation_deg=np.degrees(tracked.elevation_rad)).groupby("satellite")
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
    caption = f"Smallest and largest values for each satellite while it is tracked; noise is one sigma.{label}"
    return [table(frame.rename_axis("satellite").reset_index(), caption)]


def _range(groups: Any, digits: int) -> pd.Series:
    low, high = (values.map(f"{{:.{digits}f}}".format) for values in (groups.min(), groups.max()))
    return low.where(low == high, low + " to " + high)


def tracking(tables: Tables) -> list[Block]:
    """Return channel states of every satellite, fixes, losses of lock by reason, and recovery after every fault.

    The result is empty if no receiver models channels and no fault affects satellites.
    """
    changes = METRICS["transitions"](tables)
    if changes.empty and not (METRICS["recovery"](tables).lost_count > 0).any():
        return []
    group, more = few(distinct(tables, "satellites", ["t_s", "satellite", "tracked", "state"], tables.labels))
    frames = {name: METRICS[name](tables) for name in ("tracking", "losses", "recovery")}
    blocks = [stated(name, frame, alike=True) for name, frame in frames.items() if len(frame)] + more
    return blocks + figures(tables, "timeline", group) + ([Text(note("searches"))] if len(changes) else [])


def delays(tables: Tables) -> list[Block]:
    """Return atmospheric delays, the residual delays after correction, and the latency; empty if there are none."""
    columns = [f"{layer}{suffix}_m" for layer in LAYERS for suffix in ("", "_left")]
    delayed = [case for case in tables.labels if _layers(tables, case)]
    group, blocks = few(distinct(tables, "satellites", ["t_s", "satellite", *columns], delayed))
    if group:
        blocks.append(_delay_table(tables))
    blocks += figures(tables, "delays", group)
    aged = set(tables.satellites.case[tables.satellites.latency_s > _FLOWN])
    late = [case for case in tables.labels if case in aged]
    group, more = few(distinct(tables, "satellites", ["t_s", "latency_s"], late))
    return [*blocks, *more, *figures(tables, "latency", group)]


def _layers(tables: Tables, case: str) -> list[str]:
    names = [f"{layer}{suffix}_m" for layer in LAYERS for suffix in ("", "_left")]
    columns = pick_columns(tables.satellites, names, case=case)
    return layers_of(pd.DataFrame(dict(zip(names, columns, strict=True))))


def _delay_table(tables: Tables) -> Block:
    rows = []
    for case, label in tables.labels.items():
        lines = tables.satellites[(tables.satellites.case == case) & tables.satellites.tracked]
        for layer in _layers(tables, case):
            true, residual = lines[f"{layer}_m"], lines[f"{layer}_left_m"]
            worst = lines.loc[residual.abs().idxmax()]
            sizes = [float((delay**2).mean() ** 0.5) for delay in (true, residual)]
            where_worst = f"{worst.satellite} at {worst.t_s:.0f} s, {np.degrees(worst.elevation_rad):.0f} deg"
            extremes = f"{number(round(true.min(), 6))} to {number(true.max())}"
            rows.append((label, layer, extremes, *sizes, float(residual.mean()), residual[worst.name], where_worst))
    return stated("delays", pd.DataFrame(rows), alike=True)


@of("stops")
def logic_tables(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the mode logic of the filters in tables: starts, stops, restarts, and transitions by type."""
    ratios = ["started_ratio", "corrected_ratio", "ended_ratio"]
    percents = frame.assign(**{ratio: 100.0 * frame[ratio] for ratio in ratios})
    return [stated("stops", percents), *_changes(tables)]


@of("mode_transitions")
def _changes(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    return [stated("logic", frame.assign(run_ratio=100.0 * frame.run_ratio))]


def logic(tables: Tables) -> list[Block]:
    """Return the mode logic of the filters in tables, and figures of the modes over time."""
    cases = tables.cases.case[tables.cases.logic.eq(True)]
    columns = [name for name in tables.mode_transitions.columns if name != "case"]
    group, more = few(distinct(tables, "mode_transitions", columns, cases))
    return [*logic_tables(tables), *figures(tables, "logic", group), *more]
