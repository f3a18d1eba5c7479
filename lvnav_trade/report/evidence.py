"""The sections behind the answer: flight, errors, consistency, agreement, published numbers, satellites, delays."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.report.blocks import (
    Block,
    More,
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
"""What a fact's name ends with, what of that is its unit, the unit for people, their factor."""
_FEW = 3  # cases of which every event stands in the table of errors
NAVIGATION = ("position", "velocity", "attitude")
_FLOWN = 1e-6  # seconds: what is younger counts as present


@of("requirements", "The campaign states no requirement.")
def requirements(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the verdicts in figures."""
    failed = np.isinf(frame.estimate).any()
    text = note("requirements") + (", ∞ where more runs failed." if failed else ".")
    frame = in_words(frame)
    frame = frame.assign(probability=frame.probability.map(percent), confidence=frame.confidence.map(percent))
    if (tables.campaign.get("monte_carlo") or {}).get("stop"):
        text += " " + note("stopping")
    return [table(frame.rename(columns=words)), Text(text), *_expected(tables)]


@of("windows")
def windows(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the worst errors around the events of the requirements."""
    return [stated("windows", frame.assign(by=frame.by.replace("LinCov", "linear covariance")))]


def _expected(tables: Tables) -> list[Block]:
    frame = in_words(METRICS["expected"](tables))
    frame = frame.assign(
        expected=expectation(frame),
        asked=100.0 * frame.probability,
        estimate=frame.estimate.where(frame.reason != ABOVE_ONLY, "–").replace("", "–"),
        limit=frame.limit.replace("", "–"),
        remark=frame.reason.fillna(""),
    )
    found = stated("expected", frame if frame.remark.any() else frame.drop(columns="remark"))
    return [found, Text(note("expected"))]


def expectation(frame: pd.DataFrame) -> pd.Series[Any]:
    """Return the expected part of flights (%); of a phase, where it is bounded from above only, in words."""
    part, above = 100.0 * frame.expected_probability, frame.reason == ABOVE_ONLY
    return part.map(number).where(~above, "at most " + part.map(number)) if above.any() else part


def trajectory(tables: Tables) -> list[Block]:
    """Return the flight, once per distinct trajectory."""
    group = distinct(tables, "reference", ["t_s", "altitude_m"], tables.labels)
    blocks: list[Block] = []
    for case, drawn in zip(group, figures(tables, "trajectory", group), strict=True):
        events = tables.events[tables.events.case == case].sort_values("t_s", kind="stable")
        ends = events.t_end_s.map("{:.2f}".format).where(events.kind == "fault", "")
        blocks += [drawn, stated("events", events.assign(ends=ends))]
        facts = json.loads(tables.cases.set_index("case").facts[case])
        if facts:
            rows = tuple(fact(name, value) for name, value in facts.items())
            blocks.append(Table(("what the flight achieves", "value"), rows, (False, True)))
    return blocks


def fact(name: str, value: float | str) -> tuple[str, str]:
    """Write a fact of the trajectory (SI, its unit at the end of its name) in the units of people."""
    if isinstance(value, str):
        return words(name), value
    for ending, suffix, unit, factor in _FACT_UNITS:
        if name.endswith(ending):
            return f"{words(name.removesuffix(suffix))} ({unit})", f"{value * factor:.5g}"
    return words(name), f"{value:.5g}"


def envelopes(tables: Tables) -> list[Block]:
    """Return the errors of all cases together, then of each case against its covariances, then the RMS table."""
    known = [quantity for quantity in NAVIGATION if (quantity, "3d") in tables.people]
    key, asked = deciding(tables)
    compared = [figure(tables, "comparison", quantity, name="compare") for quantity in (asked or known)]
    rest: list[Block] = [
        figure(tables, "comparison", quantity, name="compare") for quantity in known if quantity not in asked
    ]
    own = [(case, quantity) for case in dict.fromkeys([*key, *chosen_cases(tables)]) for quantity in known]
    open_ones = [(case, quantity) for case, quantity in own if case in key and quantity in asked]
    simulated = [about for about in open_ones if _has_runs(tables, *about)]
    blocks: list[Block] = [*compared, *(figure(tables, "quantiles", *about) for about in simulated)]
    blocks += [figure(tables, "envelope", *about) for about in open_ones]
    rest += [*left_out(tables), *(figure(tables, "envelope", *about) for about in own if about not in open_ones)]
    frame = METRICS["rms"](tables)
    frame = frame[(frame.axis == "3d") & frame.metric.isin([f"{quantity}_error" for quantity in known])]
    places = _places(tables)
    frame = frame[[place in places[case] for case, place in zip(frame.case, frame.phase_or_event, strict=True)]]
    frame = frame.assign(metric=words(frame.metric), phase_or_event=words(frame.phase_or_event)).drop(columns="axis")
    return [*blocks, More("Errors of other cases and quantities", rest), More("Numbers", [stated("envelopes", frame)])]


def _has_runs(tables: Tables, case: str, quantity: str) -> bool:
    """Whether quantiles of the 3-D error over runs are stored."""
    return bool(history_of(tables, case, quantity, "3d").q95_si.notna().any())


def _places(tables: Tables) -> dict[str, set[str]]:
    """Return by label what the table of errors shows of a case: the flight, and events at different times; of many
    cases only the events that are asked for, and the final one.
    """
    wanted = {where(requirement) for requirement in tables.campaign.get("requirements") or ()}
    wanted.add(str((tables.campaign.get("covariance") or {}).get("at") or ""))
    found = {}
    for case, label in tables.labels.items():
        if len(tables.labels) <= _FEW:
            found[label] = {"flight", *separate_events(tables, case).event}
        else:
            found[label] = {"flight", final_event(tables, case), *(wanted & set(flight_events(tables, case).event))}
    return found


def separate_events(tables: Tables, case: str) -> pd.DataFrame:
    """Return the events at different times, in their order; the final one stands for those that coincide with it."""
    events = flight_events(tables, case)
    events = events.assign(last=events.event == final_event(tables, case))
    return events.sort_values(["t_s", "last"], kind="stable").drop_duplicates("t_s", keep="last")


def consistency(tables: Tables) -> list[Block]:
    """Return NEES, NIS and whiteness."""
    frame = METRICS["consistency"](tables)
    frame = frame.assign(inside_ratio=frame.inside_ratio * 100)
    verdicts = METRICS["filter_verdicts"](tables)
    shown = [filter_verdict(row.verdict, row.sigma_ratio) for row in verdicts.itertuples()]
    by = verdicts.by.replace("LinCov", "linear covariance")
    verdicts = verdicts.assign(shown=shown, moment=words(verdicts.moment), by=by)
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
    """Return the verdict per case and the rows that disagree."""
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
        blocks.append(table(bad.rename(columns=words), "Furthest from agreement (at most 12)."))
    return blocks + _controlled(tables)


@of("controlled")
def _controlled(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    return [stated("controlled", frame, event=words(frame.event.iloc[0])), Text(note("controlled"))]


@of("outages", "No fault in any case.")
def outages(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the errors around every fault."""
    frame = frame.assign(fault=words(frame.fault), metric=words(frame.metric))
    return [stated("outages", frame)]


@of("references", "The campaign names no published number.")
def references(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return published numbers beside ours."""
    inside = int(frame.in_band.sum())
    return [Text(f"{inside} of {len(frame)} numbers lie in their band."), stated("references", frame)]


def reproduce(tables: Tables) -> list[Block]:
    """Return commands, seed, versions, digests."""
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
        Table(("what", "value"), rows, (False, False), "What computed these results."),
        stated("cases", tables.cases),
    ]


def satellites(tables: Tables) -> list[Block]:
    """Return satellites in view with their C/N0, and the sky, once per distinct sky."""
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
    caption = f"Smallest and largest values for each satellite while it is tracked; noise is one sigma.{label}"
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
    frames = {name: METRICS[name](tables) for name in ("tracking", "losses", "recovery")}
    blocks = [stated(name, frame, alike=True) for name, frame in frames.items() if len(frame)] + more
    return blocks + figures(tables, "timeline", group) + ([Text(note("searches"))] if len(changes) else [])


def delays(tables: Tables) -> list[Block]:
    """Return delays of the atmosphere, what the correction leaves of them, and latency; empty where there is none."""
    columns = [f"{layer}{kind}_m" for layer in LAYERS for kind in ("", "_left")]
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
    names = [f"{layer}{kind}_m" for layer in LAYERS for kind in ("", "_left")]
    columns = pick_columns(tables.satellites, names, case=case)
    return layers_of(pd.DataFrame(dict(zip(names, columns, strict=True))))


def _delay_table(tables: Tables) -> Block:
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
    cases = tables.cases.case[tables.cases.logic.eq(True)]
    columns = [name for name in tables.logic.columns if name != "case"]
    group, more = few(distinct(tables, "logic", columns, cases))
    return [*logic_tables(tables), *figures(tables, "logic", group), *more]
