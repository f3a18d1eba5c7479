"""Tables of one case, from the results of the engines."""

import json
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from lvnav_trade.covariance.diagnostics.case_diagnostics import CaseDiagnostics
from lvnav_trade.quantities.records import CovHistory, Floats, Output, RunBlock
from lvnav_trade.results.tables.controlled_tables import controlled_columns
from lvnav_trade.results.tables.diagnostics_tables import diagnostics_rows
from lvnav_trade.results.tables.dictionary import TABLES, arrow_schema
from lvnav_trade.results.tables.flight_tables import flight_columns
from lvnav_trade.results.tables.run_tables import DRAWN, integrity_columns, run_columns, start_columns, trace_columns
from lvnav_trade.results.tables.table_files import Coded, column
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.nozzle import NozzleStatistics
from lvnav_trade.simulation.preparation.initial_draws import InitialDraws
from lvnav_trade.simulation.preparation.prepare import PreparedCase
from lvnav_trade.simulation.statistics import NORM, BlockSummary, add_norms, columns, norm_groups, quantiles

_RUN_TABLES = (
    "runs",
    "interval_errors",
    "mode_transitions",
    "integrity",
    "injections",
    "failed_injection_draws",
    "initial_draws",
)
_NORM_LIKE_CONSTANT = 1e9  # degrees of freedom of a mean square that does not vary from run to run


class CaseInfo(NamedTuple):
    """Identification of a case."""

    id: str  # digest of scenario and seed, 12 hexadecimal digits
    label: str  # label of the case
    axes: dict[str, str]  # label of the level by name of the axis


def case_tables(
    case: CaseInfo,
    prepared_case: PreparedCase,
    cov: CovHistory,
    summary: BlockSummary | None,
    diagnostics: CaseDiagnostics | None = None,
    control: NozzleStatistics | None = None,
) -> dict[str, pa.Table]:
    """Return the tables of one case whose size does not depend on the number of runs, by name.

    Parameters
    ----------
    case : CaseInfo
        Digest, label, axes.
    prepared_case : PreparedCase
        The prepared scenario.
    cov : CovHistory
        Its linear covariance.
    summary : BlockSummary or None
        Statistics of all runs. Without Monte Carlo, columns of the runs are NaN and counts 0.
    diagnostics : CaseDiagnostics, optional
        Covariance diagnostics.
    control : NozzleStatistics, optional
        Simulation of the vehicle under attitude control.
    """
    contents: dict[str, Any] = {
        "cases": _cases(case, prepared_case, summary, diagnostics),
        "outputs": _outputs(prepared_case.outputs),
        "history": _history(prepared_case.outputs, cov, summary),
        "consistency": _consistency(prepared_case, cov, summary),
        "innovations": _innovations(cov, summary),
        "nominal_integrity": integrity_columns(cov.decisions, prepared_case.channel_names),
    }
    if summary is not None:
        contents["whiteness"] = _whiteness(prepared_case, summary)
    if cov.sources:
        contents["budget"] = _budget(prepared_case, cov)
    contents |= flight_columns(prepared_case, cov)
    contents |= diagnostics_rows(prepared_case, cov, diagnostics)
    spot_runs = None if diagnostics is None else diagnostics.spot_check
    contents["spot_runs"] = run_columns(prepared_case.outputs, spot_runs, prepared_case.channel_names)["runs"]
    if control is not None:
        contents |= controlled_columns(control)
    tables = {}
    for name in TABLES:
        if name not in _RUN_TABLES:
            tables[name] = _arrow_table(name, case.id, contents.get(name, {}))
    return tables


def row_tables(
    case_id: str, outputs: tuple[Output, ...], summary: BlockSummary | None, channels: tuple[str, ...] = ()
) -> dict[str, pa.Table]:
    """Return the tables with rows for every run, for some runs of a case; empty tables for None.

    Parameters
    ----------
    case_id : str
        Digest of the case.
    outputs : tuple of Output
        Reported errors of the case.
    summary : BlockSummary or None
        Statistics of some runs; None for empty tables.
    channels : tuple of str
        Names of the filter's measurement channels.
    """
    contents = run_columns(outputs, summary, channels)
    return {name: _arrow_table(name, case_id, content) for name, content in contents.items()}


