"""Report sections on the vehicle: rate and acceleration compared with the IMU's samples, nozzle movement."""

from __future__ import annotations

import json

import pandas as pd

from lvnav_trade.metrics import METRICS
from lvnav_trade.plots import PLOTS
from lvnav_trade.report.blocks import Block, Text, number, picture, table
from lvnav_trade.store import Tables


def motion_table(tables: Tables) -> list[Block]:
    """Return how much better than the raw sample rate and acceleration are, and whether as the filter models."""
    frame = METRICS["motion"](tables)
    if frame.empty:
        return []
    shown = pd.DataFrame(
        {
            "case": frame.case,
            "phase": frame.phase.str.replace("_", " "),
            "error": frame.metric.str.replace("_error", "") + " " + frame.axis,
            "unit": frame.unit,
            "raw": frame.raw,
            "filtered": frame.filtered,
            "better (%)": frame.better_percent,
            "formal better (%)": frame.formal_better_percent,
            "RMS over filter's sigma (-)": frame.over_sigma_ratio,
            "95 %": frame.low.map(number) + " to " + frame.high.map(number),
            "verdict": frame.as_modelled,
        }
    )
    note = (
        "Raw: the unit's sample as it is, bias and all; filtered: the estimate (without a vehicle model, the sample "
        "less its estimated bias). RMS of the runs over each phase, from two seconds after its start to one before its "
        "end. The interval is what so many runs at one time allow; 'smaller' says that the truth varies less than the "
        "envelope that the filter assumes."
    )
    return [
        *interpretations_table(tables),
        Text(note),
        table(shown, "Rate and acceleration, 1 sigma. All of it: motion.csv."),
    ]


def motion_summary(tables: Tables) -> list[Block]:
    """Return in short, for cases that estimate rate and acceleration: the range over phases, and how many verdicts.

    Nothing without runs, or where the vehicle is under control: there the nozzle is asked for.
    """
    frame = METRICS["motion"](tables)
    if len(tables.nozzle) or not tables.cases.run_count.any():
        return []
    outputs = tables.outputs
    estimated = set(outputs.case[outputs.quantity == "rate"].map(tables.labels))
    frame = frame[frame.case.isin(estimated)]
    if frame.empty:
        return interpretations_table(tables)
    rows = []
    for (case, metric, axis), one in frame.groupby(["case", "metric", "axis"], sort=False):
        verdicts = one.as_modelled.value_counts()
        rows.append({
            "case": case, "error": f"{str(metric).replace('_error', '')} {axis}",
            "better (%)": _range(one.better_percent), "formal better (%)": _range(one.formal_better_percent),
            "RMS over filter's sigma (-)": _range(one.over_sigma_ratio),
            "95 % of so many runs": f"times {number(float((one.low / one.over_sigma_ratio).min()))} to "
            f"{number(float((one.high / one.over_sigma_ratio).max()))}",
            "verdicts": ", ".join(f"{name} in {count} of {len(one)}" for name, count in verdicts.items()),
        })  # fmt: skip
    note = (
        "Estimate against the raw sample, bias and all, from the least to the largest of the flight's phases (longer "
        "than 5 s). Verdict: does the interval that so many runs allow at one time hold the filter's own sigma; "
        "'smaller' says that the truth varies less than the filter assumes. By phase: the campaign's own report."
    )
    return [
        *interpretations_table(tables),
        Text(note),
        table(pd.DataFrame(rows), "Rate and acceleration over the phases."),
    ]


def _range(values: pd.Series) -> str:
    return f"{number(float(values.min()))} to {number(float(values.max()))}"


def interpretations_table(tables: Tables) -> list[Block]:
    """Return improvements of all cases that references hold against raw samples, side by side; nothing without any."""
    frame = METRICS["interpretations"](tables)
    if frame.empty:
        return []
    keys = ["error", "during"]
    shown = frame[keys].drop_duplicates().reset_index(drop=True)
    cases = list(dict.fromkeys(frame.case))
    for column, whose in (("stated_percent", "stated"), ("raw_percent", "ours")):
        for case in cases:
            mine = frame[frame.case == case].set_index(keys)[column]
            shown[f"{case}: {whose} (%)"] = mine.reindex(pd.MultiIndex.from_frame(shown[keys])).to_numpy()
    for case in cases:
        mine = frame[frame.case == case].set_index(keys).unbiased_percent
        shown[f"both sides without bias, {case} (%)"] = mine.reindex(pd.MultiIndex.from_frame(shown[keys])).to_numpy()
    shown["during"] = shown.during.str.replace("_", " ")
    note = (
        "By how much the filter's own sigma lies below the sample's, in every reading of its noise. The sample is "
        "charged with its bias, as in the publication; without bias it is the sample less its estimated bias."
    )
    return [Text(note), table(shown, "Readings of one datasheet side by side.")]


