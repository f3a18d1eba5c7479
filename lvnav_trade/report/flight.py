"""Sections on the flight and on the injection under guidance."""

import pandas as pd

from lvnav_trade.report.blocks import (
    Block,
    Text,
    chosen_cases,
    few,
    figure,
    figures,
    left_out,
    number,
    of,
    stated,
    words,
)
from lvnav_trade.report.escape import note
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.tables.read import Tables

_SIDE_BY_SIDE = 6  # largest number of cases side by side in a table


@of("orbit", "No case ends in an orbit that clears the ground.")
def orbit(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the orbit at the final event with the errors of its estimate, and the correction manoeuvre."""
    blocks: list[Block] = [Text(note("orbit")), *left_out(tables)]
    for case, label in chosen_cases(tables).items():
        elements = frame[frame.case == label]
        if elements.empty:
            blocks.append(Text(f"{label}: the flight does not end in an orbit."))
            continue
        for event, rows in elements.groupby("event", sort=False):
            columns = rows if rows.runs.max() > 0 else rows.drop(columns=["mc_sigma", "mc_bias", "mc_q99"])
            blocks.append(stated("orbit", columns, label=label, event=words(event)))
            blocks += [Text(f"{why}.", "Not applicable.") for why in dict.fromkeys(rows.remark) if why]
        blocks += [figure(tables, "orbit", case), *_not_gaussian(tables, label)]
    return [*blocks, Text(note("correction")), stated("correction", METRICS["orbit_correction"](tables))]


def _not_gaussian(tables: Tables, label: str) -> list[Block]:
    """Return a note on the orbital elements whose errors the ellipse of the figure does not describe."""
    frame = METRICS["normality"](tables)
    rows = frame[(frame.case == label) & ~frame.gaussian.astype(bool)]
    if rows.empty:
        return []
    skewed = ", ".join(f"{row.quantity} (skewness {row.skewness:+.2g})" for row in rows.itertuples())
    chance = f"chance below {rows.p_ratio.max():.1g} for a Gaussian" if rows.p_ratio.max() > 0.0 else "no Gaussian"
    text = f"The errors of {skewed} are not Gaussian ({rows.runs.iloc[0]} runs, {chance}): "
    return [
        Text(f"{text}the 3-sigma ellipse, a first-order covariance, does not describe them; quantiles do.", "Warning:")
    ]


@of("impact", "No stored state of any case has a point of impact.")
def impact(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the impact points with their ellipses, and the verdict on the corridor."""
    blocks: list[Block] = [Text(note("impact")), *_corridor(tables), *left_out(tables)]
    for case, label in chosen_cases(tables).items():
        rows = frame[(frame.case == label) & (frame.event != "")]
        if len(rows):
            axes = rows.major_3sigma_km.map(number) + " x " + rows.minor_3sigma_km.map(number)
            columns = rows if rows.runs.max() > 1 else rows[[name for name in rows if not name.startswith("mc_")]]
            blocks.append(stated("impact", columns.assign(axes=axes), label=label))
        if (frame.case == label).any():
            blocks.append(figure(tables, "impact", case))
    return blocks


@of("corridor")
def _corridor(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    frame = frame.assign(least=100.0 * frame.expected_probability, remark=frame.reason.fillna(""))
    return [Text(note("corridor")), stated("corridor", frame)]


@of("rate_and_acceleration")
def motion_table(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return by how much the estimates of rate and acceleration improve on the raw samples, and whether the errors
    match the filter's covariance.
    """
    return [Text(note("motion")), stated("motion", _by_axis(frame))]


def _by_axis(frame: pd.DataFrame) -> pd.DataFrame:
    return frame.assign(error=frame.metric.str.replace("_error", "") + " " + frame.axis)


def motion_summary(tables: Tables) -> list[Block]:
    """Return a summary for cases that estimate rate and acceleration: the range over the phases, and the counts of
    verdicts.

    The result is empty without runs, and for a vehicle under control, for which the nozzle movement decides.
    """
    frame = METRICS["rate_and_acceleration"](tables)
    if len(tables.nozzle_travel) or not tables.cases.run_count.any():
        return []
    outputs = tables.outputs
    estimated = set(outputs.case[outputs.quantity == "rate"].map(tables.labels))
    frame = frame[frame.case.isin(estimated)]
    if frame.empty:
        return []
    rows = []
    for (case, error), case_rows in _by_axis(frame).groupby(["case", "error"], sort=False):
        low, high = (
            (case_rows.low / case_rows.over_sigma_ratio).min(),
            (case_rows.high / case_rows.over_sigma_ratio).max(),
        )
        counts = case_rows.verdict.value_counts().items()
        ranges = [
            _range(case_rows[name]) for name in ("reduction_percent", "formal_reduction_percent", "over_sigma_ratio")
        ]
        verdicts = ", ".join(f"{name} in {count} of {len(case_rows)}" for name, count in counts)
        rows.append((case, error, *ranges, f"times {number(low)} to {number(high)}", verdicts))
    phases = stated("motion_summary", pd.DataFrame(rows))
    return [Text(note("motion_summary")), phases]


def _range(values: pd.Series) -> str:
    return f"{number(values.min())} to {number(values.max())}"


def observed_table(tables: Tables) -> list[Block]:
    """Return the observability ranks in the requested windows of the flight, case by case."""
    if not (tables.campaign.get("covariance") or {}).get("window"):
        return []
    tolerance = float(tables.observability.tolerance_ratio.iloc[0])
    return [Text(note("observed", tolerance=tolerance)), stated("observed", METRICS["observability_ranks"](tables))]


def motion(tables: Tables) -> list[Block]:
    """Return tables and figures of rate and acceleration for every case that estimates them."""
    estimated = set(zip(tables.outputs.case, tables.outputs.quantity, strict=True))
    return motion_table(tables) + [
        figure(tables, "motion", case, quantity)
        for case in tables.labels
        for quantity in ("rate", "acceleration")
        if (case, quantity) in estimated
    ]


@of("allan")
def allan(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the Allan deviations of the IMUs at the averaging times nearest to whole decades.

    Cases with the same IMU share a row.
    """
    decades = [10.0**k for k in range(-2, 5)]
    nearest = [
        int((curve.tau_s / t - 1.0).abs().idxmin())
        for _, curve in frame.groupby(["case", "sensor"], sort=False)
        for t in decades
        if curve.tau_s.min() / 1.5 < t < 1.5 * curve.tau_s.max()
    ]
    deviations = stated("allan", frame.loc[list(dict.fromkeys(nearest))], alike=True)
    cases = [case for case, label in chosen_cases(tables).items() if label in set(frame.case)]
    return [Text(note("allan")), deviations, *(figure(tables, "allan", case) for case in cases)]


@of("exclusions")
def exclusions(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the excluded IMUs, with the number of runs and the times."""
    percents = frame.assign(share=100.0 * frame.share_ratio, low=100.0 * frame.low_ratio, high=100.0 * frame.high_ratio)
    return [Text(note("exclusions")), stated("exclusions", percents)]


@of("protection")
def protection(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the protection levels of every case, the rate at which errors of the runs exceed them, and figures of
    both.
    """
    card = tables.campaign["covariance"]["protection"]
    stated_numbers = {name: f"{float(value):g}" for name, value in card.items()}
    percents = frame.assign(low=100.0 * frame.low_ratio, high=100.0 * frame.high_ratio)
    cases = [case for case, label in chosen_cases(tables).items() if label in set(frame.case)]
    drawn = [figure(tables, "protection", case) for case in cases]
    return [Text(note("protection", **stated_numbers)), stated("protection", percents), *left_out(tables), *drawn]


def control_tables(tables: Tables, brief: bool = False) -> list[Block]:
    """Return the nozzle movement by burn with paired reductions, the effect of the filtered rate, and the motion
    compared with its envelopes.

    brief : only burns and envelopes, of cases with the rate gain of the card
    """
    moved, turned = METRICS["nozzle_travel"](tables), METRICS["motion_statistics"](tables)
    if moved.empty:
        return []
    if brief:
        gains = {case: float(levels.get("rate_gain", 1.0)) for case, levels in tables.levels.items()}
        scaled = [tables.labels[case] for case, gain in gains.items() if gain != 1.0]
        moved, turned = moved[~moved.case.isin(scaled)], turned[~turned.case.isin(scaled)]
    filtered = turned[turned.controller_rate == "filtered"].drop(columns="controller_rate")
    tabled = (("nozzle", moved), ("worth", METRICS["rate_filter_benefit"](tables)), ("turning", filtered))
    return [Text(note("nozzle")), *(stated(name, frame) for name, frame in tabled)]


def control(tables: Tables) -> list[Block]:
    """Return tables and figures of the vehicle under control."""
    blocks = control_tables(tables)
    if not blocks:
        return []
    if any("rate_gain" in levels for levels in tables.levels.values()):
        blocks.append(figure(tables, "sweep", name="nozzle-sweep"))
    plots = (("movement", "nozzle"), ("turning", ""))
    return blocks + [figure(tables, plot, case, name=name) for case in list(tables.labels)[:4] for plot, name in plots]


_LOST_SHOWN = 10  # runs listed for each case among those that miss their cut-off
_LEAST_SHARE = 0.01  # smallest share of the variance of a source in the table
_SHOWN = ("semi_major_axis", "eccentricity_along_node", "eccentricity_ahead_of_node", "inclination")  # in the report


@of("injection")
def injection(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the errors of the achieved orbits with their contributions, how the runs end, and figures."""
    ends = METRICS["cutoff"](tables)
    spread = ends.low_ratio.map("{:.3g}".format) + " to " + ends.high_ratio.map("{:.3g}".format)
    spread = spread.where(ends.runs > 0, "-")
    lost = METRICS["failed_injections"](tables).groupby("case", sort=False).head(_LOST_SHOWN)
    sources = METRICS["injection_sources"](tables)
    large = sources.quantity.isin(_SHOWN) & ~(sources.share_ratio < _LEAST_SHARE)
    budget = [stated("injection_sources", sources[large])] if large.any() else []
    expected = frame[frame.reason != ""].drop_duplicates(["case", "reason"])
    reasons = [Text(f"{row.case}: linear covariance does not apply ({row.reason}).") for row in expected.itertuples()]
    guided, more = few([case for case, label in tables.labels.items() if label in set(ends.case)])
    return [
        Text(note("injection")),
        stated("injection", frame),
        *reasons,
        *budget,
        stated("cutoff", ends.assign(interval=spread)),
        *([stated("lost", lost)] if len(lost) else []),
        *figures(tables, "injection", guided),
        *more,
    ]
