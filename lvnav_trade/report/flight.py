"""Sections on the flight and on the injection under guidance."""

import pandas as pd

from lvnav_trade.report.blocks import (
    Block,
    Picture,
    Text,
    figure,
    figures,
    formatted_table,
    number,
    table_section,
    words,
)
from lvnav_trade.report.escape import note
from lvnav_trade.report.selection import chosen_cases, first_cases, omission_note
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.tables.read import Tables

_CONTROL_CASES = 4  # largest number of cases with figures of the vehicle under control


@table_section("orbit", "No case ends in an orbit that clears the ground.")
def orbit(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the orbit at the final event with the errors of its estimate, and the correction manoeuvre."""
    blocks: list[Block] = [Text(note("orbit")), *omission_note(tables)]
    for case, label in chosen_cases(tables).items():
        elements = frame[frame.case == label]
        if elements.empty:
            blocks.append(Text(f"{label}: the flight does not end in an orbit."))
            continue
        for event, rows in elements.groupby("event", sort=False):
            has_runs = rows.runs.max() > 0
            columns = rows if has_runs else rows.drop(columns=["mc_sigma", "mc_bias", "mc_q99"])
            blocks.append(formatted_table("orbit", columns, label=label, event=words(event)))
            for reason in dict.fromkeys(rows.remark):
                if reason:
                    blocks.append(Text(f"{reason}.", "Not applicable."))
        blocks.append(figure(tables, "orbit", case))
        blocks += _normality_warning(tables, label)
    blocks.append(Text(note("correction")))
    corrections = METRICS["orbit_correction"](tables)
    blocks.append(formatted_table("correction", corrections))
    return blocks


def _normality_warning(tables: Tables, label: str) -> list[Block]:
    """Return a note on the orbital elements whose errors the ellipse of the figure does not describe."""
    frame = METRICS["normality"](tables)
    rows = frame[(frame.case == label) & ~frame.gaussian.astype(bool)]
    if rows.empty:
        return []
    skewed_errors = [f"{row.quantity} (skewness {row.skewness:+.2g})" for row in rows.itertuples()]
    error_list = ", ".join(skewed_errors)
    p_value = rows.p_ratio.max()
    chance = f"chance below {p_value:.1g} for a Gaussian" if p_value > 0.0 else "no Gaussian"
    text = (
        f"The errors of {error_list} are not Gaussian ({rows.runs.iloc[0]} runs, {chance}): "
        "the 3-sigma ellipse, a first-order covariance, does not describe them; quantiles do."
    )
    return [Text(text, "Warning:")]


@table_section("impact", "No stored state of any case has a point of impact.")
def impact(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the impact points with their ellipses, and the verdict on the corridor."""
    blocks: list[Block] = [Text(note("impact")), *_corridor(tables), *omission_note(tables)]
    for case, label in chosen_cases(tables).items():
        case_rows = frame[frame.case == label]
        events = case_rows[case_rows.event != ""]
        if len(events):
            major = events.major_3sigma_km.map(number)
            minor = events.minor_3sigma_km.map(number)
            axes = major + " x " + minor
            if events.runs.max() <= 1:
                columns = [name for name in events if not name.startswith("mc_")]
                events = events[columns]
            blocks.append(formatted_table("impact", events.assign(axes=axes), label=label))
        if len(case_rows):
            blocks.append(figure(tables, "impact", case))
    return blocks


@table_section("corridor")
def _corridor(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    rows = frame.assign(
        least=100.0 * frame.expected_probability,
        remark=frame.reason.fillna(""),
    )
    return [Text(note("corridor")), formatted_table("corridor", rows)]


@table_section("rate_and_acceleration")
def motion_table(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return by how much the estimates of rate and acceleration improve on the raw samples, and whether the errors
    match the filter's covariance.
    """
    return [Text(note("motion")), formatted_table("motion", _name_errors(frame))]


def _name_errors(frame: pd.DataFrame) -> pd.DataFrame:
    """Return rows with the quantity and the axis of their error in one column."""
    return frame.assign(error=frame.metric.str.replace("_error", "") + " " + frame.axis)


def motion_summary(tables: Tables) -> list[Block]:
    """Return a summary for cases that estimate rate and acceleration: the range over the phases, and the counts of
    verdicts.

    The result is empty without runs, and for a vehicle under control, for which the nozzle movement decides.
    """
    if len(tables.nozzle_travel) or not tables.cases.run_count.any():
        return []
    frame = METRICS["rate_and_acceleration"](tables)
    outputs = tables.outputs
    estimating_cases = set(outputs.case[outputs.quantity == "rate"].map(tables.labels))
    frame = frame[frame.case.isin(estimating_cases)]
    if frame.empty:
        return []
    lines = []
    for (case, error), rows in _name_errors(frame).groupby(["case", "error"], sort=False):
        low = (rows.low / rows.over_sigma_ratio).min()
        high = (rows.high / rows.over_sigma_ratio).max()
        counts = rows.verdict.value_counts()
        verdicts = [f"{name} in {count} of {len(rows)}" for name, count in counts.items()]
        lines.append(
            (
                case,
                error,
                _range(rows.reduction_percent),
                _range(rows.formal_reduction_percent),
                _range(rows.over_sigma_ratio),
                f"times {number(low)} to {number(high)}",
                ", ".join(verdicts),
            )
        )
    return [Text(note("motion_summary")), formatted_table("motion_summary", pd.DataFrame(lines))]


def _range(values: pd.Series) -> str:
    return f"{number(values.min())} to {number(values.max())}"


def observed_table(tables: Tables) -> list[Block]:
    """Return the observability ranks in the requested windows of the flight, case by case."""
    if not (tables.campaign.get("covariance") or {}).get("window"):
        return []
    tolerance = float(tables.observability.tolerance_ratio.iloc[0])
    return [
        Text(note("observed", tolerance=tolerance)),
        formatted_table("observed", METRICS["observability_ranks"](tables)),
    ]


def motion(tables: Tables) -> list[Block]:
    """Return tables and figures of rate and acceleration for every case that estimates them."""
    estimated_quantities = set(zip(tables.outputs.case, tables.outputs.quantity, strict=True))
    blocks = motion_table(tables)
    for case in tables.labels:
        for quantity in ("rate", "acceleration"):
            if (case, quantity) in estimated_quantities:
                blocks.append(figure(tables, "motion", case, quantity))
    return blocks


@table_section("allan")
def allan(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the Allan deviations of the IMUs at the averaging times nearest to whole decades.

    Cases with the same IMU share a row.
    """
    nearest = []
    for _, curve in frame.groupby(["case", "sensor"], sort=False):
        for exponent in range(-2, 5):
            t = 10.0**exponent
            if curve.tau_s.min() / 1.5 < t < 1.5 * curve.tau_s.max():
                distance = (curve.tau_s / t - 1.0).abs()
                nearest.append(int(distance.idxmin()))
    rows = frame.loc[list(dict.fromkeys(nearest))]
    deviations = formatted_table("allan", rows, combines_cases=True)
    pictures = _case_pictures(tables, "allan", frame)
    return [Text(note("allan")), deviations, *pictures]


def _case_pictures(tables: Tables, plot: str, frame: pd.DataFrame) -> list[Picture]:
    """Return a figure of each chosen case that has rows in a frame."""
    labels = set(frame.case)
    pictures = []
    for case, label in chosen_cases(tables).items():
        if label in labels:
            pictures.append(figure(tables, plot, case))
    return pictures


@table_section("exclusions")
def exclusions(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the excluded IMUs, with the number of runs and the times."""
    percents = frame.assign(
        share=100.0 * frame.share_ratio,
        low=100.0 * frame.low_ratio,
        high=100.0 * frame.high_ratio,
    )
    return [Text(note("exclusions")), formatted_table("exclusions", percents)]


@table_section("protection")
def protection(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the protection levels of every case, the rate at which errors of the runs exceed them, and figures of
    both.
    """
    card = tables.campaign["covariance"]["protection"]
    numbers = {name: f"{float(value):g}" for name, value in card.items()}
    percents = frame.assign(low=100.0 * frame.low_ratio, high=100.0 * frame.high_ratio)
    pictures = _case_pictures(tables, "protection", frame)
    return [
        Text(note("protection", **numbers)),
        formatted_table("protection", percents),
        *omission_note(tables),
        *pictures,
    ]


def control_tables(tables: Tables, brief: bool = False) -> list[Block]:
    """Return the nozzle movement by burn with paired reductions, the effect of the filtered rate, and the motion
    compared with its envelopes.

    brief : only burns and envelopes, of cases with the rate gain of the card
    """
    travel = METRICS["nozzle_travel"](tables)
    motion_rows = METRICS["motion_statistics"](tables)
    if travel.empty:
        return []
    if brief:
        scaled_cases = [
            tables.labels[case] for case, levels in tables.levels.items() if float(levels.get("rate_gain", 1.0)) != 1.0
        ]
        travel = travel[~travel.case.isin(scaled_cases)]
        motion_rows = motion_rows[~motion_rows.case.isin(scaled_cases)]
    filtered_rows = motion_rows[motion_rows.controller_rate == "filtered"].drop(columns="controller_rate")
    return [
        Text(note("nozzle")),
        formatted_table("nozzle", travel),
        formatted_table("worth", METRICS["rate_filter_benefit"](tables)),
        formatted_table("turning", filtered_rows),
    ]


def control(tables: Tables) -> list[Block]:
    """Return tables and figures of the vehicle under control."""
    blocks = control_tables(tables)
    if not blocks:
        return []
    if any("rate_gain" in levels for levels in tables.levels.values()):
        blocks.append(figure(tables, "sweep", name="nozzle-sweep"))
    for case in list(tables.labels)[:_CONTROL_CASES]:
        blocks.append(figure(tables, "movement", case, name="nozzle"))
        blocks.append(figure(tables, "turning", case))
    return blocks


_LOST_SHOWN = 10  # runs listed for each case among those that miss their cut-off
_LEAST_SHARE = 0.01  # smallest share of the variance of a source in the table
_SHOWN = ("semi_major_axis", "eccentricity_along_node", "eccentricity_ahead_of_node", "inclination")  # in the report


@table_section("injection")
def injection(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the errors of the achieved orbits with their contributions, how the runs end, and figures."""
    blocks: list[Block] = [Text(note("injection")), formatted_table("injection", frame)]
    inapplicable = frame[frame.reason != ""]
    for row in inapplicable.drop_duplicates(["case", "reason"]).itertuples():
        blocks.append(Text(f"{row.case}: linear covariance does not apply ({row.reason})."))
    sources = METRICS["injection_sources"](tables)
    is_small = sources.share_ratio < _LEAST_SHARE
    is_large = sources.quantity.isin(_SHOWN) & ~is_small
    if is_large.any():
        blocks.append(formatted_table("injection_sources", sources[is_large]))

    ends = METRICS["cutoff"](tables)
    low = ends.low_ratio.map("{:.3g}".format)
    high = ends.high_ratio.map("{:.3g}".format)
    interval = (low + " to " + high).where(ends.runs > 0, "-")
    blocks.append(formatted_table("cutoff", ends.assign(interval=interval)))
    failed_injections = METRICS["failed_injections"](tables)
    shown_failures = failed_injections.groupby("case", sort=False).head(_LOST_SHOWN)
    if len(shown_failures):
        blocks.append(formatted_table("lost", shown_failures))
    labels = set(ends.case)
    guided_cases = [case for case, label in tables.labels.items() if label in labels]
    shown_cases, remark = first_cases(guided_cases)
    pictures = figures(tables, "injection", shown_cases)
    return [*blocks, *pictures, *remark]