def observed_table(tables: Tables) -> list[Block]:
    """Return the ranks of a campaign that asked for windows of flight, case by case."""
    if not (tables.campaign.get("covariance") or {}).get("window"):
        return []
    frame = METRICS["observed"](tables)
    frame.columns = [
        "case", "stretches", "states", "least rank", "least rank with information", "smallest singular value (-)",
        "position against its bias (-)",
        "weakest direction",
    ]  # fmt: skip
    tolerance = float(tables.observability.tolerance_ratio.iloc[0])
    note = (
        "Singular values of the rows of a stretch, each in sigmas of its noise, states in initial sigmas; rate and "
        "acceleration taken for constant over it. Rank: values above 1e-10 of the largest. With information: above "
        f"{tolerance:g}; 1 halves a direction's variance. Last column: the smallest value of a direction in which "
        "a position trades with its bias."
    )
    return [Text(note), table(frame, "Least of all stretches.")]


def motion(tables: Tables) -> list[Block]:
    """Return rate and acceleration of every case that estimates them."""
    blocks = motion_table(tables)
    outputs = tables.outputs
    for case in tables.labels:
        for quantity in ("rate", "acceleration"):
            if ((outputs.case == case) & (outputs.quantity == quantity)).any():
                caption = f"{tables.labels[case]}: {quantity}, raw and filtered."
                blocks.append(picture(f"motion-{case}-{quantity}", PLOTS["motion"](tables, case, quantity), caption))
    return blocks


def control_tables(tables: Tables, brief: bool = False) -> list[Block]:
    """Return nozzle movement by burn with paired reductions, what it is worth, and the motion in its envelopes.

    In brief: burns and envelopes only of cases that have the card's rate gain.
    """
    moved, turned = METRICS["nozzle"](tables), METRICS["turning"](tables)
    if moved.empty:
        return []
    if brief:
        scaled = [label for case, label in tables.labels.items() if _rate_gain(tables, case) != 1.0]
        moved, turned = moved[~moved.case.isin(scaled)], turned[~turned.case.isin(scaled)]
    shown = pd.DataFrame(
        {
            "case": moved.case,
            "burn": moved.burn,
            "axis": moved.axis,
            "runs": moved.runs,
            "raw (deg)": moved.raw_deg,
            "filtered (deg)": moved.filtered_deg,
            "true (deg)": moved.true_deg,
            "less with filtered (%)": moved.less_percent,
            "95 %": moved.low_percent.map(number) + " to " + moved.high_percent.map(number),
        }
    )
    note = (
        "Mean over runs of the total movement of the nozzle, with the raw, the filtered and the true rate fed to the "
        "controller on the same draws of wind, gusts and noise. Reduction: one minus the geometric mean of the runs' "
        "ratios, Student's t on their logarithms; it spans draws, not what is assumed of vehicle, gains and wind."
    )
    blocks: list[Block] = [Text(note), table(shown, "Nozzle movement; flight: all burns together.")]
    gain = METRICS["worth"](tables)
    gain.columns = [
        "case", "axis", "raw (deg)", "filtered (deg)", "true (deg)", "less with filtered (%)", "low (%)", "high (%)",
        "less with the true rate (%)", "attitude error, raw (mrad)", "filtered (mrad)", "true (mrad)",
    ]  # fmt: skip
    worth = (
        "What the filtered rate is worth over the flight, compared with the true rate: the most that there is to gain."
    )
    blocks.append(table(gain, f"{worth} Attitude: in burns, RMS."))
    kept = turned[turned.feed == "filtered"].drop(columns="feed")
    kept.columns = [
        "case", "axis", "phase", "acceleration inside (% of ticks)", "furthest (times)", "jerk inside (% of ticks)",
        "furthest jerk (times)", "attitude error (mrad)", "rate error (deg/h)", "filter's sigma (deg/h)",
    ]  # fmt: skip
    blocks.append(table(kept, "True motion against its envelopes and errors in the loop, filtered rate fed."))
    return blocks


def _rate_gain(tables: Tables, case: str) -> float:
    """Return the rate gain of a case over that of its card."""
    levels = json.loads(str(tables.cases.set_index("case")["axes"][case]))
    return float(levels.get("rate_gain", 1.0))


def control(tables: Tables) -> list[Block]:
    """Return the vehicle under control: tables, and figures of every case."""
    blocks = control_tables(tables)
    if not blocks:
        return []
    if tables.cases["axes"].str.contains("rate_gain", regex=False).any():
        caption = "How much less the nozzle moves with the filtered rate, over the rate gain; 50 to 85 % shaded."
        blocks.append(picture("nozzle-sweep", PLOTS["sweep"](tables), caption))
    for case in list(tables.labels)[:4]:
        label = tables.labels[case]
        blocks.append(picture(f"nozzle-{case}", PLOTS["movement"](tables, case), f"{label}: movement of the nozzle."))
        drawn = PLOTS["turning"](tables, case)
        blocks.append(picture(f"turning-{case}", drawn, f"{label}: motion in its envelopes, one run, pitch."))
    return blocks
