"""The errors of the orbit at injection: perigee and apogee, eccentricity vector, plane, and what a correction costs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from lvnav_trade.metrics.basics.select import final_event
from lvnav_trade.metrics.mechanics import impulses, meanorbit, mission
from lvnav_trade.metrics.mechanics.mission import Law, State
from lvnav_trade.plots.style import GREY, PALETTE, canvas, look
from lvnav_trade.store import Tables, load

Floats = NDArray[np.float64]

_PLANES = (
    (("perigee_error", 0, "perigee error"), ("apogee_error", 0, "apogee error")),
    (
        ("eccentricity_vector_error", 0, "eccentricity error\nalong the node"),
        ("eccentricity_vector_error", 1, "eccentricity error\nahead of the node"),
    ),
    (("node_error", 0, "node error"), ("inclination_error", 0, "inclination error")),
)


def orbit(results: Path | str | Tables, case: str) -> Figure:
    """Draw the errors of the mean orbit at the final event, true less estimated, in three planes, and the correction.

    Dots are runs; ellipses are three sigma by linear covariance, true and formal. Where the orbit is
    circular to within three sigma, perigee and apogee have draws of that Gaussian instead of an ellipse.
    """
    tables = load(results)
    event = final_event(tables, case)
    state, law = mission.state_at(tables, case, event), mission.law_at(tables, case, event)
    if state is None or law is None or not bool(meanorbit.osculating(state.r_i, state.v_i).elliptic):
        return _nothing()
    with look():
        figure, grid = canvas(2, 2, 2.9)
        error, failed = mission.run_errors(tables, case, state)
        good = error[~failed]
        for ax, pair in zip(grid.ravel()[:3], _PLANES, strict=True):
            _plane(ax, state, law, good, pair)
        _cost(grid[1, 1], state, law, good)
        handles, labels = grid[0, 1].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
        figure.suptitle(f"{tables.labels[case]}, {event.replace('_', ' ')}", fontsize=9)
    return figure


def _nothing() -> Figure:
    with look():
        figure, grid = canvas(1, 1, 1.6)
        ax = grid[0, 0]
        ax.text(0.5, 0.5, "the flight does not end in an orbit", transform=ax.transAxes, ha="center", color=GREY)
        ax.set_xlabel("perigee error (km)")
        ax.set_ylabel("apogee error (km)")
    return figure


def _plane(ax: Any, state: State, law: Law, good: Floats, pair: Any) -> None:
    units = [mission.people(metric)[1:] for metric, _, _ in pair]
    scale = np.array([factor for _, factor in units])
    if len(good):
        ax.plot(*_pair(state, good, pair, scale).T, ".", ms=2.5, color=PALETTE[0], label="runs", zorder=2)
    slope = np.stack([mission.jacobian(state, metric)[k] for metric, k, _ in pair]) * scale[:, None]
    reason = next((why for metric, _, _ in pair if (why := mission.applies(state, metric, law.true))), "")
    if reason:
        drawn = _pair(state, mission.draws(law.mean, law.true, 512), pair, scale)
        ax.plot(*drawn.T, "x", ms=2.5, color=PALETTE[1], label="draws of LinCov", zorder=1.5)
        ax.set_title("no first-order sigma: circular to within 3 sigma", fontsize=7.5)
    else:
        centre = slope @ law.mean
        outline = outline_of(slope @ law.true @ slope.T)
        ax.plot(*(centre + outline).T, color=PALETTE[1], ls="--", label="LinCov, true, 3 sigma", zorder=3)
        ax.plot(*outline_of(slope @ law.formal @ slope.T).T, "k:", label="LinCov, filter's own, 3 sigma", zorder=3)
    ax.set_xlabel(f"{pair[0][2].replace(chr(10), ' ')} ({units[0][0]})")
    ax.set_ylabel(f"{pair[1][2]} ({units[1][0]})")
    ax.ticklabel_format(style="sci", scilimits=(-3, 4), axis="both")
    ax.margins(0.08)


def _pair(state: State, error: Floats, pair: Any, scale: Floats) -> Floats:
    return np.stack([mission.signed(state, error, metric)[:, k] for metric, k, _ in pair], axis=1) * scale


def outline_of(covariance: Floats, sigmas: float = 3.0, points: int = 97) -> Floats:
    """Return the ellipse (points, 2) of so many sigmas of a covariance (2, 2)."""
    variance, axes = np.linalg.eigh(covariance)
    angle = np.linspace(0.0, 2.0 * np.pi, points)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    return np.asarray((axes * (sigmas * np.sqrt(np.maximum(variance, 0.0))) @ circle).T)


def _cost(ax: Any, state: State, law: Law, good: Floats) -> None:
    """Draw which part of flights a correction of so much would do for."""
    parts = [("LinCov", mission.draws(law.mean, law.true, 1024), {"color": PALETTE[1], "ls": "--"})]
    if len(good):
        parts.insert(0, ("runs", good, {"color": PALETTE[0], "ls": "-"}))
    for name, error, style in parts:
        cost = np.sort(impulses.least_at(state.r_i, state.v_i, error).delta_v)
        part = np.arange(1, len(cost) + 1) / len(cost)
        label = f"{name}: 99 % below {np.quantile(cost, 0.99):.3g} m/s"
        ax.step(cost, 100.0 * part, where="post", label=label, **style)
    ax.axhline(99.0, color=GREY, lw=0.7, ls=":")
    ax.set_xlim(0)
    ax.set_ylim(0, 102)
    ax.set_xlabel("least delta-v of a correction (m/s)")
    ax.set_ylabel("flights (%)")
    ax.legend(loc="lower right", fontsize=7.5)
