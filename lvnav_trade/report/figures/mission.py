"""Figures of the mission: orbit, impact point, orbit correction, guided injection."""

import numpy as np
import pandas as pd

from lvnav_trade.quantities.records import INJECTION, Floats, InjectionLaw
from lvnav_trade.report.figures.figure import GREY, Figure, Panel, canvas
from lvnav_trade.report.figures.style import PALETTE, drawing, message, over_time, scale_up
from lvnav_trade.results.mechanics import mission_errors, orbits, stored_states
from lvnav_trade.results.mechanics.injection_law import APSIDES, apsis_errors, is_curved, why_no_law
from lvnav_trade.results.metrics.mission import MISSION
from lvnav_trade.results.mission.impact import corridor_of, ellipse, run_impacts
from lvnav_trade.results.mission.impact import impact as impact_points
from lvnav_trade.results.mission.injection_accuracy import LABELS, injections_of
from lvnav_trade.results.mission.orbit import costs
from lvnav_trade.results.statistics.case_results import Injections
from lvnav_trade.results.statistics.case_tables import CaseTables
from lvnav_trade.results.statistics.probability import outline_of
from lvnav_trade.results.statistics.select import final_event
from lvnav_trade.results.tables.read import Tables
from lvnav_trade.results.tables.run_tables import ORBIT_UNITS

_Component = tuple[str, int, str]  # metric, component of its error, label
_Errors = dict[str, Floats]  # by metric, each (n, k)
_PLANES: tuple[tuple[_Component, _Component], ...] = (
    (("perigee_error", 0, "perigee error"), ("apogee_error", 0, "apogee error")),
    (
        ("eccentricity_vector_error", 0, "eccentricity error\nalong the node"),
        ("eccentricity_vector_error", 1, "eccentricity error\nahead of the node"),
    ),
    (("node_error", 0, "node error"), ("inclination_error", 0, "inclination error")),
)
_DRAWS = 512  # draws of linear covariance in a plane
_SEEN = 0.03  # fraction of the map's width that the largest ellipse should fill
_BY = {"Monte Carlo": ("runs", PALETTE[0], "-"), "linear covariance": ("LinCov", PALETTE[1], "--")}
_DRAWN = 14  # largest number of ellipses on the map


@drawing
def orbit(tables: Tables, case: str) -> Figure:
    """Draw the errors of the mean orbit at the final event (true less estimated) in three planes, and the correction.

    Dots are runs; ellipses are three sigma by linear covariance, true and formal. Within three sigma of a circular
    orbit, draws of the Gaussian replace the ellipse of perigee and apogee.
    """
    event = final_event(tables, case)
    state = stored_states.state_at(tables, case, event)
    if state is None or not bool(orbits.osculating(state.r_i, state.v_i).elliptic):
        return message("the flight does not end in an orbit", "perigee error (km)", "apogee error (km)")
    law = stored_states.law_at(tables, case, event)
    figure, grid = canvas(2, 2, 2.9, title=f"{tables.labels[case]}, {event.replace('_', ' ')}")
    of_runs = mission_errors.orbit_errors(state, stored_states.good_errors(tables, case, state))
    for ax, pair in zip(grid.ravel()[:3], _PLANES, strict=True):
        _plane(ax, state, law, of_runs, pair)
    _cost(grid[1, 1], costs(tables, case, event))
    return figure


def _plane(
    ax: Panel,
    state: stored_states.State,
    law: stored_states.ErrorGaussian,
    of_runs: _Errors,
    pair: tuple[_Component, _Component],
) -> None:
    units, factors = zip(*((MISSION[m].label_unit, MISSION[m].label_factor) for m, _, _ in pair), strict=True)
    scale = np.array(factors)

    def shown(errors: _Errors) -> Floats:
        return np.stack([errors[metric][:, k] for metric, k, _ in pair]) * scale[:, None]

    if len(of_runs["node_error"]):
        ax.plot(*shown(of_runs), ls="none", marker=".", ms=2.5, color=PALETTE[0], label="runs")
    if any(mission_errors.applies(state, metric, law.true) for metric, _, _ in pair):
        drawn = mission_errors.orbit_errors(state, mission_errors.draws(law.mean, law.true, _DRAWS))
        ax.plot(*shown(drawn), ls="none", marker="x", ms=2.5, color=PALETTE[1], label="draws of LinCov")
        ax.set(title="no first-order sigma: circular to within 3 sigma")
    else:
        slope = np.stack([mission_errors.jacobian(state, metric)[k] for metric, k, _ in pair]) * scale[:, None]
        outline = slope @ law.mean + outline_of(slope @ law.true @ slope.T)
        ax.plot(*outline.T, color=PALETTE[1], ls="--", label="LinCov, true, 3 sigma")
        formal_outline = outline_of(slope @ law.formal @ slope.T)
        ax.plot(*formal_outline.T, color="black", ls=":", label="LinCov, filter's own, 3 sigma")
    (*_, across), (*_, up) = pair
    ax.set(xlabel=f"{across.replace(chr(10), ' ')} ({units[0]})", ylabel=f"{up} ({units[1]})")
    ax.set(margin=0.08)