def starts_table(case_id: str, starts: InitialDraws | None) -> dict[str, pa.Table]:
    """Return the table of the initial and turn-on draws of runs, as `row_tables`."""
    return {"initial_draws": _arrow_table("initial_draws", case_id, start_columns(starts))}


def traces_table(case_id: str, outputs: tuple[Output, ...], blocks: Iterable[RunBlock]) -> pa.Table:
    """Return the table of time histories of runs, given as blocks of one run each."""
    return _arrow_table("traces", case_id, trace_columns(outputs, blocks))


def _arrow_table(name: str, case_id: str, content: dict[str, Any] | list[dict[str, Any]]) -> pa.Table:
    """Return a table from columns or from rows.

    Columns that are not in the schema are real numbers and come last.

    Parameters
    ----------
    name : str
        Name of the table.
    case_id : str
        Digest of the case.
    content : dict or list of dict
        Columns by name, or rows. A single text or number applies to every row.
    """
    if isinstance(content, list):
        content = _transpose_rows(content)
    n_row = 0
    for values in content.values():
        n_row = max(n_row, 1 if isinstance(values, str | int | float) else len(values))
    further_columns = [column_name for column_name in content if column_name not in TABLES[name]]
    schema = arrow_schema(name, tuple(further_columns))
    arrays = []
    for field in schema:
        if field.name == "case":
            values = case_id
        else:
            values = content.get(field.name, ())
        if isinstance(values, str):
            values = Coded([values], np.zeros(n_row))
        elif isinstance(values, int | float):
            values = np.full(n_row, values)
        arrays.append(column(values, field.type))
    return pa.table(arrays, schema=schema)


