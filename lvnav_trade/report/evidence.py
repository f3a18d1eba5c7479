"""The sections behind the answer: flight, errors, consistency, agreement, outages, references."""

from __future__ import annotations

import json
from typing import Any

import pandas as pd

from lvnav_trade.metrics import METRICS
from lvnav_trade.metrics.basics.select import final_event, flight_events
from lvnav_trade.metrics.errors.agreement import by_case
from lvnav_trade.metrics.requirements.distributions import ABOVE_ONLY
from lvnav_trade.metrics.requirements.requirements import where
from lvnav_trade.plots import PLOTS
from lvnav_trade.report.blocks import Block, Code, Table, Text, number, percent, picture, table
from lvnav_trade.store import Tables

_FACT_UNITS = (
    ("gee_m", "_m", "km", 1e-3), ("_m_per_s", "_m_per_s", "m/s", 1.0), ("_m_s", "_m_s", "m/s", 1.0),
    ("_rad", "_rad", "deg", 57.29577951308232), ("_pa", "_pa", "kPa", 1e-3), ("_m", "_m", "m", 1.0),
    ("_g", "_g", "g", 1.0), ("_kg", "_kg", "kg", 1.0), ("_s", "_s", "s", 1.0),
)  # fmt: skip
"""What a fact's name ends with, what of that is its unit, the unit for people, their factor."""
MOST_CASES = 8
"""Cases whose own figures are drawn; of more, the best and the worst."""
_FEW = 3
"""Cases of which every event stands in the table of errors."""
NAVIGATION = ("position", "velocity", "attitude")


def chosen_cases(tables: Tables) -> list[str]:
    """Return the digests of the cases that get figures of their own, in the order of the plan."""
    if len(tables.labels) <= MOST_CASES:
        return list(tables.labels)
    order = list(METRICS["ranking"](tables).case)
    kept = {*order[: MOST_CASES - 2], *order[-2:]}
    return [case for case, label in tables.labels.items() if label in kept]


def left_out(tables: Tables) -> list[Block]:
    """Say that cases are left out, where some are."""
    more = len(tables.labels) - len(chosen_cases(tables))
    return [Text(f"Shown are the {MOST_CASES - 2} best cases and the 2 worst; {more} more are in the tables.")] * (
        more > 0
    )


def distinct(tables: Tables, name: str, columns: list[str]) -> list[str]:
    """Return one case of each group whose rows of a table are the same."""
    frame = getattr(tables, name)
    first: dict[int, str] = {}
    for case in tables.labels:
        rows = frame.loc[frame.case == case, columns]
        first.setdefault(hash(pd.util.hash_pandas_object(rows, index=False).to_numpy().tobytes()), case)
    return list(first.values())


def named_if_several(tables: Tables, case: str, group: list[str]) -> str:
    """Name the case where a figure does not stand for all."""
    return f" {tables.labels[case]}." if len(group) > 1 else ""


def requirements(tables: Tables) -> list[Block]:
    """Return the verdicts in figures."""
    frame = METRICS["requirements"](tables)
    if frame.empty:
        return [Text("The campaign states no requirement.")]
    frame = frame.assign(probability=frame.probability.map(percent), confidence=frame.confidence.map(percent))
    frame.columns = [name.replace("_", " ") for name in frame.columns]
    note = (
        "Met: the lower bound on the probability of success reaches what is asked; violated: the upper bound stays "
        "below it. Bounds are exact binomial, one-sided, at the stated confidence. A failed run is a failure. "
        "Estimate: the error that the stated fraction of runs stays within"
        + (", ∞ where more runs failed." if frame.estimate.str.startswith("∞").any() else ".")
    )
    if (tables.campaign.get("monte_carlo") or {}).get("stop"):
        note += (
            " Each case flew until all of its requirements were decided: the bounds allow a look after every block of "
            "runs, so that looking often costs no confidence."
        )
    return [table(frame), Text(note), *_expected(tables)]


