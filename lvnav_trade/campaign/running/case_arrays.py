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
    error_magnitudes,
    phase_interval,
    symmetric,
)
from lvnav_trade.simulation.statistics import BlockSummary, add_norms, columns

if TYPE_CHECKING:
    from lvnav_trade.results.mechanics.stored_states import ErrorGaussian, State

# Quantities whose covariance is stored at events
_STORED_COVARIANCES = (*NAVIGATION_UNITS, *(f"{BACKUP}{quantity}" for quantity in NAVIGATION_UNITS))


class CaseArrays(CaseResults):
    """Results of one case in memory; the numbers are those that `CaseTables` reads from the stored tables.

    prepared_case : The prepared scenario.
    covariance : Its linear covariance.
    summary : Statistics of some or all of its runs; None without runs.
    """

    def __init__(self, prepared_case: Any, covariance: CovHistory, summary: BlockSummary | None = None) -> None:
        self.prepared_case, self.covariance, self.summary = prepared_case, covariance, summary
        self._columns = columns(prepared_case.outputs)

    def output(self, quantity: str, axis: str) -> Output | None:
        """Return the output (name, axis, units) of an error; None if the case does not have it."""
        column = self._column(quantity, axis)
        return None if column is None else self._columns[column]

    def axes(self, quantity: str) -> list[str]:
        """Return the axes of a quantity."""
        return [output.axis for output in self.prepared_case.outputs if output.quantity == quantity]

    def events(self) -> dict[str, float]:
        """Return the times (s) of the events."""
        events = self.prepared_case.trajectory.events
        in_order = sorted(events, key=lambda name: (events[name], name))
        return {name: float(events[name]) for name in in_order}

    def phase(self, text: str) -> tuple[float, float]:
        """Return the first and last time (s) of a phase."""
        t = self.covariance.t if self.summary is None else self.summary.t_bound
        return phase_interval(text, self.events(), (float(t[0]), float(t[-1])))

    def has_failed(self, event: str) -> Bools:
        """Return whether each run failed (n_run,); empty if the runs have no such event."""
        if self.summary is None or event not in self.summary.events:
            return np.zeros(0, dtype=bool)
        return self.failed_runs()

    def failed_runs(self) -> Bools:
        """Return whether each run failed (n_run,)."""
        if self.summary is None:
            return np.zeros(0, dtype=bool)
        return self.summary.failed != 0

    def errors(self, event: str, quantity: str) -> Floats:
        """Return the errors (n_run, n_axis) at an event, SI, reporting axes."""
        components = self._components(quantity)
        if self.summary is None or event not in self.summary.events:
            return np.empty((0, len(components)))
        index = self.summary.events.index(event)
        return self.summary.event_error[:, index, components]

    def sizes(self, event: str, quantity: str, axis: str) -> Floats:
        """Return |error| (n_run,) at an event, SI; infinite for runs that failed."""
        column = self._column(quantity, axis)
        if self.summary is None or event not in self.summary.events or column is None:
            return np.empty(0)
        index = self.summary.events.index(event)
        error = self.summary.event_error[:, index, column]
        return error_magnitudes(error, self.failed_runs())

    def largest(self, quantity: str, axis: str, first: float, last: float) -> Floats:
        """Return the largest |error| (n_run,) between two times (s), SI; infinite for runs that failed."""
        column = self._column(quantity, axis)
        if self.summary is None or column is None:
            return np.empty(0)
        earliest = first - SAME_TIME
        latest = last + SAME_TIME
        is_within = [start >= earliest and end <= latest for start, end in pairwise(self.summary.t_bound)]
        if not any(is_within):
            return np.empty(0)
        largest_by_interval = self.summary.worst[:, is_within, column]
        has_failed = self.failed_runs()[:, None]
        sizes = error_magnitudes(largest_by_interval, has_failed)
        return sizes.max(axis=1)

    def history(self, quantity: str, axis: str) -> History:
        """Return true sigma and mean of an error over the flight, by linear covariance."""
        column = self._column(quantity, axis)
        if column is None:
            return History(np.empty(0), np.empty(0), np.empty(0))
        outputs = self.prepared_case.outputs
        true_sigma = add_norms(self.covariance.true_sigma, outputs)
        mean = add_norms(self.covariance.mean, outputs)
        return History(self.covariance.t, true_sigma[:, column], mean[:, column])

    def gaussian(self, event: str, quantity: str, axis: str) -> Gaussian | None:
        """Return the Gaussian distribution of an error at an event by linear covariance, without its error budget."""
        epoch = self._event_index(event, quantity)
        axes = self.axes(quantity)
        axis_indices = [k for k, name in enumerate(axes) if axis in ("3d", name)]
        if epoch is None or not axis_indices:
            return None
        components = self._components(quantity)
        mean = self.covariance.mean[epoch, components]
        covariance = symmetric(self.covariance.true_cov[epoch][np.ix_(components, components)])
        selected_covariance = covariance[np.ix_(axis_indices, axis_indices)]
        return Gaussian(mean[axis_indices], selected_covariance, {})

    def formal(self, event: str, quantity: str) -> Floats | None:
        """Return the formal covariance (3, 3) of the filter at an event, SI, reporting axes."""
        epoch = self._event_index(event, quantity)
        if epoch is None:
            return None
        components = self._components(quantity)
        return symmetric(self.covariance.formal_cov[epoch][np.ix_(components, components)])

    def state(self, event: str) -> State | None:
        """Return the true state at an event."""
        if not event:
            return None
        states, _ = self._states
        return next((state for state in states if state.event == event), None)

    def joint(self, event: str) -> ErrorGaussian:
        """Return the joint distribution of velocity and position at an event, by linear covariance."""
        states, distributions = self._states
        names = [state.event for state in states]
        return distributions[names.index(event)]

    def injections(self, quantity: str) -> Injections | None:
        """Return one element of the orbits that guided runs achieve; None without guided runs."""
        if self.summary is None or not len(self.summary.injections):
            return None
        # Columns: outcome, cut-off time, propellant, errors of all elements, navigation errors of all elements
        rows = self.summary.injections
        error_column = 3 + ORBIT.index(quantity)
        return Injections(
            outcome=np.array(OUTCOMES)[rows[:, 0].astype(int)],
            t=rows[:, 1],
            remaining_propellant=rows[:, 2],
            error=rows[:, error_column],
            knowledge=rows[:, error_column + len(ORBIT)],
        )

    def injection_law(self) -> InjectionLaw | None:
        """Return the distribution of the injection of a guided ascent by linear covariance."""
        return self.covariance.injection

    def protection_level(self, quantity: str, instant_text: str, phase_text: str) -> float:
        """Return NaN: protection levels are part of the diagnostics, which are computed after the runs."""
        return float("nan")

    def largest_tilt(self) -> tuple[float, float]:
        """Return the largest attitude sigma (rad) of any axis at or before lift-off, and its time (s)."""
        before_liftoff = self.covariance.t <= SAME_TIME
        sigma = self.covariance.true_sigma[before_liftoff][:, self._components("attitude")]
        if not sigma.size:
            return 0.0, 0.0
        # Transposed, so that of equal sigmas on several axes the first axis gives the time
        k = int(np.argmax(sigma.T)) % len(sigma)
        t = self.covariance.t[before_liftoff]
        return float(sigma.max()), float(t[k])

    @cached_property
    def _states(self) -> tuple[list[State], list[ErrorGaussian]]:
        """True states and joint distributions at the events.

        They are computed through the columns of the stored tables. So a verdict before storing has exactly the same
        numbers as a verdict on stored results.
        """
        from lvnav_trade.results.mechanics.stored_states import State, error_gaussians
        from lvnav_trade.results.tables.flight_tables import state_columns

        table_columns = state_columns(self.prepared_case, self.covariance)
        rows = table_columns["states"]
        joint = table_columns["joint_covariances"]
        if not rows:
            return [], []
        quaternions = np.stack([rows[f"axes_q{k}_ratio"] for k in range(4)], axis=1)
        rotations = frames.matrices(quaternions)
        r_i = np.stack([rows[f"position_{axis}_m"] for axis in "xyz"], axis=1)
        v_i = np.stack([rows[f"velocity_{axis}_m_per_s"] for axis in "xyz"], axis=1)
        fields = zip(rows["event"], rows["t_s"], r_i, v_i, rows["earth_angle_rad"], rotations, strict=True)
        states = [State(*values) for values in fields]
        laws = error_gaussians(joint["mean_si"], joint["true_si2"], joint["formal_si2"])
        return states, laws

    def _column(self, quantity: str, axis: str) -> int | None:
        """Return the column of an error in arrays with norms; None if the case does not have it."""
        for k, output in enumerate(self._columns):
            if (output.quantity, output.axis) == (quantity, axis):
                return k
        return None

    def _components(self, quantity: str) -> list[int]:
        """Return the indices of a quantity's components in the outputs."""
        return [k for k, output in enumerate(self.prepared_case.outputs) if output.quantity == quantity]

    def _event_index(self, event: str, quantity: str) -> int | None:
        """Return the index of an event in the history; None for a quantity whose covariance is not stored."""
        t = self.prepared_case.trajectory.events.get(event)
        if t is None or quantity not in _STORED_COVARIANCES or len(self._components(quantity)) != 3:
            return None
        return int(np.argmin(np.abs(self.covariance.t - t)))