def _cost(ax: Panel, by_method: dict[str, Floats]) -> None:
    for by, (name, colour, dashes) in _BY.items():
        if by in by_method:
            cost = np.sort(by_method[by][0])
            percentile = 100.0 * (np.arange(1, len(cost) + 1) / len(cost))
            label = f"{name}: 99 % below {np.quantile(cost, 0.99):.3g} m/s"
            ax.step(cost, percentile, label=label, color=colour, ls=dashes)
    ax.axhline(99.0, color=GREY, lw=0.7, ls=":")
    ax.set(xlim=0.0, ylim=(0.0, 102.0), xlabel="least delta-v of a correction (m/s)", ylabel="flights (%)")


@drawing
def impact(tables: Tables, case: str) -> Figure:
    """Draw the track of the impact point with ellipses and corridor, three sigma over time, and the last event.

    The ellipses on the map are magnified by the factor in the title.
    """
    rows = impact_points(tables, case)
    if rows.empty:
        nothing = "no point of impact in the stored flight"
        return message(nothing, "longitude (deg east)", "geodetic latitude\n(deg north)")
    figure, grid = canvas(1, 3, 2.9, widths=[2, 1, 1])
    _chart(grid[0, 0], tables, case, rows)
    _sizes(grid[0, 1], tables, case, rows)
    _last(grid[0, 2], tables, case, rows)
    return figure


def _chart(ax: Panel, tables: Tables, case: str, rows: pd.DataFrame) -> None:
    reference = tables.reference[(tables.reference.case == case) & (tables.reference.t_s >= 0.0)]
    track = np.degrees(np.unwrap(reference.longitude_rad))
    longitude = np.degrees(np.unwrap(np.radians(rows.longitude_deg)))
    longitude += 360.0 * np.round((track[0] - longitude[0]) / 360.0)
    ax.plot(track, np.degrees(reference.latitude_rad), color="black", lw=2.6, label="ground track")
    ax.plot(longitude, rows.latitude_deg, color=PALETTE[0], label="point of impact")
    dots = {"ls": "none", "marker": "o", "ms": 3, "color": PALETTE[0]}
    ax.plot(longitude[rows.event != ""], rows.latitude_deg[rows.event != ""], **dots)
    width = max(float(np.ptp(longitude)), float(np.ptp(rows.latitude_deg)), 0.1)
    times = _magnification(float(rows.major_3sigma_km.max()), width)
    for number, k in enumerate(np.unique(np.linspace(0, len(rows) - 1, _DRAWN).astype(int))):
        row = rows.iloc[k]
        latitude, along = ellipse(row, 3.0 * times)
        shift = longitude[k] - row.longitude_deg
        style = {"label": None if number else "3 sigma, LinCov", "group": "3 sigma, LinCov"}
        ax.plot(along + shift, latitude, color=PALETTE[1], lw=0.9, **style)
    corridor = corridor_of(tables)
    if corridor is not None:
        corners = np.degrees(corridor.corners)
        corners[:, 1] += 360.0 * np.round((longitude.mean() - corners[:, 1].mean()) / 360.0)
        closed = np.vstack([corners, corners[:1]])
        ax.plot(closed[:, 1], closed[:, 0], color=PALETTE[2], lw=1.2, label="corridor")
    ax.set(title=f"{tables.labels[case]}" + (f"; ellipses {times:g} times as large" if times > 1 else ""))
    ax.set(xlabel="longitude (deg east)", ylabel="geodetic latitude\n(deg north)", margin=0.06)


def _magnification(major_km: float, width_deg: float) -> float:
    """Return the power of ten, at least 1, that makes an ellipse with this semi-axis visible on the map."""
    return float(10.0 ** max(0, np.floor(np.log10(_SEEN * width_deg * 111.0 / max(major_km, 1e-9)))))


def _sizes(ax: Panel, tables: Tables, case: str, rows: pd.DataFrame) -> None:
    with_runs = rows[rows.runs > 1]
    for name, colour in (("down", PALETTE[0]), ("cross", PALETTE[1])):
        ax.plot(rows.t_s, 3.0 * rows[f"{name}_sigma_km"], color=colour, label=f"{name}-range, LinCov")
        formal, of_runs = rows[f"{name}_filter_sigma_km"], with_runs[f"mc_{name}_sigma_km"]
        ax.plot(rows.t_s, 3.0 * formal, color=colour, ls=":", lw=1.0, label=f"{name}-range, filter's own")
        if len(with_runs):
            style = {"ls": "none", "marker": "o", "ms": 3.5, "mfc": "none", "color": colour}
            ax.plot(with_runs.t_s, 3.0 * of_runs, label=f"{name}-range, runs", **style)
    scale_up(ax, "y", 3.0 * pd.concat([rows.down_sigma_km, rows.cross_sigma_km]))
    ax.set(ylabel="error of the point\nof impact (km, 3 sigma)")
    over_time([ax], tables, case, margin=0.03)


