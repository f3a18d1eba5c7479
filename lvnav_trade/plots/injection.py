"""Where guided ascents arrive: errors of the achieved orbit, and what the navigation does not know of them."""

from lvnav_trade.metrics.basics.case import Injections
from lvnav_trade.metrics.mission.injection import LABELS, injections_of
from lvnav_trade.plots.figure import GREY, Figure, Panel, canvas
from lvnav_trade.plots.style import PALETTE, drawing, message
from lvnav_trade.store.read import Tables

_PLANES = (("perigee", "apogee"), ("semi_major_axis", "inclination"))


@drawing
def injection(tables: Tables, case: str) -> Figure:
    """Draw the errors of the achieved orbit of every run, achieved less target, and the navigation's part of them:
    apogee over perigee, and inclination over semi-major axis.
    """
    found = injections_of(tables, case)
    if not found or not next(iter(found.values()))[1].injected.any():
        return message("no guided run reaches its cut-off", "perigee error (km)", "apogee error (km)")
    figure, grid = canvas(1, 2, 2.9, title=tables.labels[case])
    for ax, (across, up) in zip(grid.ravel(), _PLANES, strict=True):
        _plane(ax, found[across], found[up])
        ax.set(xlabel=f"{_words(across)} error ({LABELS[found[across][0]][0]})")
        ax.set(ylabel=f"{_words(up)} error ({LABELS[found[up][0]][0]})", margin=0.08)
    return figure


def _words(quantity: str) -> str:
    return quantity.replace("_", " ").replace("semi major", "semi-major")


def _plane(ax: Panel, across: tuple[str, Injections], up: tuple[str, Injections]) -> None:
    ax.axhline(0.0, color=GREY, lw=0.7, ls=":")
    for name, field, colour, marker in (
        ("achieved less target", "error", PALETTE[0], "."),
        ("achieved less navigated", "knowledge", PALETTE[1], "x"),
    ):
        x, y = (getattr(one, field)[one.injected] * LABELS[unit][1] for unit, one in (across, up))
        ax.plot(x, y, ls="none", marker=marker, ms=2.5, color=colour, label=name)
