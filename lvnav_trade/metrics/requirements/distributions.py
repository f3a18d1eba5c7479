"""What linear covariance says of the error that a requirement is about: its Gaussian, at an event or over a phase."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy import special

from lvnav_trade.layout import MISSION
from lvnav_trade.metrics.basics.gaussian import norm_probability
from lvnav_trade.metrics.basics.select import flight_events, split_metric
from lvnav_trade.metrics.errors.covariances import Gaussian, gaussian
from lvnav_trade.metrics.mechanics.mission import expected_at, people
from lvnav_trade.metrics.requirements.requirements import bound_of, phase_of, where
from lvnav_trade.store import Tables

UNKNOWN = "linear covariance does not hold this error there"
ABOVE_ONLY = "the worst of a phase: linear covariance bounds its probability from above only"
_SAME = 1e-6


class Asked(NamedTuple):
    """A requirement in one case: the metric's Gaussian, bound (SI), probability, unit for people and its factor.

    moment: where the Gaussian is that of; above_only: it is that of the worst moment of a phase, so that the
    probability that it keeps the bound is no less than that of the whole phase.
    """

    law: Gaussian
    bound: float
    probability: float
    unit: str
    factor: float
    moment: str
    above_only: bool = False


def asked(tables: Tables, requirement: Mapping[str, Any], case: str) -> Asked | str:
    """Return what linear covariance says of a requirement's error in a case, or why it says nothing."""
    metric, at = str(requirement["metric"]), where(requirement)
    if metric in MISSION:
        found = expected_at(tables, case, at, metric)
        if not isinstance(found, tuple):
            return found or UNKNOWN
        si, unit, factor = people(metric)
        return _asked(Gaussian(*found, {}), requirement, si, unit, factor, at)
    quantity, axis = split_metric(metric)
    if (quantity, axis) not in tables.people:
        return UNKNOWN
    unit, factor = tables.people[quantity, axis]
    outputs = tables.outputs
    si = str(outputs[(outputs.quantity == quantity) & (outputs.axis == axis)].unit.iloc[0])
    if not requirement.get("during"):
        law = gaussian(tables, case, at, quantity, axis)
        return UNKNOWN if law is None else _asked(law, requirement, si, unit, factor, at)
    worst = _worst(tables, requirement, case, bound_of(requirement["below"], si))
    return (
        UNKNOWN
        if worst is None
        else _asked(worst[0], requirement, si, unit, factor, worst[1])._replace(above_only=True)
    )


def _asked(law: Gaussian, requirement: Mapping[str, Any], si: str, unit: str, factor: float, moment: str) -> Asked:
    bound = bound_of(requirement["below"], si)
    return Asked(law, bound, float(requirement["probability"]), unit, float(factor), moment)


def _worst(tables: Tables, requirement: Mapping[str, Any], case: str, bound: float) -> tuple[Gaussian, str] | None:
    """Return the Gaussian of the moment of a phase that keeps the bound least, and which moment that is.

    A norm needs the covariance of three axes, which is kept at events; one axis is looked at at every time.
    """
    quantity, axis = split_metric(str(requirement["metric"]))
    first, last = phase_of(tables, case, str(requirement["during"]))
    events = flight_events(tables, case)
    found: list[tuple[float, Gaussian, str]] = []
    for event in events[(events.t_s >= first - _SAME) & (events.t_s <= last + _SAME)].itertuples():
        law = gaussian(tables, case, str(event.event), quantity, axis)
        if law is not None:
            kept = norm_probability(law.mean, law.covariance, bound)
            found.append((kept, law, str(event.event).replace("_", " ")))
    if axis != "3d":
        found += _at_times(tables.history, case, quantity, axis, (first, last), bound)
    if not found:
        return None
    _, law, moment = min(found, key=lambda one: one[0])
    return law, moment


def _at_times(
    history: pd.DataFrame, case: str, quantity: str, axis: str, phase: tuple[float, float], bound: float
) -> list[tuple[float, Gaussian, str]]:
    """Return the worst time of the history for one axis."""
    rows = history[(history.case == case) & (history.quantity == quantity) & (history.axis == axis)]
    rows = rows[(rows.t_s >= phase[0] - _SAME) & (rows.t_s <= phase[1] + _SAME) & (rows.lincov_true_si > 0.0)]
    if rows.empty:
        return []
    mean, sigma = rows.lincov_mean_si.to_numpy(), rows.lincov_true_si.to_numpy()
    kept = special.ndtr((bound - mean) / sigma) - special.ndtr((-bound - mean) / sigma)
    k = int(np.argmin(kept))
    law = Gaussian(mean[k : k + 1], sigma[k : k + 1, None] ** 2, {})
    return [(float(kept[k]), law, f"{rows.t_s.to_numpy()[k]:.0f} s")]
