"""The tables of what is behind a case's linear covariance, from covariances at events to observability."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lvnav_trade.engines.simulate.statistics import NORM
from lvnav_trade.records import AdjointBudget, CovHistory, Floats
from lvnav_trade.store.schema import TABLES

if TYPE_CHECKING:
    from lvnav_trade.engines.analysis.explain import Explanation
    from lvnav_trade.engines.setup.prepare import Prepared

_QUANTITIES = ("attitude", "velocity", "position")
_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def explained_tables(prepared: Prepared, cov: CovHistory, found: Explanation | None) -> dict[str, dict[str, Any]]:
    """Return the columns of the tables; those that were not asked for have no rows."""
    rows: dict[str, list[dict[str, Any]]] = {"covariances": _totals(prepared, cov)}
    if found is not None:
        rows["covariances"] += _by_source(prepared, found)
        rows["adjoint"] = _adjoint(found.event, found.adjoint) if found.adjoint else []
        rows["sensitivity"] = _sensitivity(prepared, found)
        rows["observability"] = _observability(found)
        rows["nonlinearity"] = _nonlinearity(prepared, found)
        rows["error_bound"] = _error_bound(found)
    names = ("covariances", "adjoint", "sensitivity", "observability", "nonlinearity", "error_bound")
    return {name: _columns(name, rows.get(name, [])) for name in names}


def _columns(name: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    return {column.name: [row[column.name] for row in rows] for column in TABLES[name] if column.name != "case"}


def _groups(prepared: Prepared) -> dict[str, list[int]]:
    """Return the columns of attitude, velocity and position that have three axes."""
    outputs = prepared.outputs
    found = {q: [i for i, output in enumerate(outputs) if output.quantity == q] for q in _QUANTITIES}
    return {q: columns for q, columns in found.items() if len(columns) == 3}


def _entries(prepared: Prepared, columns: list[int], true: Floats, formal: Floats | None) -> list[dict[str, Any]]:
    """List the upper triangle of a covariance (3, 3)."""
    outputs = [prepared.outputs[k] for k in columns]
    return [
        {
            "quantity": outputs[i].quantity,
            "axis": outputs[i].axis,
            "other_axis": outputs[j].axis,
            "unit": outputs[i].unit,
            "true_si2": float(true[i, j]),
            "formal_si2": float("nan") if formal is None else float(formal[i, j]),
        }
        for i, j in _UPPER
    ]


def _totals(prepared: Prepared, cov: CovHistory) -> list[dict[str, Any]]:
    rows = []
    for event, t in prepared.trajectory.events.items():
        at = int(np.argmin(np.abs(cov.t - t)))
        for columns in _groups(prepared).values():
            block = np.ix_(columns, columns)
            label = {"event": event, "t_s": float(cov.t[at]), "source": ""}
            entries = _entries(prepared, columns, cov.true_cov[at][block], cov.formal_cov[at][block])
            rows += [label | entry for entry in entries]
    return rows


def _by_source(prepared: Prepared, found: Explanation) -> list[dict[str, Any]]:
    rows = []
    for part in found.by_source:
        for s, source in enumerate(part.sources):
            label = {"event": part.event, "t_s": part.time, "source": source}
            for q, columns in enumerate(_groups(prepared).values()):
                rows += [label | entry for entry in _entries(prepared, columns, part.covariance[s, q], None)]
    return rows


def _adjoint(event: str, budget: AdjointBudget) -> list[dict[str, Any]]:
    """List the contributions by axis and, as their sum, of the norm; bins without any are left out."""
    series = [(o.quantity, o.axis, o.unit, budget.contribution[k]) for k, o in enumerate(budget.outputs)]
    for quantity in _QUANTITIES:
        members = [entry for entry in series if entry[0] == quantity and entry[1] != NORM]
        series.append((quantity, NORM, members[0][2], np.sum([entry[3] for entry in members], axis=0)))
    return [
        {
            "event": event,
            "t_s": budget.time,
            "bin_start_s": float(budget.edges[b]),
            "bin_end_s": float(budget.edges[b + 1]),
            "source": budget.sources[s],
            "quantity": quantity,
            "axis": axis,
            "unit": unit,
            "variance_si2": float(variance[s, b]),
        }
        for quantity, axis, unit, variance in series
        for s, b in zip(*np.nonzero(variance > 0.0), strict=True)
    ]


def _sensitivity(prepared: Prepared, found: Explanation) -> list[dict[str, Any]]:
    units = {output.quantity: output.unit for output in prepared.outputs}
    return [
        {
            "event": found.event,
            "t_s": part.time,
            "source": source,
            "quantity": part.quantity,
            "unit": units[part.quantity],
            "factor_ratio": factor,
            "frozen_si": float(part.frozen[s, f]),
            "retuned_si": float(part.retuned[s, f]),
        }
        for part in found.sensitivity
        for s, source in enumerate(part.sources)
        for f, factor in enumerate(part.factors)
    ]


def _observability(found: Explanation) -> list[dict[str, Any]]:
    return [
        {
            "phase": phase.name,
            "t_s": phase.start,
            "t_end_s": phase.end,
            "row_count": phase.rows,
            "state_count": len(phase.singular),
            "rank_count": phase.rank,
            "tolerance_ratio": phase.tolerance,
            "singular_number": k + 1,
            "singular_ratio": float(value),
            "weakest": phase.weakest,
            "direction": phase.directions[k] if phase.directions else phase.weakest,
        }
        for phase in found.phases
        for k, value in enumerate(phase.singular)
    ]


def _nonlinearity(prepared: Prepared, found: Explanation) -> list[dict[str, Any]]:
    names = [
        f"{what} {axis}" for what, axes in zip(_QUANTITIES, ("xyz",) * 3, strict=True) for axis in axes
    ]  # frame i, as the filter carries them
    return [
        {
            "event": event,
            "t_s": part.time,
            "motion_ratio": part.motion,
            "state": names[part.state],
            "transition_ratio": part.transition,
            "row_ratio": part.rows,
        }
        for event, part in found.nonlinear
    ]


def _error_bound(found: Explanation) -> list[dict[str, Any]]:
    bound = found.bound
    if bound is None:
        return []
    matrices = [("Q", "initial sigma^2", bound.low, bound.high), *(("R", *row) for row in bound.rows)]
    return [
        {
            "matrix": matrix,
            "unit": unit,
            "low_si": low,
            "high_si": high,
            "rank_count": bound.rank,
            "state_count": bound.states,
            "weakest": found.unbounded,
        }
        for matrix, unit, low, high in matrices
    ]
