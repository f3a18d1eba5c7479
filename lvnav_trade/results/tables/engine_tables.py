"""Tables of one case, from the results of the engines."""

import json
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from lvnav_trade.covariance.diagnostics.case_diagnostics import CaseDiagnostics
from lvnav_trade.quantities.records import CovHistory, Floats, Output, RunBlock
from lvnav_trade.results.tables.diagnostics_tables import diagnostics_rows
from lvnav_trade.results.tables.dictionary import TABLES, arrow_schema
from lvnav_trade.results.tables.flight_tables import flight_columns
from lvnav_trade.results.tables.run_tables import DRAWN, integrity_columns, run_columns, start_columns, trace_columns
from lvnav_trade.results.tables.table_files import Coded, column
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.nozzle import AXES, FEEDS, PHASES, NozzleStatistics
from lvnav_trade.simulation.preparation.initial_draws import InitialDraws
from lvnav_trade.simulation.preparation.prepare import Prepared
from lvnav_trade.simulation.statistics import NORM, BlockSummary, add_norms, columns, norm_groups, quantiles

_NAME = ("quantity", "axis", "unit")
_OF_RUNS = (
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
    label: str
    axes: dict[str, str]  # label of the level by name of the axis


def case_tables(
    case: CaseInfo,
    prepared: Prepared,
    cov: CovHistory,
    summary: BlockSummary | None,
    explained: CaseDiagnostics | None = None,
    control: NozzleStatistics | None = None,
) -> dict[str, pa.Table]:
    """Return the tables of one case whose size does not depend on the number of runs, by name.

    Parameters
    ----------
    case : CaseInfo
        Digest, label, axes.
    prepared : Prepared
        The prepared scenario.
    cov : CovHistory
        Its linear covariance.
    summary : BlockSummary or None
        Statistics of all runs. Without Monte Carlo, columns of the runs are NaN and counts 0.
    explained : CaseDiagnostics, optional
        Covariance diagnostics.
    control : NozzleStatistics, optional
        Simulation of the vehicle under attitude control.
    """
    contents: dict[str, Any] = {
        "cases": _cases(case, prepared, summary, explained),
        "outputs": _outputs(prepared.outputs),
        "history": _history(prepared.outputs, cov, summary),
        "consistency": _consistency(prepared, cov, summary),
        "innovations": _innovations(cov, summary),
        "whiteness": _whiteness(prepared, summary) if summary else {},
        "nominal_integrity": integrity_columns(cov.decisions, prepared.channel_names),
        "budget": _budget(prepared, cov) if cov.sources else {},
        **flight_columns(prepared, cov),
        **diagnostics_rows(prepared, cov, explained),
        "spot_runs": run_columns(
            prepared.outputs, explained.spot if explained is not None else None, prepared.channel_names
        )["runs"],
        **(controlled_columns(control) if control is not None else {}),
    }
    return {name: _arrow(name, case.id, contents.get(name, {})) for name in TABLES if name not in _OF_RUNS}


def row_tables(
    case_id: str, outputs: tuple[Output, ...], part: BlockSummary | None, channels: tuple[str, ...] = ()
) -> dict[str, pa.Table]:
    """Return the tables with rows for every run, for some runs of a case; empty tables for None."""
    return {name: _arrow(name, case_id, content) for name, content in run_columns(outputs, part, channels).items()}


def starts_table(case_id: str, starts: InitialDraws | None) -> dict[str, pa.Table]:
    """Return the table of the initial and turn-on draws of runs, as `row_tables`."""
    return {"initial_draws": _arrow("initial_draws", case_id, start_columns(starts))}


def traces_table(case_id: str, outputs: tuple[Output, ...], blocks: Iterable[RunBlock]) -> pa.Table:
    """Return the table of time histories of runs, given as blocks of one run each."""
    return _arrow("traces", case_id, trace_columns(outputs, blocks))


def _arrow(name: str, case_id: str, content: dict[str, Any] | list[dict[str, Any]]) -> pa.Table:
    """Return a table from columns or from rows.

    A single text or number applies to every row. Columns that are not in the schema are real numbers and come last.
    """
    if isinstance(content, list):
        content = {key: [row[key] for row in content] for key in (content[0] if content else ())}
    lengths = [1 if isinstance(values, str | int | float) else len(values) for values in content.values()]
    schema = arrow_schema(name, tuple(each for each in content if each not in TABLES[name]))
    whole = []
    for field in schema:
        values = case_id if field.name == "case" else content.get(field.name, ())
        if isinstance(values, str):
            values = Coded([values], np.zeros(max(lengths, default=0)))
        elif isinstance(values, int | float):
            values = np.full(max(lengths, default=0), values)
        whole.append(column(values, field.type))
    return pa.table(whole, schema=schema)


def _freedom(covariance: Floats, mean: Floats) -> Floats:
    """Return the chi-square degrees of freedom (n,) of |x|^2, x normal with covariance (n, k, k) and mean (n, k).

    Two moments are matched (Satterthwaite): E = tr C + m'm, Var = 2 tr C^2 + 4 m'Cm, freedom 2 E^2 / Var.
    """
    expected = np.trace(covariance, axis1=1, axis2=2) + np.sum(mean**2, axis=1)
    spread = 2.0 * np.sum(covariance**2, axis=(1, 2)) + 4.0 * np.einsum("ni,nij,nj->n", mean, covariance, mean)
    constant = spread <= 2.0 * expected**2 / _NORM_LIKE_CONSTANT
    return np.where(constant, _NORM_LIKE_CONSTANT, 2.0 * expected**2 / np.where(constant, 1.0, spread))


def _names(outputs: tuple[Output, ...], n: int) -> dict[str, Any]:
    """Return the columns that name the outputs, each repeated n times."""
    return {
        part: Coded([getattr(output, part) for output in outputs], np.repeat(np.arange(len(outputs)), n))
        for part in _NAME
    }


def thresholds(scenario: Scenario) -> dict[str, float]:
    """Return the C/N0 (dB-Hz) above which satellites are found and kept; NaN without link budget or tracking."""
    tracking = scenario.receiver.tracking if scenario.receiver.link is not None else None
    found, kept = (tracking.acquire_above, tracking.track_above) if tracking is not None else (np.nan, np.nan)
    return {"acquire_above_db_hz": found, "track_above_db_hz": kept}


# --- one function per table -------------------------------------------------------------------------------------------


def _is_tested(prepared: Prepared, explained: CaseDiagnostics | None) -> bool:
    """Whether there are tests for faults: by innovations, between IMUs, or by solution separation."""
    units, protected = prepared.options.units, None if explained is None else explained.protected
    between_units = units is not None and units.redundant is not None and units.redundant.ticks > 0
    return prepared.options.integrity is not None or between_units or (protected is not None and protected.alarms)


def _cases(
    case: CaseInfo, prepared: Prepared, summary: BlockSummary | None, explained: CaseDiagnostics | None
) -> dict[str, Any]:
    gate = float(np.sqrt(prepared.model.gate_squared))
    return {
        "label": case.label,
        "axes": json.dumps(case.axes),
        "run_count": summary.n_run if summary else 0,
        "failed_count": int((summary.failed != 0).sum()) if summary else 0,
        "nees_dof_count": int(prepared.layout.n_estimated),
        "gate_ratio": gate if np.isfinite(gate) else np.nan,
        "logic": prepared.options.rules is not None,
        "integrity": _is_tested(prepared, explained),
        **thresholds(prepared.scenario),
        "epoch": prepared.trajectory.epoch,
        "facts": json.dumps(prepared.trajectory.facts, sort_keys=True, default=float),
    }


def _outputs(outputs: tuple[Output, ...]) -> dict[str, Any]:
    every = columns(outputs)
    return {
        **_names(every, 1),
        "label_unit": [output.label_unit for output in every],
        "label_factor_ratio": [output.label_factor for output in every],
    }


def _history(outputs: tuple[Output, ...], cov: CovHistory, summary: BlockSummary | None) -> dict[str, Any]:
    every = columns(outputs)
    groups = [[index] for index in range(len(outputs))] + list(norm_groups(outputs).values())
    values = {
        **_monte_carlo(summary, (len(cov.t), len(every))),
        "lincov_formal_si": add_norms(cov.formal, outputs),
        "lincov_true_si": add_norms(cov.true_sigma, outputs),
        "lincov_mean_si": add_norms(cov.mean, outputs),
        "dof_ratio": np.stack([_freedom(cov.true_cov[:, i][:, :, i], cov.mean[:, i]) for i in groups], axis=1),
    }
    return {
        "t_s": np.tile(cov.t, len(every)),
        **_names(every, len(cov.t)),
        "run_count": np.tile(summary.n_good, len(every)) if summary else 0,
        **{name: value.T.ravel() for name, value in values.items()},
    }


def _monte_carlo(summary: BlockSummary | None, shape: tuple[int, int]) -> dict[str, Floats]:
    names = ("mean_si", "rms_si", "filter_sigma_si", "q50_si", "q95_si", "q997_si")
    if summary is None:
        return dict.fromkeys(names, np.full(shape, np.nan))
    n = np.where(summary.n_good > 0, summary.n_good, np.nan)[:, None]
    moments = (summary.total / n, np.sqrt(summary.squares / n), np.sqrt(summary.sigma_squares / n))
    values = (*moments, *quantiles(summary, 0.5, 0.95, 0.997))
    return dict(zip(names, values, strict=True))


def _consistency(prepared: Prepared, cov: CovHistory, summary: BlockSummary | None) -> dict[str, Any]:
    return {
        "t_s": cov.t,
        "run_count": summary.n_good if summary else 0,
        "nees_mean_ratio": summary.nees / np.where(summary.n_good > 0, summary.n_good, np.nan) if summary else np.nan,
        "nees_dof_count": int(prepared.layout.n_estimated),
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


def _whiteness(prepared: Prepared, summary: BlockSummary) -> dict[str, Any]:
    n_lag, n_channel = summary.lag_sum.shape
    return {
        "channel": np.repeat(prepared.channel_names, n_lag),
        "lag_number": np.tile(np.arange(n_lag), n_channel),
        "pair_count": summary.lag_count.T.ravel(),
        "product_sum_ratio": summary.lag_sum.T.ravel(),
    }


def _budget(prepared: Prepared, cov: CovHistory) -> dict[str, Any]:
    """Split the variance by source: every column at the events, the navigation norms over the history."""
    every = columns(prepared.outputs)
    variance = add_norms(np.sqrt(np.maximum(cov.budget, 0.0)), prepared.outputs) ** 2
    total = variance.sum(axis=1, keepdims=True)
    share = np.divide(variance, total, out=np.zeros_like(variance), where=total > 0)
    summed = [k for k, output in enumerate(every) if output.axis == NORM and output.quantity in DRAWN]
    at_events = [(name, np.array([np.argmin(np.abs(cov.t - t))])) for name, t in prepared.trajectory.events.items()]
    blocks = [("", np.arange(len(cov.t)), summed), *((*at, list(range(len(every)))) for at in at_events)]
    pieces: list[dict[str, Any]] = []
    for event, times, chosen in blocks:
        source, output, time = np.indices((len(cov.sources), len(chosen), len(times))).reshape(3, -1)
        at = (times[time], source, np.array(chosen, dtype=int)[output])
        pieces.append(
            {
                "event": np.full(source.size, event),
                "t_s": cov.t[at[0]],
                "source": np.array(cov.sources)[source],
                **{part: np.array([getattr(every[k], part) for k in chosen])[output] for part in _NAME},
                "sigma_si": np.sqrt(variance[at]),
                "share_ratio": share[at],
            }
        )
    return {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}


_TURNING = (
    "angular_acceleration_inside_ratio",
    "jerk_inside_ratio",
    "angular_acceleration_peak_ratio",
    "jerk_peak_ratio",
    "attitude_error_rad",
    "rate_error_rad_per_s",
    "rate_sigma_rad_per_s",
)
_MOTION = (
    "angular_acceleration_rad_per_s2",
    "angular_acceleration_envelope_rad_per_s2",
    "jerk_m_per_s3",
    "jerk_envelope_m_per_s3",
)
WHOLE = "flight"  # what stands for all burns together


def controlled_columns(nozzle: NozzleStatistics) -> dict[str, dict[str, Any]]:
    """Return the columns of `nozzle_travel`, `nozzle_travel_history`, `motion_statistics`, `motion_history`."""
    feed, run, burn, axis = np.indices(nozzle.total.shape).reshape(4, -1)
    travel = {
        "controller_rate": np.array(FEEDS)[feed],
        "run_number": run,
        "burn": np.array([WHOLE] + [f"burn {number}" for number in range(1, nozzle.total.shape[2])])[burn],
        "axis": np.array(AXES)[axis],
        "travel_rad": nozzle.total.ravel(),
    }
    feed, time, axis = np.indices(nozzle.mean.shape).reshape(3, -1)
    sizes = {"mean_rad": nozzle.mean, "minimum_rad": nozzle.low, "maximum_rad": nozzle.high}
    history = {"t_s": nozzle.t[time], "controller_rate": np.array(FEEDS)[feed], "axis": np.array(AXES)[axis]}
    history |= {name: values.ravel() for name, values in sizes.items()}
    feed, axis, phase = np.nonzero(nozzle.turning[..., 0] > 0.0)
    ticks, *ratios = nozzle.turning[feed, axis, phase].T
    statistics = {
        "controller_rate": np.array(FEEDS)[feed],
        "axis": np.array(AXES)[axis],
        "phase": np.array(PHASES)[phase],
    }
    statistics |= {"tick_count": ticks.astype(np.int64), **dict(zip(_TURNING, ratios, strict=True))}
    axis, time = np.indices((2, nozzle.shown_t.size)).reshape(2, -1)
    motion = {"t_s": nozzle.shown_t[time], "axis": np.array(AXES)[axis]}
    motion |= dict(zip(_MOTION, nozzle.shown[time, axis].T, strict=True))
    return {
        "nozzle_travel": travel,
        "nozzle_travel_history": history,
        "motion_statistics": statistics,
        "motion_history": motion,
    }
