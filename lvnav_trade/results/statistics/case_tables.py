"""Results of one case as read by metrics from the tables: errors, and the injection under guidance."""

import numpy as np

from lvnav_trade.quantities.records import INJECTION, ORBIT, Bools, Floats, InjectionLaw, Output
from lvnav_trade.results.mechanics import stored_states
from lvnav_trade.results.statistics.case_results import CaseResults, Gaussian, History, Injections, error_magnitudes
from lvnav_trade.results.statistics.gaussian import formal_covariance, gaussian
from lvnav_trade.results.statistics.select import ends_of, flight_events, history_columns, instant, phase, rows_between
from lvnav_trade.results.tables.dictionary import error_column
from lvnav_trade.results.tables.read import Tables, cache_result, pick

_N = len(INJECTION)


def stored_injection_law(tables: Tables, case: str) -> InjectionLaw | None:
    """Return the distribution of the injection of a case by linear covariance; None without guidance.

    Results contain only the sums over all sources of knowledge and execution errors. They are assigned to the first
    source.
    """
    law: InjectionLaw | None = _stored_injection_laws(tables, case)[0]
    return law


@cache_result
def _stored_injection_laws(tables: Tables, case: str) -> list[InjectionLaw | None]:
    return [_read_injection_law(tables, case)]


def _read_injection_law(tables: Tables, case: str) -> InjectionLaw | None:
    numbers = pick(tables.injection_expected, case=case)
    if numbers.empty:
        return None
    reason = str(numbers.reason.iloc[0])
    if reason:
        return InjectionLaw(reason)
    rows = pick(tables.injection_covariances, case=case)
    sources = list(dict.fromkeys(rows.source))
    source_index = {name: k for k, name in enumerate(sources)}
    quantity_index = {name: k for k, name in enumerate(INJECTION)}
    source = rows.source.map(source_index).to_numpy(dtype=int)
    i = rows.quantity.map(quantity_index).to_numpy(dtype=int)
    j = rows.other_quantity.map(quantity_index).to_numpy(dtype=int)
    covariance = np.zeros((len(sources), _N, _N))
    covariance[source, i, j] = covariance[source, j, i] = rows.covariance_si2.to_numpy(dtype=float)
    n_orbit = len(ORBIT)
    knowledge, execution = np.zeros((2, len(sources), n_orbit))
    knowledge_sigma = numbers.knowledge_si.to_numpy(dtype=float)
    execution_sigma = numbers.execution_si.to_numpy(dtype=float)
    knowledge[0] = np.square(knowledge_sigma[:n_orbit])
    execution[0] = np.square(execution_sigma[:n_orbit])
    navigation_sources = set(rows.source[rows.source_group == "navigation"])
    return InjectionLaw(
        reference=numbers.reference_si.to_numpy(dtype=float),
        target=numbers.target_si.to_numpy(dtype=float)[:n_orbit],
        mean=numbers.mean_si.to_numpy(dtype=float),
        second_order=numbers.second_order_si.to_numpy(dtype=float),
        sources=tuple(map(str, sources)),
        n_navigation=len(navigation_sources),
        covariance=covariance,
        knowledge=knowledge,
        execution=execution,
    )


