"""Results of one case for the metrics, directly from the arrays of the engines, before they are stored."""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from lvnav_trade.quantities import frames
from lvnav_trade.quantities.records import ORBIT, OUTCOMES, Bools, CovHistory, Floats, InjectionLaw, Output
from lvnav_trade.quantities.state_layout import BACKUP
from lvnav_trade.results.metric import NAVIGATION_UNITS
from lvnav_trade.results.statistics.case_results import (
    SAME_TIME,
    CaseResults,
    Gaussian,
    History,
    Injections,
    finite_sizes,
    phase_in,
    symmetric,
)
from lvnav_trade.simulation.statistics import BlockSummary, add_norms, columns

if TYPE_CHECKING:
    from lvnav_trade.results.mechanics.stored_states import ErrorGaussian, State

# Quantities whose covariance is stored at events
_KEPT = (*NAVIGATION_UNITS, *(f"{BACKUP}{quantity}" for quantity in NAVIGATION_UNITS))


class CaseArrays(CaseResults):
    """Results of one case in memory; the numbers are those that `CaseTables` reads from the stored tables.

    prepared : The prepared scenario.
    covariance : Its linear covariance.
    summary : Statistics of some or all of its runs; None without runs.
    """

    def __init__(self, prepared: Any, covariance: CovHistory, summary: BlockSummary | None = None) -> None:
        self.prepared, self.covariance, self.summary = prepared, covariance, summary
        self._columns = columns(prepared.outputs)

    def output(self, quantity: str, axis: str) -> Output | None:
        """Return the output (name, axis, units) of an error; None if the case does not have it."""
        return next((output for output in self._columns if (output.quantity, output.axis) == (quantity, axis)), None)

    def axes(self, quantity: str) -> list[str]:
        """Return the axes of a quantity."""
        return [output.axis for output in self.prepared.outputs if output.quantity == quantity]

    def events(self) -> dict[str, float]:
        """Return the times (s) of the events."""
        events = self.prepared.trajectory.events
        return {name: float(events[name]) for name in sorted(events, key=lambda name: (events[name], name))}

    def phase(self, text: str) -> tuple[float, float]:
        """Return the first and last time (s) of a phase."""
        t = self.covariance.t if self.summary is None else self.summary.t_bound
        return phase_in(text, self.events(), (float(t[0]), float(t[-1])))

    def failed(self, event: str) -> Bools:
        """Return whether each run failed (n_run,); empty if the runs have no such event."""
        is_known = self.summary is not None and event in self.summary.events
        return self.failed_runs() if is_known else np.zeros(0, dtype=bool)

    def failed_runs(self) -> Bools:
        """Return whether each run failed (n_run,)."""
        return np.zeros(0, dtype=bool) if self.summary is None else self.summary.failed != 0

    def errors(self, event: str, quantity: str) -> Floats:
        """Return the errors (n_run, n_axis) at an event, SI, reporting axes."""
        at = self._axes_of(quantity)
        if self.summary is None or event not in self.summary.events:
            return np.empty((0, len(at)))
        return self.summary.event_error[:, self.summary.events.index(event), at]

    def sizes(self, event: str, quantity: str, axis: str) -> Floats:
        """Return |error| (n_run,) at an event, SI; infinite for runs that failed."""
        column = self._column(quantity, axis)
        if self.summary is None or event not in self.summary.events or column is None:
            return np.empty(0)
        error = self.summary.event_error[:, self.summary.events.index(event), column]
        return finite_sizes(error, self.failed_runs())

    def largest(self, quantity: str, axis: str, first: float, last: float) -> Floats:
        """Return the largest |error| (n_run,) between two times (s), SI; infinite for runs that failed."""
        column = self._column(quantity, axis)
        if self.summary is None or column is None:
            return np.empty(0)
        spans = [
            start >= first - SAME_TIME and end <= last + SAME_TIME for start, end in pairwise(self.summary.t_bound)
        ]
        if not any(spans):
            return np.empty(0)
        return finite_sizes(self.summary.worst[:, spans, column], self.failed_runs()[:, None]).max(axis=1)

    def history(self, quantity: str, axis: str) -> History:
        """Return true sigma and mean of an error over the flight, by linear covariance."""
        column = self._column(quantity, axis)
        if column is None:
            return History(np.empty(0), np.empty(0), np.empty(0))
        true, mean = (
            add_norms(values, self.prepared.outputs)[:, column]
            for values in (self.covariance.true_sigma, self.covariance.mean)
        )
        return History(self.covariance.t, true, mean)

    def gaussian(self, event: str, quantity: str, axis: str) -> Gaussian | None:
        """Return the Gaussian distribution of an error at an event by linear covariance, without its error budget."""
        at, axes = self._place(event, quantity), self.axes(quantity)
        chosen = range(len(axes)) if axis == "3d" else [k for k, name in enumerate(axes) if name == axis]
        if at is None or not len(chosen):
            return None
        whole, index = self._axes_of(quantity), list(chosen)
        covariance = symmetric(self.covariance.true_cov[at][np.ix_(whole, whole)])
        return Gaussian(self.covariance.mean[at, whole][index], covariance[np.ix_(index, index)], {})

    def formal(self, event: str, quantity: str) -> Floats | None:
        """Return the formal covariance (3, 3) of the filter at an event, SI, reporting axes."""
        at, whole = self._place(event, quantity), self._axes_of(quantity)
        return None if at is None else symmetric(self.covariance.formal_cov[at][np.ix_(whole, whole)])

    def state(self, event: str) -> State | None:
        """Return the true state at an event."""
        return next((state for state in self._states[0] if state.event == event and event), None)

    def joint(self, event: str) -> ErrorGaussian:
        """Return the joint distribution of velocity and position at an event, by linear covariance."""
        states, laws = self._states
        return laws[[state.event for state in states].index(event)]

    def injections(self, quantity: str) -> Injections | None:
        """Return one element of the orbits that guided runs achieve; None without guided runs."""
        if self.summary is None or not len(self.summary.injections):
            return None
        rows, at, n = self.summary.injections, 3 + ORBIT.index(quantity), len(ORBIT)
        outcome = np.array(OUTCOMES)[rows[:, 0].astype(int)]
        return Injections(outcome, *rows[:, :3].T[1:], *(rows[:, at + part * n] for part in range(2)))

    def injection_law(self) -> InjectionLaw | None:
        """Return the distribution of the injection of a guided ascent by linear covariance."""
        return self.covariance.injection

    def protection_level(self, quantity: str, at: str, during: str) -> float:
        """Return NaN: protection levels are part of the diagnostics, which are computed after the runs."""
        return float("nan")

    def largest_tilt(self) -> tuple[float, float]:
        """Return the largest attitude sigma (rad) of any axis at or before lift-off, and its time (s)."""
        early = self.covariance.t <= SAME_TIME
        sigma = self.covariance.true_sigma[early][:, self._axes_of("attitude")]
        if not sigma.size:
            return 0.0, 0.0
        k = int(np.argmax(sigma.T)) % len(sigma)
        return float(sigma.max()), float(self.covariance.t[early][k])

    @cached_property
    def _states(self) -> tuple[list[State], list[ErrorGaussian]]:
        """True states and joint distributions at the events.

        They are computed through the columns of the stored tables. So a verdict before storing has exactly the same
        numbers as a verdict on stored results.
        """
        from lvnav_trade.results.mechanics.stored_states import State, laws_in
        from lvnav_trade.results.tables.flight_tables import state_columns

        stored = state_columns(self.prepared, self.covariance)
        rows, joint = stored["states"], stored["joint_covariances"]
        if not rows:
            return [], []
        turns = frames.matrices(np.stack([rows[f"axes_q{k}_ratio"] for k in range(4)], axis=1))
        r_i, v_i = (
            np.stack([rows[f"{name}_{axis}_{unit}"] for axis in "xyz"], axis=1)
            for name, unit in (("position", "m"), ("velocity", "m_per_s"))
        )
        parts = zip(rows["event"], rows["t_s"], r_i, v_i, rows["earth_angle_rad"], turns, strict=True)
        return [State(*part) for part in parts], laws_in(joint["mean_si"], joint["true_si2"], joint["formal_si2"])

    def _column(self, quantity: str, axis: str) -> int | None:
        columns = enumerate(self._columns)
        return next((k for k, output in columns if (output.quantity, output.axis) == (quantity, axis)), None)

    def _axes_of(self, quantity: str) -> list[int]:
        return [k for k, output in enumerate(self.prepared.outputs) if output.quantity == quantity]

    def _place(self, event: str, quantity: str) -> int | None:
        """Return the index of an event in the history; None for a quantity whose covariance is not stored."""
        t = self.prepared.trajectory.events.get(event)
        kept = quantity in _KEPT and len(self._axes_of(quantity)) == 3
        return int(np.argmin(np.abs(self.covariance.t - t))) if kept and t is not None else None