def _expected(tables: Tables) -> list[Block]:
    """Return linear covariance's own verdicts."""
    frame = METRICS["expected"](tables)
    shown = pd.DataFrame(
        {
            "requirement": frame.requirement,
            "case": frame.case,
            "verdict by linear covariance": frame.verdict,
            "expected to keep it (%)": _expectation(frame),
            "asked (%)": 100.0 * frame.probability,
            "estimate": frame.estimate.where(frame.reason != ABOVE_ONLY).fillna("–"),
            "limit": frame.limit.fillna("–"),
            "remark": frame.reason.fillna(""),
        }
    )
    note = (
        "Linear covariance's own verdict: the probability that the error, a Gaussian vector with its mean and "
        "covariance, stays below the limit (exact for that Gaussian, by quadrature). It has no sampling error and "
        "knows neither nonlinearity nor gates; the Monte-Carlo verdict counts."
    )
    shown = shown if shown.remark.any() else shown.drop(columns="remark")
    return [table(shown, "The same requirements by linear covariance alone."), Text(note)]


def _expectation(frame: pd.DataFrame) -> pd.Series[Any]:
    """Return the expected part of flights (%); of a phase, where it is bounded from above only, in words."""
    part, above = 100.0 * frame.expected_probability, frame.reason == ABOVE_ONLY
    return part.map(number).where(~above, "at most " + part.map(number)) if above.any() else part


def trajectory(tables: Tables) -> list[Block]:
    """Return the flight, once per distinct trajectory."""
    group = distinct(tables, "reference", ["t_s", "altitude_m"])
    blocks: list[Block] = []
    for number_, case in enumerate(group, start=1):
        caption = "Trajectory; events as lines, faults shaded." + named_if_several(tables, case, group)
        blocks.append(picture(f"trajectory-{number_}", PLOTS["trajectory"](tables, case), caption))
        events = tables.events[tables.events.case == case].sort_values("t_s", kind="stable")
        shown = pd.DataFrame({"event": events.event.str.replace("_", " "), "kind": events.kind})
        shown["time (s)"] = events.t_s.map(lambda t: f"{t:.2f}")
        shown["end (s)"] = events.t_end_s.where(events.kind == "fault").map(lambda t: f"{t:.2f}" if t == t else "")
        blocks.append(table(shown, "Events, seconds since lift-off."))
        facts = json.loads(tables.cases.set_index("case").facts[case])
        if facts:
            rows = tuple(_fact(name, value) for name, value in facts.items())
            blocks.append(Table(("what the flight achieves", "value"), rows, (False, True)))
    return blocks


def _fact(name: str, value: float | str) -> tuple[str, str]:
    """Write a fact of the trajectory (SI, its unit at the end of its name) in the units of people."""
    for ending, suffix, unit, factor in _FACT_UNITS:
        if name.endswith(ending) and not isinstance(value, str):
            return f"{name.removesuffix(suffix).replace('_', ' ')} ({unit})", f"{value * factor:.5g}"
    return name.replace("_", " "), value if isinstance(value, str) else f"{value:.5g}"


def envelopes(tables: Tables) -> list[Block]:
    """Return the errors of all cases together, then of each case against its covariances, then the RMS table."""
    blocks: list[Block] = []
    known = [quantity for quantity in NAVIGATION if (quantity, "3d") in tables.people]
    for quantity in known:
        figure = PLOTS["comparison"](tables, quantity)
        blocks.append(picture(f"compare-{quantity}", figure, f"{quantity.capitalize()} error of all cases."))
    blocks += left_out(tables)
    for case in chosen_cases(tables):
        for quantity in known:
            caption = f"{tables.labels[case]}: {quantity} error by axis, RMS and 1 sigma."
            blocks.append(picture(f"envelope-{case}-{quantity}", PLOTS["envelope"](tables, case, quantity), caption))
    frame = METRICS["rms"](tables)
    places = _places(tables)
    shown = (frame.axis == "3d") & frame.metric.isin([f"{quantity}_error" for quantity in known])
    frame = frame[shown]
    frame = frame[[place in places[case] for case, place in zip(frame.case, frame.phase_or_event, strict=True)]]
    frame = frame.assign(
        metric=frame.metric.str.replace("_", " "), phase_or_event=frame.phase_or_event.str.replace("_", " ")
    )
    head = ["case", "over or at", "metric", "axis", "unit", "RMS", "low", "high", "filter sigma", "LinCov true"]
    frame.columns = head
    blocks.append(
        table(
            frame.drop(columns="axis"),
            "3D errors over the flight and at events; low and high bound RMS at 95 %. All events, phases and axes: "
            "rms.csv.",
        )
    )
    return blocks