def _transpose_rows(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return rows with equal keys as columns."""
    if not rows:
        return {}
    return {key: [row[key] for row in rows] for key in rows[0]}


def _freedom(covariance: Floats, mean: Floats) -> Floats:
    """Return the chi-square degrees of freedom (n,) of |x|^2, x normal with covariance (n, k, k) and mean (n, k).

    Two moments are matched (Satterthwaite): E = tr C + m'm, Var = 2 tr C^2 + 4 m'Cm, freedom 2 E^2 / Var.
    """
    total = np.trace(covariance, axis1=1, axis2=2)
    mean_square = total + np.sum(mean**2, axis=1)
    covariance_term = 2.0 * np.sum(covariance**2, axis=(1, 2))
    mean_term = 4.0 * np.einsum("ni,nij,nj->n", mean, covariance, mean)
    variance = covariance_term + mean_term
    is_constant = variance <= 2.0 * mean_square**2 / _NORM_LIKE_CONSTANT
    freedom = 2.0 * mean_square**2 / np.where(is_constant, 1.0, variance)
    return np.where(is_constant, _NORM_LIKE_CONSTANT, freedom)


def _name_columns(outputs: tuple[Output, ...], n: int) -> dict[str, Any]:
    """Return the columns that name the outputs, each repeated n times."""
    numbers = np.repeat(np.arange(len(outputs)), n)
    return {
        "quantity": Coded([output.quantity for output in outputs], numbers),
        "axis": Coded([output.axis for output in outputs], numbers),
        "unit": Coded([output.unit for output in outputs], numbers),
    }


def thresholds(scenario: Scenario) -> dict[str, float]:
    """Return the C/N0 (dB-Hz) to acquire and to track a satellite; NaN without link budget or tracking."""
    acquire_above = np.nan
    track_above = np.nan
    if scenario.receiver.link is not None:
        tracking = scenario.receiver.tracking
        if tracking is not None:
            acquire_above = tracking.acquire_above
            track_above = tracking.track_above
    return {"acquire_above_db_hz": acquire_above, "track_above_db_hz": track_above}


# --- one function per table -------------------------------------------------------------------------------------------


def _is_tested(prepared_case: PreparedCase, diagnostics: CaseDiagnostics | None) -> bool:
    """Whether there are tests for faults: by innovations, between IMUs, or by solution separation."""
    if prepared_case.options.fault_tests is not None:
        return True
    units = prepared_case.options.imu_array
    if units is not None and units.redundant is not None and units.redundant.n_test_tick > 0:
        return True
    protection_levels = None if diagnostics is None else diagnostics.protection
    return protection_levels is not None and protection_levels.alarms


def _cases(
    case: CaseInfo, prepared_case: PreparedCase, summary: BlockSummary | None, diagnostics: CaseDiagnostics | None
) -> dict[str, Any]:
    gate = float(np.sqrt(prepared_case.model.gate_squared))
    return {
        "label": case.label,
        "axes": json.dumps(case.axes),
        "run_count": summary.n_run if summary else 0,
        "failed_count": int((summary.failed != 0).sum()) if summary else 0,
        "nees_dof_count": int(prepared_case.layout.n_estimated),
        "gate_ratio": gate if np.isfinite(gate) else np.nan,
        "logic": prepared_case.options.rules is not None,
        "integrity": _is_tested(prepared_case, diagnostics),
        **thresholds(prepared_case.scenario),
        "epoch": prepared_case.trajectory.epoch,
        "facts": json.dumps(prepared_case.trajectory.facts, sort_keys=True, default=float),
    }


def _outputs(outputs: tuple[Output, ...]) -> dict[str, Any]:
    stored_columns = columns(outputs)
    return {
        **_name_columns(stored_columns, 1),
        "label_unit": [output.label_unit for output in stored_columns],
        "label_factor_ratio": [output.label_factor for output in stored_columns],
    }


def _history(outputs: tuple[Output, ...], cov: CovHistory, summary: BlockSummary | None) -> dict[str, Any]:
    stored_columns = columns(outputs)
    n_column = len(stored_columns)
    n_time = len(cov.t)
    # Outputs whose squares are summed in a column: itself, or the axes of a norm
    groups = [[k] for k in range(len(outputs))]
    groups += list(norm_groups(outputs).values())
    freedom = [_freedom(cov.true_cov[:, group][:, :, group], cov.mean[:, group]) for group in groups]
    values = {
        **_run_statistics(summary, (n_time, n_column)),
        "lincov_formal_si": add_norms(cov.formal_sigma, outputs),
        "lincov_true_si": add_norms(cov.true_sigma, outputs),
        "lincov_mean_si": add_norms(cov.mean, outputs),
        "dof_ratio": np.stack(freedom, axis=1),
    }
    return {
        "t_s": np.tile(cov.t, n_column),
        **_name_columns(stored_columns, n_time),
        "run_count": np.tile(summary.n_good, n_column) if summary else 0,
        **{name: value.T.ravel() for name, value in values.items()},
    }


def _run_statistics(summary: BlockSummary | None, shape: tuple[int, int]) -> dict[str, Floats]:
    """Return moments and quantiles of the runs (n_time, n_column) by column of the history; NaN without runs."""
    if summary is None:
        missing = np.full(shape, np.nan)
        names = ("mean_si", "rms_si", "filter_sigma_si", "q50_si", "q95_si", "q997_si")
        return dict.fromkeys(names, missing)
    n = np.where(summary.n_good > 0, summary.n_good, np.nan)[:, None]
    q50, q95, q997 = quantiles(summary, 0.5, 0.95, 0.997)
    return {
        "mean_si": summary.total / n,
        "rms_si": np.sqrt(summary.squares / n),
        "filter_sigma_si": np.sqrt(summary.sigma_squares / n),
        "q50_si": q50,
        "q95_si": q95,
        "q997_si": q997,
    }


def _consistency(prepared_case: PreparedCase, cov: CovHistory, summary: BlockSummary | None) -> dict[str, Any]:
    run_count: Any = 0
    nees_mean: Any = np.nan
    if summary is not None:
        run_count = summary.n_good
        nees_mean = summary.nees / np.where(summary.n_good > 0, summary.n_good, np.nan)
    return {
        "t_s": cov.t,
        "run_count": run_count,
        "nees_mean_ratio": nees_mean,
        "nees_dof_count": int(prepared_case.layout.n_estimated),
        "expected_nees_ratio": cov.expected_nees,
    }


def _innovations(cov: CovHistory, summary: BlockSummary | None) -> dict[str, Any]:
    return {
        "t_s": cov.t_epoch,
        "run_count": summary.n_good_epoch if summary else 0,
        "nis_sum_ratio": summary.nis if summary else np.nan,
        "measurement_count": summary.n_row if summary else 0,
        "rejected_count": summary.n_reject if summary else 0,
        "lincov_measurement_count": cov.n_row,
        "expected_nis_ratio": cov.expected_nis,
        "false_rejection_ratio": cov.false_rejection,
    }


def _whiteness(prepared_case: PreparedCase, summary: BlockSummary) -> dict[str, Any]:
    n_lag, n_channel = summary.lag_sum.shape
    return {
        "channel": np.repeat(prepared_case.channel_names, n_lag),
        "lag_number": np.tile(np.arange(n_lag), n_channel),
        "pair_count": summary.lag_count.T.ravel(),
        "product_sum_ratio": summary.lag_sum.T.ravel(),
    }


class _Variances(NamedTuple):
    """Error variance by source.

    variance : (n_time, n_source, n_column), SI squared. Variance due to each source.
    share : (n_time, n_source, n_column). Share of the sum over the sources.
    """

    variance: Floats
    share: Floats


def _budget(prepared_case: PreparedCase, cov: CovHistory) -> dict[str, Any]:
    """Split the variance by source: every column at the events, the navigation norms over the history."""
    stored_columns = columns(prepared_case.outputs)
    sigma = np.sqrt(np.maximum(cov.budget, 0.0))
    variance = add_norms(sigma, prepared_case.outputs) ** 2
    total = variance.sum(axis=1, keepdims=True)
    share = np.divide(variance, total, out=np.zeros_like(variance), where=total > 0)
    variances = _Variances(variance, share)

    norms = [k for k, output in enumerate(stored_columns) if output.axis == NORM and output.quantity in DRAWN]
    all_columns = list(range(len(stored_columns)))
    all_times = np.arange(len(cov.t))
    blocks = [_budget_block("", all_times, norms, stored_columns, cov, variances)]
    for event, t in prepared_case.trajectory.events.items():
        nearest = np.argmin(np.abs(cov.t - t))
        times = np.array([nearest])
        blocks.append(_budget_block(event, times, all_columns, stored_columns, cov, variances))
    return {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}


def _budget_block(
    event: str,
    times: NDArray[Any],
    column_indices: list[int],
    stored_columns: tuple[Output, ...],
    cov: CovHistory,
    variances: _Variances,
) -> dict[str, Any]:
    """Return the budget of chosen columns at an event or at times of the history.

    Parameters
    ----------
    event : str
        Name of the event; empty for times of the history.
    times : (n,) array of int
        Indices in the history.
    column_indices : list of int
        Indices of the stored columns.
    stored_columns : tuple of Output
        Stored columns of the case: axes and norms.
    cov : CovHistory
        Linear covariance.
    variances : _Variances
        Variance by source.
    """
    source, k, i = np.indices((len(cov.sources), len(column_indices), len(times))).reshape(3, -1)
    time = times[i]
    output = np.array(column_indices, dtype=int)[k]
    return {
        "event": np.full(source.size, event),
        "t_s": cov.t[time],
        "source": np.array(cov.sources)[source],
        "quantity": np.array([stored_columns[number].quantity for number in column_indices])[k],
        "axis": np.array([stored_columns[number].axis for number in column_indices])[k],
        "unit": np.array([stored_columns[number].unit for number in column_indices])[k],
        "sigma_si": np.sqrt(variances.variance[time, source, output]),
        "share_ratio": variances.share[time, source, output],
    }
