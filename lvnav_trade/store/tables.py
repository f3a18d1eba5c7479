"""The tables of one case, from what the engines hand over."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pyarrow as pa

from lvnav_trade import frames
from lvnav_trade.engines.simulate.statistics import NORM, BlockSummary, add_norms, columns, norm_groups, quantiles
from lvnav_trade.records import MODES, NO_CHANGES, REASONS, CovHistory, Floats, Output
from lvnav_trade.store.columns import column, repeated
from lvnav_trade.store.controlled import controlled_tables
from lvnav_trade.store.diagnostics import explained_tables
from lvnav_trade.store.schema import arrow_schema, error_column
from lvnav_trade.store.sky import sky_tables, thresholds
from lvnav_trade.store.states import state_tables
from lvnav_trade.store.worst import worst_table
from lvnav_trade.world.events import resolve

if TYPE_CHECKING:
    from lvnav_trade.engines.analysis.explain import Explanation
    from lvnav_trade.engines.setup.prepare import Prepared
    from lvnav_trade.engines.setup.starts import StartDraws
    from lvnav_trade.steering.nozzle import Controlled

FAILURES = {0: "", 1: "not finite", 2: "diverged"}
_DRAWN = ("attitude", "velocity", "position")
"""Quantities of which the budget is kept over the whole flight."""
"""Innovation channels of a filter with an attitude reference."""
_NORM_LIKE_CONSTANT = 1e9
"""Degrees of freedom of a mean square that does not vary from run to run."""


class CaseInfo(NamedTuple):
    """A case: id (12 hexadecimal digits: resolved scenario and seed), label for people, value of each axis."""

    id: str
    label: str
    axes: dict[str, str]


def case_tables(
    case: CaseInfo,
    prepared: Prepared,
    cov: CovHistory,
    summary: BlockSummary | None,
    explained: Explanation | None = None,
    control: Controlled | None = None,
) -> dict[str, pa.Table]:
    """Return the tables of one case that do not grow with its runs; without Monte Carlo its columns are NaN and counts
    0.
    """
    lincov = _LinCov(cov, prepared.outputs)
    contents = {
        "cases": _cases(case, prepared, summary),
        "outputs": _outputs(prepared.outputs),
        "history": _history(prepared.outputs, cov, lincov, summary),
        "consistency": _consistency(prepared, cov, summary),
        "innovations": _innovations(cov, summary),
        "whiteness": _whiteness(prepared, summary),
        "budget": _budget(prepared, cov),
        "reference": _reference(prepared, cov.t),
        "events": _events(prepared),
        **sky_tables(prepared),
        **state_tables(prepared, cov),
        **explained_tables(prepared, cov, explained),
        **controlled_tables(control),
    }
    return {name: _arrow(name, case.id, content) for name, content in contents.items()}


def row_tables(case_id: str, outputs: tuple[Output, ...], part: BlockSummary | None) -> dict[str, pa.Table]:
    """Return the tables with rows of every run, for some runs of a case; without rows where there are none."""
    contents = {
        "runs": _runs(outputs, part),
        "worst": worst_table(outputs, part, FAILURES),
        "logic": _logic(part),
    }
    return {name: _arrow(name, case_id, content) for name, content in contents.items()}


def starts_table(case_id: str, starts: StartDraws | None) -> dict[str, pa.Table]:
    """Return the table of what runs draw at their start, as `row_tables`."""
    return {"starts": _arrow("starts", case_id, _starts(starts))}


def requirement_tables(case_id: str, prepared: Prepared, cov: CovHistory, summary: BlockSummary) -> dict[str, pa.Table]:
    """Return the tables that requirements are tested on, of some runs of a case."""
    contents = {
        "outputs": _outputs(prepared.outputs),
        "runs": _runs(prepared.outputs, summary),
        "worst": worst_table(prepared.outputs, summary, FAILURES),
        "events": _events(prepared),
        **state_tables(prepared, cov),
    }
    return {name: _arrow(name, case_id, content) for name, content in contents.items()}


def _arrow(name: str, case_id: str, content: dict[str, Any]) -> pa.Table:
    length = max(map(len, content.values()), default=0)
    schema = arrow_schema(name)
    full = content or {name: [] for name in schema.names if name != "case"}
    schema = arrow_schema(name, tuple(each for each in full if each not in schema.names))
    whole = [column(full[field.name], field.type) for field in schema if field.name != "case"]
    return pa.table([repeated(case_id, length), *whole], schema=schema)


# --- helpers ----------------------------------------------------------------------------------------------------------


class _LinCov:
    """The columns of linear covariance: formal, true, mean (n_hist, n_column), degrees of freedom per run."""

    def __init__(self, cov: CovHistory, outputs: tuple[Output, ...]) -> None:
        self.formal, self.true, self.mean = (
            add_norms(part, outputs) for part in (cov.formal, cov.true_sigma, cov.mean)
        )
        groups = [[index] for index in range(len(outputs))] + list(norm_groups(outputs).values())
        self.dof = np.stack([_freedom(cov.true_cov[:, i][:, :, i], cov.mean[:, i]) for i in groups], axis=1)


def _freedom(covariance: Floats, mean: Floats) -> Floats:
    """Return the chi-square degrees of freedom (n,) of |x|^2, x normal with covariance (n, k, k) and mean (n, k).

    Two moments are matched (Satterthwaite): E = tr C + m'm, Var = 2 tr C^2 + 4 m'Cm, freedom 2 E^2 / Var.
    """
    expected = np.trace(covariance, axis1=1, axis2=2) + np.sum(mean**2, axis=1)
    spread = 2.0 * np.sum(covariance**2, axis=(1, 2)) + 4.0 * np.einsum("ni,nij,nj->n", mean, covariance, mean)
    constant = spread <= 2.0 * expected**2 / _NORM_LIKE_CONSTANT
    return np.where(constant, _NORM_LIKE_CONSTANT, 2.0 * expected**2 / np.where(constant, 1.0, spread))


def _long(outputs: tuple[Output, ...], n: int) -> dict[str, list[str]]:
    """Name each output n times, output after output."""
    return {
        "quantity": [output.quantity for output in outputs for _ in range(n)],
        "axis": [output.axis for output in outputs for _ in range(n)],
        "unit": [output.unit for output in outputs for _ in range(n)],
    }


def _flat(values: Floats) -> Floats:
    """Put (n_time, n_column) in the order of `_long`."""
    return values.T.ravel()


def nees_dof(prepared: Prepared) -> int:
    """Return how many components the engines put into the normalised estimation error squared: the estimated states."""
    layout = getattr(prepared, "layout", None)
    return int(layout.n_estimated) if layout is not None else len(prepared.outputs)


def _gate(prepared: Prepared) -> float:
    """Return the gate on normalised innovations; NaN where there is none."""
    model = getattr(prepared, "model", None)
    squared = model.gate_squared if model is not None else np.inf
    return float(np.sqrt(squared)) if np.isfinite(squared) else float("nan")


def _has_logic(prepared: Prepared) -> bool:
    """Whether the filter starts, rejects and stops by rules of its own."""
    return getattr(getattr(prepared, "options", None), "rules", None) is not None


# --- one function per table -------------------------------------------------------------------------------------------


def _cases(case: CaseInfo, prepared: Prepared, summary: BlockSummary | None) -> dict[str, Any]:
    return {
        "label": [case.label],
        "axes": [json.dumps(case.axes)],
        "run_count": [summary.n_run if summary else 0],
        "failed_count": [int((summary.failed != 0).sum()) if summary else 0],
        "nees_dof_count": [nees_dof(prepared)],
        "gate_ratio": [_gate(prepared)],
        "logic": [_has_logic(prepared)],
        **thresholds(prepared.scenario),
        "epoch": [prepared.trajectory.epoch],
        "facts": [json.dumps(prepared.trajectory.facts, sort_keys=True, default=float)],
    }


def _outputs(outputs: tuple[Output, ...]) -> dict[str, Any]:
    every = columns(outputs)
    return {
        **_long(every, 1),
        "label_unit": [output.label_unit for output in every],
        "label_factor_ratio": [output.label_factor for output in every],
    }


def _runs(outputs: tuple[Output, ...], summary: BlockSummary | None) -> dict[str, Any]:
    every = columns(outputs)
    names = [error_column(output.quantity, output.axis, output.unit) for output in every]
    if summary is None:
        empty = ("run_number", "event", "t_s", "failure", "t_failed_s", "nees_ratio", *names)
        return {name: [] for name in empty}
    n_event = len(summary.events)
    content = {
        "run_number": np.repeat(summary.runs, n_event),
        "event": list(summary.events) * summary.n_run,
        "t_s": np.tile(summary.t_event, summary.n_run),
        "failure": [FAILURES.get(int(code), f"code {code}") for code in summary.failed for _ in range(n_event)],
        "t_failed_s": np.repeat(summary.t_failed, n_event),
        "nees_ratio": summary.event_nees.ravel(),
    }
    return content | {name: summary.event_error[:, :, k].ravel() for k, name in enumerate(names)}


def _logic(summary: BlockSummary | None) -> dict[str, Any]:
    """List every change of what the filter does, run after run."""
    changes = summary.changes if summary is not None else NO_CHANGES
    run, t, before, after, why = changes.T
    return {
        "run_number": run.astype(np.int64),
        "t_s": t,
        "from_mode": [MODES[int(mode)] for mode in before],
        "to_mode": [MODES[int(mode)] for mode in after],
        "reason": [REASONS[int(reason)] for reason in why],
    }


def _starts(starts: StartDraws | None) -> dict[str, Any]:
    if starts is None:
        return {name: [] for name in ("run_number", "source", "axis", "draw_ratio")}
    n_run, n_draw = starts.values.shape
    return {
        "run_number": np.repeat(starts.runs, n_draw),
        "source": list(starts.sources) * n_run,
        "axis": list(starts.axes) * n_run,
        "draw_ratio": starts.values.ravel(),
    }


def _history(
    outputs: tuple[Output, ...], cov: CovHistory, lincov: _LinCov, summary: BlockSummary | None
) -> dict[str, Any]:
    every = columns(outputs)
    n = len(cov.t)
    return {
        "t_s": np.tile(cov.t, len(every)),
        **_long(every, n),
        "run_count": np.full(n * len(every), int(summary.n_good[0]) if summary else 0),
        **{name: _flat(value) for name, value in _monte_carlo(summary, (n, len(every))).items()},
        "lincov_formal_si": _flat(lincov.formal),
        "lincov_true_si": _flat(lincov.true),
        "lincov_mean_si": _flat(lincov.mean),
        "dof_ratio": _flat(lincov.dof),
    }


def _monte_carlo(summary: BlockSummary | None, shape: tuple[int, int]) -> dict[str, Floats]:
    names = ("mean_si", "rms_si", "filter_sigma_si", "q50_si", "q95_si", "q997_si")
    if summary is None or summary.n_good[0] == 0:
        return {name: np.full(shape, np.nan) for name in names}
    n = float(summary.n_good[0])
    moments = (summary.total / n, np.sqrt(summary.squares / n), np.sqrt(summary.sigma_squares / n))
    values = (*moments, *(quantiles(summary, probability) for probability in (0.5, 0.95, 0.997)))
    return dict(zip(names, values, strict=True))


def _consistency(prepared: Prepared, cov: CovHistory, summary: BlockSummary | None) -> dict[str, Any]:
    n_good = int(summary.n_good[0]) if summary else 0
    return {
        "t_s": cov.t,
        "run_count": np.full(len(cov.t), n_good),
        "nees_mean_ratio": summary.nees / n_good if summary and n_good else np.full(len(cov.t), np.nan),
        "nees_dof_count": np.full(len(cov.t), nees_dof(prepared)),
        "expected_nees_ratio": cov.expected_nees,
    }


def _innovations(cov: CovHistory, summary: BlockSummary | None) -> dict[str, Any]:
    n = len(cov.t_epoch)
    none = np.zeros(n, dtype=np.int64)
    return {
        "t_s": cov.t_epoch,
        "run_count": np.full(n, int(summary.n_good[0]) if summary else 0),
        "nis_sum_ratio": summary.nis if summary else np.full(n, np.nan),
        "row_count": summary.n_row if summary else none,
        "reject_count": summary.n_reject if summary else none,
        "lincov_row_count": cov.n_row.astype(np.int64),
        "expected_nis_ratio": cov.expected_nis,
        "false_rejection_ratio": cov.false_rejection,
    }


def _whiteness(prepared: Prepared, summary: BlockSummary | None) -> dict[str, Any]:
    if summary is None:
        return {name: [] for name in ("channel", "lag_number", "pair_count", "product_sum_ratio")}
    n_lag, n_channel = summary.lag_sum.shape
    names = prepared.channel_names
    return {
        "channel": [name for name in names for _ in range(n_lag)],
        "lag_number": np.tile(np.arange(n_lag), n_channel),
        "pair_count": summary.lag_count.T.ravel(),
        "product_sum_ratio": summary.lag_sum.T.ravel(),
    }


def _budget(prepared: Prepared, cov: CovHistory) -> dict[str, Any]:
    """Split the variance by source: every column at the events, the navigation norms over the history."""
    outputs, every = prepared.outputs, columns(prepared.outputs)
    if not cov.sources:
        names = ("event", "t_s", "source", "quantity", "axis", "unit", "sigma_si", "share_ratio")
        return {name: [] for name in names}
    variance = add_norms(np.sqrt(np.maximum(cov.budget, 0.0)), outputs) ** 2
    total = variance.sum(axis=1, keepdims=True)
    share = np.divide(variance, total, out=np.zeros_like(variance), where=total > 0)
    summed = [k for k, output in enumerate(every) if output.axis == NORM and output.quantity in _DRAWN]
    blocks = [("", np.arange(len(cov.t)), summed)]
    for name, t in prepared.trajectory.events.items():
        blocks.append((name, np.array([np.argmin(np.abs(cov.t - t))]), list(range(len(every)))))
    rows: dict[str, list[Any]] = {}
    for event, times, chosen in blocks:
        for s, source in enumerate(cov.sources):
            n = len(times) * len(chosen)
            piece: dict[str, Any] = {
                "event": [event] * n,
                "t_s": np.tile(cov.t[times], len(chosen)),
                "source": [source] * n,
                **_long(tuple(every[k] for k in chosen), len(times)),
                "sigma_si": _flat(np.sqrt(variance[times, s][:, chosen])),
                "share_ratio": _flat(share[times, s][:, chosen]),
            }
            for key, values in piece.items():
                rows.setdefault(key, []).extend(values)
    return rows


def _reference(prepared: Prepared, t: Floats) -> dict[str, Any]:
    """Describe the flight at the ticks nearest to the history times."""
    reference = prepared.reference
    middle = 0.5 * (reference.t[1:] + reference.t[:-1])
    at = np.searchsorted(middle, t)
    r_i, v_i = reference.r_i[at], reference.v_i[at]
    theta = frames.earth_angle(prepared.trajectory.theta0, reference.t[at])
    latitude, longitude, altitude = frames.geodetic_from_ecef(frames.ecef_from_eci(r_i, theta))
    return {
        "t_s": reference.t[at],
        "latitude_rad": latitude,
        "longitude_rad": longitude,
        "altitude_m": altitude,
        "inertial_speed_m_per_s": np.linalg.norm(v_i, axis=1),
        "ground_speed_m_per_s": np.linalg.norm(frames.earth_velocity(r_i, v_i), axis=1),
        "specific_force_m_per_s2": np.linalg.norm(reference.f_b[at], axis=1),
        "body_rate_rad_per_s": np.linalg.norm(reference.w_ib_b[at], axis=1),
    }


def _events(prepared: Prepared) -> dict[str, Any]:
    events = prepared.trajectory.events
    rows = [(name, "event", t, t) for name, t in events.items()]
    for number, fault in enumerate(prepared.scenario.faults, start=1):
        start = resolve(fault.start, prepared.trajectory.instants)
        rows.append((f"{fault.kind} {number}", "fault", start, start + fault.duration))
    return {
        "event": [row[0] for row in rows],
        "kind": [row[1] for row in rows],
        "t_s": [row[2] for row in rows],
        "t_end_s": [row[3] for row in rows],
    }