def _places(tables: Tables) -> dict[str, set[str]]:
    """Return by label what the table of errors shows of a case: the flight, and events at different times; of many
    cases only the events that are asked for, and the final one.
    """
    wanted = {where(requirement) for requirement in tables.campaign.get("requirements") or ()}
    wanted.add(str((tables.campaign.get("covariance") or {}).get("at") or ""))
    found = {}
    for case, label in tables.labels.items():
        final = final_event(tables, case)
        events = flight_events(tables, case)
        events = events.assign(last=events.event == final).sort_values(["t_s", "last"], kind="stable")
        every = {"flight", *events.drop_duplicates("t_s", keep="last").event}
        found[label] = every if len(tables.labels) <= _FEW else {"flight", final, *(wanted & set(events.event))}
    return found


def consistency(tables: Tables) -> list[Block]:
    """Return NEES, NIS and whiteness."""
    frame = METRICS["consistency"](tables)
    frame = frame.assign(inside_ratio=frame.inside_ratio * 100)
    frame.columns = ["case", "test", "time mean (-)", "LinCov expects (-)", "inside 95 % bounds (% of times)", "times"]
    blocks: list[Block] = [
        Text(
            "ANEES and ANIS are divided by their degrees of freedom: 1 is a filter whose covariance fits its errors, "
            "more is optimism. Dashed in the pictures: what linear covariance expects. Where a filter has a gate, "
            "ANIS is that of the accepted rows over what the gate leaves of a matched filter's (F(g^2; 3) / F(g^2; "
            "1) per row); NEES has no such correction."
        ),
        table(frame, "Consistency."),
        *left_out(tables),
    ]
    without = frame.case[(frame.test == "ANEES") & (frame.times == 0)]
    if len(without):
        blocks.append(
            Text(
                f"No ANEES of {'; '.join(without)}: the filter takes a state for known exactly, such as an extra state "
                "whose error the truth does not have, and its covariance has no inverse."
            )
        )
    for case in chosen_cases(tables):
        caption = f"{tables.labels[case]}: normalised errors and innovations squared."
        blocks.append(picture(f"consistency-{case}", PLOTS["consistency"](tables, case), caption))
    return [*blocks, *_whiteness(tables)]


def _whiteness(tables: Tables) -> list[Block]:
    frame = METRICS["whiteness"](tables)
    if frame.empty:
        return []
    rows = []
    for case, group in frame.groupby("case", sort=False):
        worst = group.iloc[int(group.largest_ratio.abs().to_numpy().argmax())]
        rows.append(
            (case, len(group), int((~group.white).sum()), worst.channel, worst.largest_ratio, worst.largest_lag_number)
        )
    head = [
        "case",
        "channels",
        "not white (1 % per case, Holm)",
        "worst channel",
        "its autocorrelation (-)",
        "at lag (epochs)",
    ]
    return [table(pd.DataFrame(rows, columns=head), "Whiteness of the innovations, lags 1 to 10.")]


def agreement(tables: Tables) -> list[Block]:
    """Return the verdict per case and the rows that disagree."""
    rows = METRICS["agreement"](tables)
    cases = by_case(tables)
    alpha = percent(float(cases.alpha_ratio.iloc[0])) if len(cases) else ""
    gate = tables.innovations.groupby("case", sort=False).false_rejection_ratio.max() * 100
    shown = pd.DataFrame({"case": cases.case, "verdict": cases.verdict, "tested": cases.tested_count})
    shown["outside"] = cases.outside_count
    shown["worst state"] = cases.state
    shown["at"] = cases.event.str.replace("_", " ")
    shown["ratio (-)"] = cases.ratio
    shown["bounds (-)"] = cases.low.map(number) + " to " + cases.high.map(number)
    shown["largest source there"] = [
        f"{row.source} ({100 * row.share_ratio:.0f} %)" if row.source else "–" for row in cases.itertuples()
    ]
    shown["good rows rejected (%)"] = [gate.get(case, 0.0) for case in tables.labels][: len(shown)]
    note = (
        "Monte-Carlo RMS over the RMS that linear covariance expects, for nine navigation errors at every event; "
        f"bounds by chi-square, all rows of a case together at the {alpha} level (Bonferroni). All rows: "
        "agreement.csv. Linear covariance knows no gate: where a gate rejects more than 1 % of good rows at some "
        "epoch (last column, the worst epoch, by linear covariance), it does not describe the filter, and the "
        "verdict is not applicable."
    )
    blocks: list[Block] = [Text(note), table(shown, "Agreement of the two engines.")]
    blocks += [Text(f"{row.case}: {row.reason}.", "Not applicable.") for row in cases.itertuples() if row.reason]
    bad = rows[rows.agree == "disagree"].drop(columns="agree")
    if len(bad):
        bad = bad.assign(distance=(bad.ratio - 1.0).abs()).nlargest(12, "distance").drop(columns="distance")
        blocks.append(
            table(bad.rename(columns=lambda name: name.replace("_", " ")), "Furthest from agreement (at most 12).")
        )
    return blocks + _controlled(tables)