class CaseTables(CaseResults):
    """Stored results of one case; see `CaseResults` for the methods.

    tables : Tables of the results.
    case : Digest of the case.
    """

    def __init__(self, tables: Tables, case: str) -> None:
        self.tables, self.case = tables, case

    def output(self, quantity: str, axis: str) -> Output | None:
        """Return unit and label of an error."""
        for row in pick(self.tables.outputs, case=self.case, quantity=quantity, axis=axis).itertuples():
            return Output(quantity, axis, row.unit, row.label_unit, float(row.label_factor_ratio))
        return None

    def axes(self, quantity: str) -> list[str]:
        """Return the axes of a quantity."""
        rows = pick(self.tables.outputs, case=self.case, quantity=quantity)
        return [str(axis) for axis in rows.axis if axis != "3d"]

    def events(self) -> dict[str, float]:
        """Return the times (s) of the events."""
        rows = flight_events(self.tables, self.case)
        return dict(zip(rows.event.tolist(), rows.t_s.tolist(), strict=True))

    def phase(self, text: str) -> tuple[float, float]:
        """Return first and last time (s) of a phase."""
        intervals = pick(self.tables.interval_errors, case=self.case)
        if len(intervals):
            ends = float(intervals.t_s.min()), float(intervals.t_end_s.max())
        else:
            ends = ends_of(self.tables, self.case)
        return phase(self.tables, self.case, text, ends)

    def has_failed(self, event: str) -> Bools:
        """Return which runs failed, at an event."""
        rows = pick(self.tables.runs, case=self.case, event=event)
        return np.asarray(rows.failure.to_numpy() != "")

    def failed_runs(self) -> Bools:
        """Return which runs failed."""
        rows = pick(self.tables.runs, case=self.case).drop_duplicates("run_number")
        return np.asarray(rows.failure.to_numpy() != "")

    def errors(self, event: str, quantity: str) -> Floats:
        """Return the errors (n_run, n_axis) at an event."""
        rows = pick(self.tables.runs, case=self.case, event=event)
        outputs = [self.output(quantity, axis) for axis in self.axes(quantity)]
        columns = [error_column(quantity, output.axis, output.unit) for output in outputs if output is not None]
        return rows[columns].to_numpy(dtype=float)

    def sizes(self, event: str, quantity: str, axis: str) -> Floats:
        """Return |error| (n_run,) at an event."""
        output = self.output(quantity, axis)
        if output is None:
            return np.empty(0)
        rows = pick(self.tables.runs, case=self.case, event=event)
        column = error_column(quantity, axis, output.unit)
        if column not in rows.columns:
            return np.empty(0)
        return error_magnitudes(rows[column].to_numpy(dtype=float), rows.failure.to_numpy() != "")

    def largest(self, quantity: str, axis: str, first: float, last: float) -> Floats:
        """Return the largest |error| (n_run,) of a phase."""
        intervals = rows_between(pick(self.tables.interval_errors, case=self.case), first, last, "t_end_s")
        output = self.output(quantity, axis)
        if intervals.empty or output is None:
            return np.empty(0)
        column = error_column(quantity, axis, output.unit)
        error = intervals[column].to_numpy(dtype=float)
        has_failed = intervals.failure.to_numpy() != ""
        size = error_magnitudes(error, has_failed)
        _, run = np.unique(intervals.run_number.to_numpy(), return_inverse=True)
        n_run = int(run.max()) + 1
        largest = np.full(n_run, -np.inf)
        np.maximum.at(largest, run, size)
        return largest

    def history(self, quantity: str, axis: str) -> History:
        """Return an error over the flight by linear covariance."""
        names = ("t_s", "lincov_true_si", "lincov_mean_si")
        t, true, mean = history_columns(self.tables, self.case, quantity, axis, *names)
        return History(t, true, mean)

    def gaussian(self, event: str, quantity: str, axis: str) -> Gaussian | None:
        """Return the Gaussian of an error at an event."""
        return gaussian(self.tables, self.case, event, quantity, axis)

    def formal(self, event: str, quantity: str) -> Floats | None:
        """Return the formal covariance (3, 3) at an event."""
        return formal_covariance(self.tables, self.case, event, quantity)

    def state(self, event: str) -> stored_states.State | None:
        """Return the true state at an event."""
        return stored_states.state_at(self.tables, self.case, event)

    def joint(self, event: str) -> stored_states.ErrorGaussian:
        """Return linear covariance of velocity and position at an event."""
        return stored_states.law_at(self.tables, self.case, event)

    def injections(self, quantity: str) -> Injections | None:
        """Return one element of the orbits that guided runs achieve."""
        rows = pick(self.tables.injections, case=self.case, quantity=quantity)
        if rows.empty:
            return None
        return Injections(
            outcome=rows.outcome.to_numpy(dtype=str),
            t=rows.t_s.to_numpy(dtype=float),
            remaining_propellant=rows.propellant_left_kg.to_numpy(dtype=float),
            error=rows.error_si.to_numpy(dtype=float),
            knowledge=rows.knowledge_si.to_numpy(dtype=float),
        )

    def injection_law(self) -> InjectionLaw | None:
        """Return linear covariance of the injection of a guided ascent."""
        return stored_injection_law(self.tables, self.case)

    def protection_level(self, quantity: str, instant_text: str, phase_text: str) -> float:
        """Return the protection level at an event or of a phase."""
        rows = pick(self.tables.protection, case=self.case, quantity=quantity, axis="3d")
        rows = rows.sort_values("t_s", kind="stable")
        if phase_text:
            first, last = phase(self.tables, self.case, phase_text)
            rows = rows_between(rows, first, last)
            if len(rows):
                return float(rows.level_si.max())
            return float("nan")
        t = instant(self.tables, self.case, instant_text)
        if rows.empty or not np.isfinite(t):
            return float("nan")
        distance = np.abs(rows.t_s.to_numpy() - t)
        nearest = int(np.argmin(distance))
        return float(rows.level_si.iloc[nearest])
