"""Figures of the mission: orbit, impact point, orbit correction, guided injection."""

from typing import NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.quantities.records import INJECTION, Floats, InjectionLaw
from lvnav_trade.report.figures.figure import GREY, Figure, Panel, canvas
from lvnav_trade.report.figures.style import PALETTE, drawing, message, over_time, scale_up
from lvnav_trade.results.mechanics import mission_errors, orbits, stored_states
from lvnav_trade.results.mechanics.injection_law import APSIDES, apsis_errors, is_curved, why_no_law
from lvnav_trade.results.metrics.mission import MISSION
from lvnav_trade.results.mission.corridor import corridor_of
from lvnav_trade.results.mission.impact import ellipse, run_impacts
from lvnav_trade.results.mission.impact import impact as impact_points
from lvnav_trade.results.mission.injection_accuracy import LABELS, injections_of
from lvnav_trade.results.mission.orbit import costs
from lvnav_trade.results.statistics.case_results import Injections
from lvnav_trade.results.statistics.case_tables import CaseTables
from lvnav_trade.results.statistics.probability import ellipse_points
from lvnav_trade.results.statistics.select import final_event
from lvnav_trade.results.tables.read import Tables
from lvnav_trade.results.tables.run_tables import ORBIT_UNITS


class _Component(NamedTuple):
    """A component of an error of the orbit.

    metric : Name of the error.
    column : Column of the component in the errors.
    label : Label of its axis.
    """

    metric: str
    column: int
    label: str


_Plane = tuple[_Component, _Component]  # abscissa and ordinate
_OrbitErrors = dict[str, Floats]  # by metric, each (n, k)
_PLANES: tuple[_Plane, ...] = (
    (
        _Component("perigee_error", 0, "perigee error"),
        _Component("apogee_error", 0, "apogee error"),
    ),
    (
        _Component("eccentricity_vector_error", 0, "eccentricity error\nalong the node"),
        _Component("eccentricity_vector_error", 1, "eccentricity error\nahead of the node"),
    ),
    (
        _Component("node_error", 0, "node error"),
        _Component("inclination_error", 0, "inclination error"),
    ),
)
_DRAW_COUNT = 512  # draws of linear covariance in a plane
_MAP_FRACTION = 0.03  # fraction of the map's width that the largest ellipse should fill
_KM_PER_DEG = 111.0  # of latitude
# Legend entry, colour and dashes of the cost of a correction
_METHODS = {
    "Monte Carlo": ("runs", PALETTE[0], "-"),
    "linear covariance": ("LinCov", PALETTE[1], "--"),
}
_ELLIPSE_COUNT = 14  # largest number of ellipses on the map


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
    run_errors = mission_errors.orbit_errors(state, stored_states.good_errors(tables, case, state))
    figure, grid = canvas(2, 2, 2.9, title=f"{tables.labels[case]}, {event.replace('_', ' ')}")
    for ax, plane in zip(grid.ravel()[:3], _PLANES, strict=True):
        if len(run_errors["node_error"]):
            abscissas, ordinates = _plane_errors(run_errors, plane)
            ax.plot(
                abscissas,
                ordinates,
                ls="none",
                marker=".",
                ms=2.5,
                color=PALETTE[0],
                label="runs",
            )
        _draw_expected_errors(ax, state, law, plane)
        x_component, y_component = plane
        ax.set(
            xlabel=f"{x_component.label} ({MISSION[x_component.metric].label_unit})".replace("\n", " "),
            ylabel=f"{y_component.label} ({MISSION[y_component.metric].label_unit})",
            margin=0.08,
        )
    _draw_cost(grid[1, 1], costs(tables, case, event))
    return figure


def _plane_errors(errors: _OrbitErrors, plane: _Plane) -> Floats:
    """Return the two components of the errors in a plane, (2, n) in the units of the labels."""
    components = [errors[component.metric][:, component.column] for component in plane]
    return np.stack(components) * _label_factors(plane)[:, None]


def _label_factors(plane: _Plane) -> Floats:
    return np.array([MISSION[component.metric].label_factor for component in plane])