def _controlled(tables: Tables) -> list[Block]:
    """Return the errors whose sampling noise is reduced by what linear theory knows exactly."""
    frame = METRICS["controlled"](tables)
    if frame.empty:
        return []
    shown = pd.DataFrame({"case": frame.case, "error": frame.metric.str.replace("_", " "), "unit": frame.unit})
    shown["RMS"] = frame.rms
    shown["95 % interval"] = frame.low.map(number) + " to " + frame.high.map(number)
    shown["controlled"] = frame.controlled_rms
    shown["its 95 % interval"] = frame.controlled_low.map(number) + " to " + frame.controlled_high.map(number)
    shown["linear covariance"] = frame.lincov
    shown["runs"] = frame.runs
    shown["effective runs"] = frame.effective_runs.map(lambda worth: f"{worth:.0f}")
    note = (
        "Control variates: the part of a run's error that follows linearly from what it drew at its start (turn-on and "
        "initial errors) has a mean square that is known exactly; its excess in these runs is taken off. That changes "
        "no expectation, also where the filter is not linear, and is worth the effective number of runs."
    )
    return [table(shown, f"3D errors at {str(frame.event.iloc[0]).replace('_', ' ')}."), Text(note)]


def outages(tables: Tables) -> list[Block]:
    """Return the errors around every fault."""
    frame = METRICS["outages"](tables)
    if frame.empty:
        return [Text("No fault in any case.")]
    frame = frame.assign(fault=frame.fault.str.replace("_", " "), metric=frame.metric.str.replace("_", " "))
    frame.columns = [
        "case",
        "fault",
        "start (s)",
        "end (s)",
        "metric",
        "unit",
        "before",
        "at end",
        "10 s after",
        "worst",
        "growth (-)",
        "LinCov at end",
    ]
    caption = "3D RMS error before, at the end of, and 10 s after every fault; the worst in between."
    return [table(frame, caption)]


def references(tables: Tables) -> list[Block]:
    """Return published numbers beside ours."""
    frame = METRICS["references"](tables)
    if frame.empty:
        return [Text("The campaign names no published number.")]
    inside = int(frame.in_band.sum())
    frame = frame.assign(
        metric=frame.metric.str.replace("_", " "),
        band=frame.band_low.map(number) + " to " + frame.band_high.map(number),
    )
    shown = frame[
        ["source", "item", "case", "metric", "unit", "published", "ours", "ratio", "band", "in_band", "remark"]
    ]
    shown = shown.rename(columns={"ratio": "ours / published (-)", "in_band": "in band"})
    return [
        Text(f"{inside} of {len(frame)} numbers lie in their band."),
        table(shown, "Published numbers beside ours."),
    ]


def reproduce(tables: Tables) -> list[Block]:
    """Return commands, seed, versions, digests."""
    manifest = tables.manifest
    commands = "lvnav-trade run campaign.resolved.yaml --out again\nlvnav-trade report ."
    keys: dict[str, Any] = {
        "campaign": manifest.get("campaign"),
        "seed": tables.campaign.get("seed", manifest.get("seed")),
        "campaign digest": manifest.get("campaign_digest"),
        **{
            name: manifest.get(name)
            for name in (
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
        },
    }
    rows = tuple((name.replace("_", " "), str(value)) for name, value in keys.items() if value)
    cases = tables.cases[["label", "case", "run_count", "failed_count"]]
    cases = cases.set_axis(["case", "digest", "runs", "failed"], axis=1)
    return [
        Text(
            "The resolved campaign, all defaults filled in, stands in the folder of the results. There, type the first "
            "line to compute them again into a folder of their own, the second to make this page again. The same "
            "campaign, seed and version give the same tables byte for byte, whatever the number of workers."
        ),
        Code(commands),
        Table(("what", "value"), rows, (False, False), "What computed these results."),
        table(cases, "Cases and their digests."),
    ]
