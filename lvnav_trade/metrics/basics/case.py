"""What metrics read of one case, whether it is stored in tables or still in arrays."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.records import OUTCOMES, Bools, Floats, InjectionLaw, Output
from lvnav_trade.units import parse

if TYPE_CHECKING:
    from lvnav_trade.metrics.mechanics.mission import Law, State

# Seconds: one instant.
SAME_TIME = 1e-6
_INSTANT = re.compile(r"\s*(?P<event>[A-Za-z_]\w*)\s*(?:(?P<sign>[+-])\s*(?P<offset>\S.*))?$")


class Errors(NamedTuple):
    """|error| of every run.

    size : (n_run,) in `unit`. Infinite for a failed run.
    unit : SI unit.
    label_unit : Unit for people.
    label_factor : Factor from SI to it.
    """

    size: Floats
    unit: str
    label_unit: str
    label_factor: float


class Gaussian(NamedTuple):
    """The Gaussian of a metric's components, SI.

    mean : (k,).
    covariance : (k, k).
    sources : Covariance (k, k) of each error source that is known.
    """

    mean: Floats
    covariance: Floats
    sources: dict[str, Floats]


class Distribution(NamedTuple):
    """The distribution of a metric by linear covariance.

    law : The Gaussian of its components, SI.
    unit : SI unit.
    label_unit : Unit for people.
    label_factor : Factor from SI to it.
    moment : The event or time that the Gaussian is of.
    above_only : Whether it is that of the worst moment of a phase, so that the probability of keeping a bound is no
        less than that of the whole phase.
    drawn : (n,), growing. Sizes that replace the Gaussian of a metric that has none; None where it has one.
    """

    law: Gaussian
    unit: str
    label_unit: str
    label_factor: float
    moment: str
    above_only: bool = False
    drawn: Floats | None = None


class History(NamedTuple):
    """An error over the flight by linear covariance.

    t : (n,) s since lift-off.
    true : (n,) SI. Sigma of the true error.
    mean : (n,) SI. Its mean.
    """

    t: Floats
    true: Floats
    mean: Floats


class Injections(NamedTuple):
    """How guided ascents end.

    outcome : (n_run,). As in `records.OUTCOMES`.
    t : (n_run,) s since lift-off. Last cut-off.
    left : (n_run,) kg. Propellant left in the last stage.
    error : (n_run,) SI. What the achieved orbit has more than the target of a number.
    knowledge : (n_run,) SI. What it has more than the navigated orbit.
    """

    outcome: NDArray[np.str_]
    t: Floats
    left: Floats
    error: Floats
    knowledge: Floats

    @property
    def injected(self) -> Bools:
        """Which runs reach their cut-off, (n_run,)."""
        return np.asarray(self.outcome == OUTCOMES[0])


class CaseResults(Protocol):
    """What metrics read of one case. `case_tables.CaseTables` reads results; `campaign.running.case_arrays.CaseArrays`
    reads the arrays of the engines before they are stored. Both give the same numbers.
    """

    def output(self, quantity: str, axis: str) -> Output | None:
        """Return unit and label of an error; None where the case has none of that name."""

    def axes(self, quantity: str) -> list[str]:
        """Return the axes of a quantity, without the length."""

    def events(self) -> dict[str, float]:
        """Return the times (s) of the events of the flight, in time order."""

    def phase(self, text: str) -> tuple[float, float]:
        """Return first and last time (s) of ``INSTANT to INSTANT`` or ``flight``; NaN for an event not in it."""

    def failed(self, event: str) -> Bools:
        """Return which runs failed, (n_run,); none of an event that the flight does not have."""

    def failed_runs(self) -> Bools:
        """Return which runs failed, (n_run,)."""

    def errors(self, event: str, quantity: str) -> Floats:
        """Return the errors (n_run, n_axis) of a quantity at an event, SI; no axes where they are not known."""

    def sizes(self, event: str, quantity: str, axis: str) -> Floats:
        """Return |error| (n_run,) at an event, SI, infinite where a run failed or the error is not finite."""

    def largest(self, quantity: str, axis: str, first: float, last: float) -> Floats:
        """Return the largest |error| (n_run,) of each run in the spans from a first to a last time (s), as `sizes`."""

    def history(self, quantity: str, axis: str) -> History:
        """Return an error over the flight by linear covariance, without rows where it is not known."""

    def gaussian(self, event: str, quantity: str, axis: str) -> Gaussian | None:
        """Return the Gaussian of an error at an event; None where it is not known."""

    def formal(self, event: str, quantity: str) -> Floats | None:
        """Return the filter's own covariance (3, 3) at an event, of the nominal flight; None where it is not known."""

    def state(self, event: str) -> State | None:
        """Return the true state at an event; None where it is not known."""

    def joint(self, event: str) -> Law:
        """Return linear covariance of velocity and position at an event whose state is known."""

    def injections(self, quantity: str) -> Injections | None:
        """Return what guided ascents achieve of a number of the orbit; None where no run is guided."""

    def injection_law(self) -> InjectionLaw | None:
        """Return linear covariance of the injection of a guided ascent; None without guidance."""

    def protection_level(self, quantity: str, at: str, during: str) -> float:
        """Return the protection level (SI) at an event, or the largest of a phase; NaN where there is none."""


def number_in(value: Any, unit: str) -> float:
    """Return a quantity in a unit: text with a unit of its own, or a number that is in it."""
    return parse(value, unit) if isinstance(value, str) else float(value)


def instant_in(text: str, events: Mapping[str, float], ends: tuple[float, float]) -> float:
    """Return the time (s) of ``stage1_cutoff`` or ``stage1_cutoff + 30 s``; NaN for an event that is not in the flight.

    events : Times (s) of the events.
    ends : Times (s) of ``start`` and ``end``.
    """
    known = {"start": ends[0], "end": ends[1], **events}
    match = _INSTANT.match(text)
    if match is None or match["event"] not in known:
        return float("nan")
    offset = parse(match["offset"].strip(), "s") if match["offset"] else 0.0
    return float(known[match["event"]]) + (-offset if match["sign"] == "-" else offset)


def phase_in(text: str, events: Mapping[str, float], ends: tuple[float, float]) -> tuple[float, float]:
    """Return first and last time (s) of ``INSTANT to INSTANT``, or of ``flight``: from lift-off to the end.

    NaN where an event is not in the flight.
    """
    if text == "flight":
        return max(instant_in("start", events, ends), 0.0), instant_in("end", events, ends)
    first, _, last = text.partition(" to ")
    return instant_in(first, events, ends), instant_in(last, events, ends)


def symmetric(matrix: Floats) -> Floats:
    """Return a symmetric matrix (k, k) that has the upper triangle of a matrix."""
    return np.triu(matrix) + np.triu(matrix, 1).T


def finite_sizes(error: Floats, failed: Bools) -> Floats:
    """Return |error| (n,), infinite where a run failed or the error is not finite."""
    return np.where(failed | ~np.isfinite(error), np.inf, np.abs(error))