def _draw_expected_errors(
    ax: Panel, state: stored_states.State, law: stored_states.ErrorGaussian, plane: _Plane
) -> None:
    """Draw the errors by linear covariance in a plane: ellipses, or draws of the Gaussian near a circular orbit."""
    if any(mission_errors.nonlinearity_reason(state, component.metric, law.true) for component in plane):
        draws = mission_errors.draws(law.mean, law.true, _DRAW_COUNT)
        abscissas, ordinates = _plane_errors(mission_errors.orbit_errors(state, draws), plane)
        ax.plot(
            abscissas,
            ordinates,
            ls="none",
            marker="x",
            ms=2.5,
            color=PALETTE[1],
            label="draws of LinCov",
        )
        ax.set(title="no first-order sigma: circular to within 3 sigma")
        return
    gradients = [mission_errors.jacobian(state, component.metric)[component.column] for component in plane]
    jacobian = np.stack(gradients) * _label_factors(plane)[:, None]
    true_outline = jacobian @ law.mean + ellipse_points(jacobian @ law.true @ jacobian.T)
    ax.plot(*true_outline.T, color=PALETTE[1], ls="--", label="LinCov, true, 3 sigma")
    formal_outline = ellipse_points(jacobian @ law.formal @ jacobian.T)
    ax.plot(*formal_outline.T, color="black", ls=":", label="LinCov, filter's own, 3 sigma")


def _draw_cost(ax: Panel, method_costs: dict[str, Floats]) -> None:
    """Draw the distribution of the velocity change (m/s) of an orbit correction, by method."""
    for method, (name, colour, dashes) in _METHODS.items():
        if method not in method_costs:
            continue
        cost = np.sort(method_costs[method][0])
        percentile = 100.0 * (np.arange(1, len(cost) + 1) / len(cost))
        label = f"{name}: 99 % below {np.quantile(cost, 0.99):.3g} m/s"
        ax.step(cost, percentile, label=label, color=colour, ls=dashes)
    ax.axhline(99.0, color=GREY, lw=0.7, ls=":")
    ax.set(
        xlim=0.0,
        ylim=(0.0, 102.0),
        xlabel="least delta-v of a correction (m/s)",
        ylabel="flights (%)",
    )


@drawing
def impact(tables: Tables, case: str) -> Figure:
    """Draw the track of the impact point with ellipses and corridor, three sigma over time, and the last event.

    The ellipses on the map are magnified by the factor in the title.
    """
    rows = impact_points(tables, case)
    if rows.empty:
        return message(
            "no point of impact in the stored flight",
            "longitude (deg east)",
            "geodetic latitude\n(deg north)",
        )
    figure, grid = canvas(1, 3, 2.9, widths=[2, 1, 1])
    _draw_map(grid[0, 0], tables, case, rows)
    _draw_sigmas(grid[0, 1], tables, case, rows)
    _draw_last_point(grid[0, 2], tables, case, rows)
    return figure


def _draw_map(ax: Panel, tables: Tables, case: str, rows: pd.DataFrame) -> None:
    """Draw the ground track, the impact points with their ellipses, and the corridor.

    Longitudes are continuous along the track; the other curves are moved by whole turns to lie near it.
    """
    reference = tables.reference[(tables.reference.case == case) & (tables.reference.t_s >= 0.0)]
    track = np.degrees(np.unwrap(reference.longitude_rad))
    ax.plot(track, np.degrees(reference.latitude_rad), color="black", lw=2.6, label="ground track")

    longitude = np.degrees(np.unwrap(np.radians(rows.longitude_deg)))
    longitude += _whole_turns(track[0] - longitude[0])
    is_event = rows.event != ""
    ax.plot(longitude, rows.latitude_deg, color=PALETTE[0], label="point of impact")
    ax.plot(
        longitude[is_event],
        rows.latitude_deg[is_event],
        ls="none",
        marker="o",
        ms=3,
        color=PALETTE[0],
    )

    width_deg = max(float(np.ptp(longitude)), float(np.ptp(rows.latitude_deg)), 0.1)
    factor = _magnification(float(rows.major_3sigma_km.max()), width_deg)
    _draw_ellipses(ax, rows, longitude, factor)
    corridor = corridor_of(tables)
    if corridor is not None:
        corners = np.degrees(corridor.corners)
        corners[:, 1] += _whole_turns(longitude.mean() - corners[:, 1].mean())
        outline = np.vstack([corners, corners[:1]])
        ax.plot(outline[:, 1], outline[:, 0], color=PALETTE[2], lw=1.2, label="corridor")
    title = tables.labels[case]
    if factor > 1:
        title += f"; ellipses {factor:g} times as large"
    ax.set(
        title=title,
        xlabel="longitude (deg east)",
        ylabel="geodetic latitude\n(deg north)",
        margin=0.06,
    )