def _last(ax: Panel, tables: Tables, case: str, rows: pd.DataFrame) -> None:
    events = rows[rows.event != ""]
    row = (events if len(events) else rows).iloc[-1]
    if row.event and row.runs > 1:
        off = run_impacts(tables, case)[row.event] * 1e-3
        ax.plot(off[:, 1], off[:, 0], ls="none", marker=".", ms=2.5, color=PALETTE[0], label="runs")
    mixed = row.correlation * row.down_sigma_km * row.cross_sigma_km
    outline = outline_of(np.array([[row.cross_sigma_km**2, mixed], [mixed, row.down_sigma_km**2]]))
    outline += np.array([row.cross_bias_km, row.down_bias_km])
    ax.plot(*outline.T, color=PALETTE[1], ls="--", label="LinCov, 3 sigma")
    ax.set(xlabel="cross-range error (km)", ylabel="down-range error (km)", margin=0.08, equal=True)
    ax.set(title=f"{row.event.replace('_', ' ') or 'last'},\n{row.t_s:.0f} s")


_CLOUD = 2**10  # points that represent a distribution that is not Gaussian
_PLANES_AT_INJECTION = (("perigee", "apogee"), ("semi_major_axis", "inclination"))


@drawing
def injection(tables: Tables, case: str) -> Figure:
    """Draw the errors of the achieved orbit of every run (achieved less target), with the contribution of the
    navigation.

    Planes: apogee over perigee, and inclination over semi-major axis, with the expectation by linear covariance.
    """
    injections = injections_of(tables, case)
    if not injections or not next(iter(injections.values())).injected.any():
        return message("no guided run reaches its cut-off", "perigee error (km)", "apogee error (km)")
    figure, grid = canvas(1, 2, 2.9, title=tables.labels[case])
    for ax, (across, up) in zip(grid.ravel(), _PLANES_AT_INJECTION, strict=True):
        labels = [LABELS[ORBIT_UNITS[name]] for name in (across, up)]
        _plane_at_injection(ax, injections[across], injections[up], [factor for _, factor in labels])
        _ellipse(ax, CaseTables(tables, case).injection_law(), (across, up), [factor for _, factor in labels])
        ax.set(xlabel=f"{_words(across)} error ({labels[0][0]})")
        ax.set(ylabel=f"{_words(up)} error ({labels[1][0]})", margin=0.08)
    return figure


def _words(quantity: str) -> str:
    return quantity.replace("_", " ").replace("semi major", "semi-major")


def _plane_at_injection(ax: Panel, across: Injections, up: Injections, factors: list[float]) -> None:
    ax.axhline(0.0, color=GREY, lw=0.7, ls=":")
    for name, field, colour, marker in (
        ("achieved less target", "error", PALETTE[0], "."),
        ("achieved less navigated", "knowledge", PALETTE[1], "x"),
    ):
        x, y = (
            getattr(injections, field)[injections.injected] * factor
            for injections, factor in zip((across, up), factors, strict=True)
        )
        ax.plot(x, y, ls="none", marker=marker, ms=2.5, color=colour, label=name)


def _ellipse(ax: Panel, law: InjectionLaw | None, quantities: tuple[str, str], factors: list[float]) -> None:
    """Draw three sigma of two quantities by linear covariance, achieved less target.

    Near a circular orbit, perigee and apogee are drawn as samples of semi-major axis and eccentricity vector.
    """
    if law is None or why_no_law(law, quantities):
        return
    if quantities[0] in APSIDES and is_curved(law, quantities[0]):
        x, y = (apsis_errors(law, name, _CLOUD) * factor for name, factor in zip(quantities, factors, strict=True))
        ax.plot(x, y, ls="none", marker=".", ms=1.0, color=GREY, label="LinCov, drawn")
        return
    at = [INJECTION.index(name) for name in quantities]
    variance, axes = np.linalg.eigh(law.covariance[:, at][:, :, at].sum(axis=0) * np.outer(factors, factors))
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    circle = np.stack([np.cos(turn), np.sin(turn)])
    x, y = (law.mean[at] * factors)[:, None] + 3.0 * axes * np.sqrt(np.maximum(0.0, variance)) @ circle
    ax.plot(x, y, color=GREY, lw=0.9, label="LinCov, 3 sigma")
