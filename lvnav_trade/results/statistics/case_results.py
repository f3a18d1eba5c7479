"""Interface through which metrics read the results of one case, stored in tables or still in arrays."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.quantities.records import OUTCOMES, Bools, Floats, InjectionLaw, Output
from lvnav_trade.quantities.units import parse

if TYPE_CHECKING:
    from lvnav_trade.results.mechanics.stored_states import ErrorGaussian, State

SAME_TIME = 1e-6  # s; times that differ by less are the same instant
_INSTANT = re.compile(r"\s*(?P<event>[A-Za-z_]\w*)\s*(?:(?P<sign>[+-])\s*(?P<offset>\S.*))?$")


class RunErrors(NamedTuple):
    """Magnitude of an error in every run.

    magnitude : (n_run,) in `unit`. Infinite for a failed run.
    unit : SI unit.
    label_unit : Display unit.
    label_factor : Factor from SI to the display unit.
    """

    magnitude: Floats
    unit: str
    label_unit: str
    label_factor: float


class Gaussian(NamedTuple):
    """Gaussian distribution of the components of a metric, SI.

    mean : (k,). Mean.
    covariance : (k, k). Covariance.
    sources : Covariance (k, k) due to each error source, as far as known.
    """

    mean: Floats
    covariance: Floats
    sources: dict[str, Floats]


class Redraw(NamedTuple):
    """Dependence of a random sample on the error sources.

    sources : Names of the error sources.
    sample : Function of names and a factor, which returns the sample (n,), ascending, with the sigmas of these sources
        multiplied by the factor.
    """

    sources: tuple[str, ...]
    sample: Callable[[Sequence[str], float], Floats]


class Distribution(NamedTuple):
    """Distribution of a metric by linear covariance.

    law : Gaussian distribution of its components, SI.
    unit : SI unit.
    label_unit : Display unit.
    label_factor : Factor from SI to the display unit.
    event_or_time : Event or time of the distribution.
    is_upper_limit : Whether it is the distribution at the worst time of a phase. The probability of keeping a bound at
        this time is an upper limit of the probability of keeping it throughout the phase.
    sample : (n,), ascending. Random sample of the magnitude, for a metric that is not Gaussian; None otherwise.
    redraw : How error sources affect this sample; None if it is not known, or if the metric is Gaussian.
    """

    law: Gaussian
    unit: str
    label_unit: str
    label_factor: float
    event_or_time: str
    is_upper_limit: bool = False
    sample: Floats | None = None
    redraw: Redraw | None = None


class History(NamedTuple):
    """An error over the flight by linear covariance.

    t : (n,) s since lift-off.
    true_sigma : (n,) SI. Sigma of the true error.
    mean : (n,) SI. Its mean.
    """

    t: Floats
    true_sigma: Floats
    mean: Floats


class Injections(NamedTuple):
    """Outcome of guided ascents, for one orbital element.

    outcome : (n_run,). One of `records.OUTCOMES`.
    t : (n_run,) s since lift-off. Time of the last cut-off.
    remaining_propellant : (n_run,) kg. Propellant remaining in the last stage.
    error : (n_run,) SI. Achieved minus target element.
    knowledge : (n_run,) SI. Achieved minus navigated element.
    """

    outcome: NDArray[np.str_]
    t: Floats
    remaining_propellant: Floats
    error: Floats
    knowledge: Floats

    @property
    def is_injected(self) -> Bools:
        """Whether each run reaches its cut-off, (n_run,)."""
        return np.asarray(self.outcome == OUTCOMES[0])


class CaseResults(Protocol):
    """Results of one case, as read by metrics.

    `case_tables.CaseTables` reads stored results. `campaign.running.case_arrays.CaseArrays` reads the arrays of the
    engines before they are stored. Both give the same numbers.
    """

    def output(self, quantity: str, axis: str) -> Output | None:
        """Return the output (name, axis, units) of an error; None if the case does not have it."""

    def axes(self, quantity: str) -> list[str]:
        """Return the axes of a quantity, without the norm."""

    def events(self) -> dict[str, float]:
        """Return the times (s) of the events of the flight by name, in order of time."""

    def phase(self, text: str) -> tuple[float, float]:
        """Return the first and last time (s) of ``INSTANT to INSTANT`` or ``flight``; NaN for an unknown event."""

    def has_failed(self, event: str) -> Bools:
        """Return whether each run failed (n_run,); empty if the runs have no such event."""

    def failed_runs(self) -> Bools:
        """Return whether each run failed (n_run,)."""

    def errors(self, event: str, quantity: str) -> Floats:
        """Return the errors (n_run, n_axis) of a quantity at an event, SI, reporting axes; no axes if not stored."""

    def sizes(self, event: str, quantity: str, axis: str) -> Floats:
        """Return |error| (n_run,) at an event, SI; infinite if a run failed or its error is not finite."""

    def largest(self, quantity: str, axis: str, first: float, last: float) -> Floats:
        """Return the largest |error| (n_run,) of each run between two times (s), SI; infinite as in `sizes`."""

    def history(self, quantity: str, axis: str) -> History:
        """Return true sigma and mean of an error over the flight, by linear covariance; empty if not known."""

    def gaussian(self, event: str, quantity: str, axis: str) -> Gaussian | None:
        """Return the Gaussian distribution of an error at an event by linear covariance; None if not known."""

    def formal(self, event: str, quantity: str) -> Floats | None:
        """Return the formal covariance (3, 3) at an event of the nominal flight, SI, reporting axes, or None."""

    def state(self, event: str) -> State | None:
        """Return the true state at an event; None if not known."""

    def joint(self, event: str) -> ErrorGaussian:
        """Return the joint distribution of velocity and position at an event with a known state."""

    def injections(self, quantity: str) -> Injections | None:
        """Return one element of the orbits that guided runs achieve; None without guided runs."""

    def injection_law(self) -> InjectionLaw | None:
        """Return the distribution of the injection of a guided ascent by linear covariance; None without guidance."""

    def protection_level(self, quantity: str, instant_text: str, phase_text: str) -> float:
        """Return the protection level (SI) at an event, or its largest value in a phase; NaN if there is none."""


def parse_number(value: Any, unit: str) -> float:
    """Return a number in a unit, from text with a unit, or from a number that has this unit already.

    Parameters
    ----------
    value : str or float
        Text such as ``5 km``, or a number.
    unit : str
        Unit of the result.
    """
    if isinstance(value, str):
        return parse(value, unit)
    return float(value)


def instant_time(text: str, events: Mapping[str, float], ends: tuple[float, float]) -> float:
    """Return the time (s) of an instant such as ``stage1_cutoff`` or ``stage1_cutoff + 30 s``; NaN if it has no event.

    Parameters
    ----------
    text : str
        The instant.
    events : mapping of str to float
        Times (s) of the events by name.
    ends : (float, float)
        Times (s) of ``start`` and ``end``.
    """
    times = {"start": ends[0], "end": ends[1], **events}
    match = _INSTANT.match(text)
    if match is None or match["event"] not in times:
        return float("nan")
    offset = parse(match["offset"].strip(), "s") if match["offset"] else 0.0
    if match["sign"] == "-":
        offset = -offset
    return float(times[match["event"]]) + offset


def phase_interval(text: str, events: Mapping[str, float], ends: tuple[float, float]) -> tuple[float, float]:
    """Return the first and last time (s) of ``INSTANT to INSTANT``, or of ``flight``, from lift-off to the end.

    Parameters
    ----------
    text : str
        The phase.
    events : mapping of str to float
        Times (s) of the events by name.
    ends : (float, float)
        Times (s) of ``start`` and ``end``.

    Returns
    -------
    float, float
        First and last time (s), NaN if an event does not occur.
    """
    if text == "flight":
        return max(instant_time("start", events, ends), 0.0), instant_time("end", events, ends)
    first, _, last = text.partition(" to ")
    return instant_time(first, events, ends), instant_time(last, events, ends)


def symmetric(matrix: Floats) -> Floats:
    """Return the symmetric matrix (k, k) with the upper triangle of a matrix, which removes rounding asymmetry."""
    return np.triu(matrix) + np.triu(matrix, 1).T


def error_magnitudes(error: Floats, has_failed: Bools) -> Floats:
    """Return |error| (n,); infinite if a run failed or its error is not finite."""
    return np.where(has_failed | ~np.isfinite(error), np.inf, np.abs(error))