def _whole_turns(difference_deg: float) -> float:
    """Return the multiple of 360 degrees that is nearest to a difference of longitudes (deg)."""
    return 360.0 * float(np.round(difference_deg / 360.0))


def _draw_ellipses(ax: Panel, rows: pd.DataFrame, longitude: Floats, factor: float) -> None:
    """Draw three-sigma ellipses, magnified by a factor, at no more than `_ELLIPSE_COUNT` of the impact points.

    longitude : (n,) deg. Longitudes of the impact points on the map, continuous along the track.
    """
    indices = np.unique(np.linspace(0, len(rows) - 1, _ELLIPSE_COUNT).astype(int))
    for number, index in enumerate(indices):
        row = rows.iloc[index]
        latitude, ellipse_longitude = ellipse(row, 3.0 * factor)
        turns = longitude[index] - row.longitude_deg
        ax.plot(
            ellipse_longitude + turns,
            latitude,
            color=PALETTE[1],
            lw=0.9,
            label="3 sigma, LinCov" if number == 0 else None,
            group="3 sigma, LinCov",
        )


def _magnification(major_km: float, width_deg: float) -> float:
    """Return the power of ten, at least 1, that makes an ellipse with this semi-axis visible on the map."""
    factor = _MAP_FRACTION * width_deg * _KM_PER_DEG / max(major_km, 1e-9)
    return float(10.0 ** max(0, np.floor(np.log10(factor))))


def _draw_sigmas(ax: Panel, tables: Tables, case: str, rows: pd.DataFrame) -> None:
    """Draw three sigma of the down-range and cross-range errors over time."""
    with_runs = rows[rows.runs > 1]
    for name, colour in (("down", PALETTE[0]), ("cross", PALETTE[1])):
        true_sigma = rows[f"{name}_sigma_km"]
        formal_sigma = rows[f"{name}_filter_sigma_km"]
        ax.plot(rows.t_s, 3.0 * true_sigma, color=colour, label=f"{name}-range, LinCov")
        ax.plot(
            rows.t_s,
            3.0 * formal_sigma,
            color=colour,
            ls=":",
            lw=1.0,
            label=f"{name}-range, filter's own",
        )
        if len(with_runs):
            ax.plot(
                with_runs.t_s,
                3.0 * with_runs[f"mc_{name}_sigma_km"],
                label=f"{name}-range, runs",
                ls="none",
                marker="o",
                ms=3.5,
                mfc="none",
                color=colour,
            )
    scale_up(ax, "y", 3.0 * pd.concat([rows.down_sigma_km, rows.cross_sigma_km]))
    ax.set(ylabel="error of the point\nof impact (km, 3 sigma)")
    over_time([ax], tables, case, margin=0.03)


def _draw_last_point(ax: Panel, tables: Tables, case: str, rows: pd.DataFrame) -> None:
    """Draw the errors of the impact point at the last event, or at the last stored state without events."""
    events = rows[rows.event != ""]
    row = events.iloc[-1] if len(events) else rows.iloc[-1]
    if row.event and row.runs > 1:
        errors_km = run_impacts(tables, case)[row.event] * 1e-3  # down-range, cross-range
        ax.plot(
            errors_km[:, 1],
            errors_km[:, 0],
            ls="none",
            marker=".",
            ms=2.5,
            color=PALETTE[0],
            label="runs",
        )
    covariance = row.correlation * row.down_sigma_km * row.cross_sigma_km
    P = np.array([[row.cross_sigma_km**2, covariance], [covariance, row.down_sigma_km**2]])
    outline = ellipse_points(P)
    outline += np.array([row.cross_bias_km, row.down_bias_km])
    ax.plot(*outline.T, color=PALETTE[1], ls="--", label="LinCov, 3 sigma")
    event = row.event.replace("_", " ") or "last"
    ax.set(
        title=f"{event},\n{row.t_s:.0f} s",
        xlabel="cross-range error (km)",
        ylabel="down-range error (km)",
        margin=0.08,
        equal=True,
    )


