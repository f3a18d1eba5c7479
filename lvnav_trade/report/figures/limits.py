"""Limits of requirements in figures of errors, and the quantiles of the runs that they bound."""

from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.quantities.state_layout import split_metric
from lvnav_trade.report.figures.figure import Figure, Panel, panel
from lvnav_trade.report.figures.style import PALETTE, drawing, over_time, scale_up
from lvnav_trade.results.metric import event_or_phase
from lvnav_trade.results.requirements.margins import margins
from lvnav_trade.results.statistics.case_results import parse_number
from lvnav_trade.results.statistics.case_tables import CaseTables
from lvnav_trade.results.statistics.select import history_of, pick
from lvnav_trade.results.tables.read import Tables

# Lower and upper quantile of a band, opacity, legend entry
_BANDS = (
    ("q50_si", "q95_si", 0.28, "50 to 95 % of runs"),
    ("q95_si", "q997_si", 0.14, "95 to 99.7 % of runs"),
)
_QUANTILE = "quantile that the limit bounds"


class Limit(NamedTuple):
    """Limit of a requirement on one error, in the display unit.

    requirement : Name of the requirement.
    value : The limit.
    event : Event at which it applies; empty if it applies during a phase of flight.
    label : Fraction of runs, limit, unit and place.
    """

    requirement: str
    value: float
    event: str
    label: str


def limits_of(tables: Tables, case: str, quantity: str, axis: str = "3d") -> list[Limit]:
    """Return the limits of all requirements on one error of a case, in display units.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    quantity, axis : str
        Quantity and axis of the error, such as "velocity" and "3d".
    """
    limits = []
    for requirement in tables.campaign.get("requirements") or ():
        error = CaseTables(tables, case).output(quantity, axis)
        if error is None or split_metric(str(requirement["metric"])) != (quantity, axis):
            continue
        place = event_or_phase(requirement)
        value = parse_number(requirement["below"], error.unit) * error.label_factor
        percent = f"{100.0 * float(requirement['probability']):.6g} % of runs"
        limit = Limit(
            requirement=str(requirement["name"]),
            value=value,
            event="" if requirement.get("during") else place,
            label=f"limit: {percent} below {value:.4g} {error.label_unit}, {place.replace('_', ' ')}",
        )
        limits.append(limit)
    return limits


def mark_limits(ax: Panel, tables: Tables, case: str, quantity: str) -> list[float]:
    """Draw the limits of a 3-D error over time, each with a marker at its event.

    Returns
    -------
    list of float
        The limits, in display units.
    """
    limits = limits_of(tables, case, quantity)
    for limit in limits:
        style: dict[str, Any] = {"color": "black", "group": limit.label}
        ax.axhline(limit.value, ls=(0, (5, 2)), lw=1.0, label=limit.label, **style)
        events = pick(tables.events, case=case, event=limit.event)
        times = events.t_s
        values = np.full(len(times), limit.value)
        ax.plot(times, values, ls="none", marker="v", ms=6, **style)
    return [limit.value for limit in limits]


def mark_quantiles(ax: Panel, tables: Tables, frame: pd.DataFrame, quantity: str) -> list[float]:
    """Draw the limits of requirements across the bars of a ranking, and on each bar the quantile that the limit bounds.

    Parameters
    ----------
    ax : Panel
        Panel with the bars.
    tables : Tables
        Tables of the results.
    frame : pandas.DataFrame
        Rows of the ranking, one per bar, with the columns case and event.
    quantity : str
        Quantity of the error.

    Returns
    -------
    list of float
        All drawn values, in display units.
    """
    digests = {label: case for case, label in tables.labels.items()}
    case = digests.get(frame.case.iloc[0])
    if case is None:
        return []
    all_margins = margins(tables)
    values: list[float] = []
    for limit in limits_of(tables, case, quantity):
        if limit.event != frame.event.iloc[0]:
            continue
        of_requirement = all_margins[all_margins.requirement == limit.requirement].set_index("case")
        estimates = of_requirement.estimate.reindex(frame.case).to_numpy(dtype=float)
        estimates = np.where(np.isfinite(estimates), estimates, np.nan)
        ax.axvline(limit.value, color="black", ls=(0, (5, 2)), lw=1.0, label=limit.label)
        ax.plot(
            estimates,
            np.arange(len(frame)),
            ls="none",
            marker="D",
            ms=4.5,
            color=PALETTE[1],
            label=_QUANTILE,
        )
        values += [limit.value, *estimates[np.isfinite(estimates)]]
    return values


@drawing
def quantiles(tables: Tables, case: str, quantity: str) -> Figure:
    """Draw the quantiles of a 3-D error over the runs of a case, its RMS, and the limits of requirements on it."""
    unit, factor = tables.display_units[quantity, "3d"]
    rows = history_of(tables, case, quantity, "3d")
    figure, ax = panel(2.6)
    for low, high, alpha, label in _BANDS:
        ax.fill_between(
            rows.t_s,
            rows[low] * factor,
            rows[high] * factor,
            color=PALETTE[0],
            alpha=alpha,
            label=label,
        )
    rms = rows.rms_si * factor
    ax.plot(rows.t_s, rows.q95_si * factor, color=PALETTE[0], lw=1.2, label="95 % of runs")
    ax.plot(rows.t_s, rms, color="black", ls="--", lw=1.1, label="RMS")
    limits = mark_limits(ax, tables, case, quantity)
    scale_up(ax, "y", [*rms, *(rows.q997_si * factor), *limits])
    ax.set(ylabel=f"{quantity} error,\n3D ({unit})")
    over_time([ax], tables, case)
    return figure
