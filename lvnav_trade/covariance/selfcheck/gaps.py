"""Linear against nonlinear propagation over every gap between measurements, at one-sigma errors of the filter model."""

from lvnav_trade.covariance.diagnostics.confirming_runs import gaps
from lvnav_trade.covariance.diagnostics.nonlinearity import nonlinearity
from lvnav_trade.covariance.selfcheck.check import Check
from lvnav_trade.quantities.records import CovHistory
from lvnav_trade.quantities.state_layout import state_names
from lvnav_trade.simulation.preparation.prepare import Prepared

ALLOWED_GAP = 0.1
"""Largest deviation of a one-sigma error from its linear propagation over a gap, in sigmas at its end."""
KIND = "propagation"


def propagation(prepared: Prepared, history: CovHistory, events: dict[str, float]) -> list[Check]:
    """Return a check for every gap without measurements, and one for the update intervals at the events.

    Directions are one-sigma errors of the filter's covariance at the beginning of the gap, propagated with both signs
    by the strapdown and by the filter's transition. Figures are in formal sigmas at the end.
    """
    if prepared.options.vehicle is not None:
        return [Check(KIND, "transition", reason="samples of the IMU are measurements: there is no window without one")]
    formal = history._replace(true_cov=history.formal_cov)
    names = state_names(prepared.layout)
    stretches = [(f"gap of {gap.end - gap.begin:.0f} s", gap.begin, gap.end) for gap in gaps(history)]
    if not (history.n_row > 0).any():
        stretches = [("the whole flight, unaided", float(history.t[0]), float(history.t[-1]))]
    checks = []
    for what, begin, end in stretches:
        index = nonlinearity(prepared, formal, begin, end=end)
        where = f"{names[index.state]}, {begin:g} to {end:g} s"
        checks.append(Check(KIND, what, max(index.motion, index.transition), high=ALLOWED_GAP, where=where))
    intervals = [(nonlinearity(prepared, formal, t), name) for name, t in events.items()]
    if intervals:
        index, event = max(intervals, key=lambda item: max(item[0].motion, item[0].transition))
        where = f"{names[index.state]} at {event}"
        checks.append(
            Check(KIND, "update interval", max(index.motion, index.transition), high=ALLOWED_GAP, where=where)
        )
    return checks