_CLOUD = 2**10  # points that represent a distribution that is not Gaussian
_INJECTION_PLANES = (("perigee", "apogee"), ("semi_major_axis", "inclination"))
# Legend entry, field of `Injections`, colour and marker of the errors at injection
_INJECTION_ERRORS = (
    ("achieved less target", "error", PALETTE[0], "."),
    ("achieved less navigated", "knowledge", PALETTE[1], "x"),
)


@drawing
def injection(tables: Tables, case: str) -> Figure:
    """Draw the errors of the achieved orbit of every run (achieved less target), with the contribution of the
    navigation.

    Planes: apogee over perigee, and inclination over semi-major axis, with the expectation by linear covariance.
    """
    injections = injections_of(tables, case)
    if not injections or not next(iter(injections.values())).is_injected.any():
        return message("no guided run reaches its cut-off", "perigee error (km)", "apogee error (km)")
    law = CaseTables(tables, case).injection_law()
    figure, grid = canvas(1, 2, 2.9, title=tables.labels[case])
    for ax, plane in zip(grid.ravel(), _INJECTION_PLANES, strict=True):
        x_element, y_element = plane
        x_unit, x_factor = LABELS[ORBIT_UNITS[x_element]]
        y_unit, y_factor = LABELS[ORBIT_UNITS[y_element]]
        factors = [x_factor, y_factor]
        _draw_run_errors(ax, injections[x_element], injections[y_element], factors)
        _draw_expected_injection(ax, law, plane, factors)
        ax.set(
            xlabel=f"{_words(x_element)} error ({x_unit})",
            ylabel=f"{_words(y_element)} error ({y_unit})",
            margin=0.08,
        )
    return figure


def _words(quantity: str) -> str:
    return quantity.replace("_", " ").replace("semi major", "semi-major")


def _draw_run_errors(ax: Panel, x_element: Injections, y_element: Injections, factors: list[float]) -> None:
    """Draw the errors of two orbital elements at injection, of every run with a cut-off.

    x_element, y_element : elements on the horizontal and the vertical axis
    factors : from SI to the units of both axes
    """
    ax.axhline(0.0, color=GREY, lw=0.7, ls=":")
    for name, field, colour, marker in _INJECTION_ERRORS:
        abscissas = getattr(x_element, field)[x_element.is_injected] * factors[0]
        ordinates = getattr(y_element, field)[y_element.is_injected] * factors[1]
        ax.plot(
            abscissas,
            ordinates,
            ls="none",
            marker=marker,
            ms=2.5,
            color=colour,
            label=name,
        )


def _draw_expected_injection(
    ax: Panel, law: InjectionLaw | None, quantities: tuple[str, str], factors: list[float]
) -> None:
    """Draw three sigma of two quantities by linear covariance, achieved less target.

    Near a circular orbit, perigee and apogee are drawn as samples of semi-major axis and eccentricity vector.

    quantities : names on the horizontal and the vertical axis
    factors : from SI to the units of both axes
    """
    if law is None or why_no_law(law, quantities):
        return
    if quantities[0] in APSIDES and is_curved(law, quantities[0]):
        x = apsis_errors(law, quantities[0], _CLOUD) * factors[0]
        y = apsis_errors(law, quantities[1], _CLOUD) * factors[1]
        ax.plot(x, y, ls="none", marker=".", ms=1.0, color=GREY, label="LinCov, drawn")
        return
    indices = [INJECTION.index(name) for name in quantities]
    P = law.covariance[:, indices][:, :, indices].sum(axis=0)  # over the error sources
    variances, principal_axes = np.linalg.eigh(P * np.outer(factors, factors))
    semi_axes = 3.0 * principal_axes * np.sqrt(np.maximum(0.0, variances))
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    mean = (law.mean[indices] * factors)[:, None]
    x, y = mean + semi_axes @ circle
    ax.plot(x, y, color=GREY, lw=0.9, label="LinCov, 3 sigma")
