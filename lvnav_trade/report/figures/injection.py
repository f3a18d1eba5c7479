"""Where guided ascents arrive: errors of the achieved orbit, and what the navigation does not know of them."""

import numpy as np

from lvnav_trade.quantities.records import INJECTION, InjectionLaw
from lvnav_trade.report.figures.figure import GREY, Figure, Panel, canvas
from lvnav_trade.report.figures.style import PALETTE, drawing, message
from lvnav_trade.results.mechanics.injection import APSIDES, apsis_errors, is_curved, why_no_law
from lvnav_trade.results.mission.injection import LABELS, injections_of
from lvnav_trade.results.statistics.case import Injections
from lvnav_trade.results.statistics.case_tables import CaseTables
from lvnav_trade.results.tables.read import Tables
from lvnav_trade.results.tables.runs import ORBIT_UNITS

_CLOUD = 2**10  # points that stand for a law that is no Gaussian
_PLANES_AT_INJECTION = (("perigee", "apogee"), ("semi_major_axis", "inclination"))


@drawing
def injection(tables: Tables, case: str) -> Figure:
    """Draw the errors of the achieved orbit of every run, achieved less target, the navigation's part of them, and what
    linear covariance expects: apogee over perigee, and inclination over semi-major axis.
    """
    found = injections_of(tables, case)
    if not found or not next(iter(found.values())).injected.any():
        return message("no guided run reaches its cut-off", "perigee error (km)", "apogee error (km)")
    figure, grid = canvas(1, 2, 2.9, title=tables.labels[case])
    for ax, (across, up) in zip(grid.ravel(), _PLANES_AT_INJECTION, strict=True):
        labels = [LABELS[ORBIT_UNITS[name]] for name in (across, up)]
        _plane_at_injection(ax, found[across], found[up], [factor for _, factor in labels])
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
        x, y = (getattr(one, field)[one.injected] * factor for one, factor in zip((across, up), factors, strict=True))
        ax.plot(x, y, ls="none", marker=marker, ms=2.5, color=colour, label=name)


def _ellipse(ax: Panel, law: InjectionLaw | None, quantities: tuple[str, str], factors: list[float]) -> None:
    """Draw three sigma of two numbers by linear covariance, achieved less target; of perigee and apogee near a circle
    the cloud that its Gaussian of axis and eccentricity vector gives.
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
