"""The sections on the mission: orbit at injection and its correction, point of impact and corridor."""

from __future__ import annotations

import pandas as pd

from lvnav_trade.metrics import METRICS
from lvnav_trade.plots import PLOTS
from lvnav_trade.report.blocks import Block, Text, number, percent, picture, table
from lvnav_trade.report.evidence import chosen_cases, left_out
from lvnav_trade.store import Tables


def orbit(tables: Tables) -> list[Block]:
    """Return the orbit at the final event with the errors of its estimate, and the correction."""
    frame, cost = METRICS["orbit"](tables), METRICS["correction"](tables)
    if frame.empty:
        return [Text("No case ends in an orbit that clears the ground.")]
    note = (
        "Errors are those of the estimated orbit, true less estimated; where guidance steers by the "
        "estimate they are, with their sign turned, the errors of the injection. Averaged: over one revolution, with "
        "the short-periodic swing that J2 gives to osculating elements taken out; errors are of averaged elements, "
        "heights count from the equatorial radius. Lowest and highest height are those of the first revolution. "
        "Sigma: first order, of the joint covariance of velocity and position. Where an orbit is circular to within "
        "three sigma, perigee, apogee and eccentricity have no derivative and no Gaussian error: their sigma is not "
        "applicable, the 99 % quantile (draws through the map itself) and the eccentricity vector stand."
    )
    blocks: list[Block] = [Text(note), *left_out(tables)]
    for case in chosen_cases(tables):
        label = tables.labels[case]
        mine = frame[frame.case == label]
        if mine.empty:
            blocks.append(Text(f"{label}: the flight does not end in an orbit."))
            continue
        for event, rows in mine.groupby("event", sort=False):
            blocks.append(table(_orbit_table(rows), f"{label}: orbit at {str(event).replace('_', ' ')}."))
            blocks += [Text(f"{why}.", "Not applicable.") for why in dict.fromkeys(rows.remark) if why]
        blocks.append(picture(f"orbit-{case}", PLOTS["orbit"](tables, case), f"{label}: errors of the orbit."))
    shown = cost.assign(event=cost.event.str.replace("_", " ")).rename(
        columns={
            "q50": "50 %", "q95": "95 %", "q99": "99 %", "velocity_q99": "99 %, velocity error alone",
            "position_q99": "99 %, position error alone", "count": "draws or runs",
        }
    )  # fmt: skip
    what = (
        "Correction: the least sum of impulses, anywhere in one revolution and linear in the error, that nulls the "
        "errors of semi-major axis, eccentricity, perigee, inclination and node; the place along the orbit is left. "
        "Good to half a percent, from above."
    )
    return [*blocks, Text(what), table(shown, "Delta-v of the correction: quantiles over flights.")]


def _orbit_table(rows: pd.DataFrame) -> pd.DataFrame:
    shown = pd.DataFrame(
        {
            "quantity": rows.quantity,
            "unit": rows.unit,
            "osculating": rows.osculating.map(_exact),
            "averaged": rows.averaged.map(_exact),
            "sigma, LinCov": rows.lincov_sigma,
            "filter's own": rows.filter_sigma,
            "99 %, LinCov": rows.lincov_q99,
        }
    )
    if rows.runs.max() > 0:
        shown["sigma, runs"], shown["mean, runs"], shown["99 %, runs"] = rows.mc_sigma, rows.mc_bias, rows.mc_q99
    return shown


def _exact(value: float) -> str:
    """Write an element with seven digits: three would tell nothing of an orbit."""
    return f"{value:.7g}" if value == value else "–"


def impact(tables: Tables) -> list[Block]:
    """Return the points of impact with their ellipses, and the verdict on the corridor."""
    frame = METRICS["impact"](tables)
    if frame.empty:
        return [Text("No stored state of any case has a point of impact.")]
    note = (
        "Where the vehicle would come down if its thrust ended: free fall without air, J2 and the turning Earth "
        "included. None below 1 km of height, nor where the orbit clears the ground. The error is the true point less "
        "the estimated one, down-range along the velocity over the ground at impact. Ellipse: three sigma, which hold "
        "98.9 % of a Gaussian. All times: impact.csv."
    )
    blocks: list[Block] = [Text(note), *_corridor(tables), *left_out(tables)]
    for case in chosen_cases(tables):
        label = tables.labels[case]
        rows = frame[(frame.case == label) & (frame.event != "")]
        if len(rows):
            blocks.append(table(_impact_table(rows), f"{label}: point of impact at the events."))
        if (frame.case == label).any():
            caption = f"{label}: trace of the point of impact, its error over time, and that at the last event."
            blocks.append(picture(f"impact-{case}", PLOTS["impact"](tables, case), caption))
    return blocks


def _impact_table(rows: pd.DataFrame) -> pd.DataFrame:
    shown = pd.DataFrame(
        {
            "event": rows.event.str.replace("_", " "),
            "time (s)": rows.t_s.map(lambda t: f"{t:.1f}"),
            "latitude (deg)": rows.latitude_deg.map(lambda angle: f"{angle:.3f}"),
            "longitude (deg)": rows.longitude_deg.map(lambda angle: f"{angle:.3f}"),
            "fall (s)": rows.fall_s,
            "down, sigma (km)": rows.down_sigma_km,
            "cross, sigma (km)": rows.cross_sigma_km,
            "ellipse, 3 sigma (km)": [
                f"{number(a)} x {number(b)}" for a, b in zip(rows.major_3sigma_km, rows.minor_3sigma_km, strict=True)
            ],
        }
    )
    if rows.runs.max() > 1:
        shown["down, runs (km)"], shown["cross, runs (km)"] = rows.mc_down_sigma_km, rows.mc_cross_sigma_km
        shown["99 %, runs (km)"] = rows.mc_q99_km
    return shown


def _corridor(tables: Tables) -> list[Block]:
    frame = METRICS["corridor"](tables)
    if frame.empty:
        return []
    shown = pd.DataFrame(
        {
            "case": frame.case,
            "verdict by linear covariance": frame.verdict,
            "asked": frame.probability.map(percent),
            "least probable (%)": 100.0 * frame.expected_probability,
            "margin (sigma)": frame.margin_sigma,
            "at (s)": frame.t_s.map(lambda t: f"{t:.1f}"),
            "verdict by runs": frame.mc_verdict,
            "outside": frame.outside,
            "runs": frame.runs,
            "remark": frame.reason.fillna(""),
        }
    )
    note = (
        "Corridor: the estimated point of impact of a vehicle that flies as planned must stay inside. By linear "
        "covariance at the stored time where it is least probable, exact for that Gaussian and the polygon; by runs at "
        "the events, a failed run counting as outside, bounds exact binomial."
    )
    return [Text(note), table(shown, "The corridor.")]
