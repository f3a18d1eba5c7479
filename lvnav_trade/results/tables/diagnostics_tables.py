"""Tables of the covariance diagnostics, from covariances at events to observability."""

from typing import Any

import numpy as np

from lvnav_trade.covariance.diagnostics.case_diagnostics import CaseDiagnostics
from lvnav_trade.quantities.records import INJECTION, ORBIT, AdjointBudget, CovHistory, Floats, InjectionLaw
from lvnav_trade.quantities.state_layout import PROTECTED
from lvnav_trade.results.tables.run_tables import INJECTION_UNITS
from lvnav_trade.simulation.preparation.prepare import PreparedCase
from lvnav_trade.simulation.statistics import NORM

_QUANTITIES = ("attitude", "velocity", "position")
_WITH_BACKUP = (*_QUANTITIES, *(f"backup_{quantity}" for quantity in _QUANTITIES))
_UPPER = tuple(zip(*np.triu_indices(3), strict=True))
Rows = list[dict[str, Any]]


def diagnostics_rows(
    prepared_case: PreparedCase, cov: CovHistory, diagnostics: CaseDiagnostics | None
) -> dict[str, Rows]:
    """Return the rows of the tables of the requested diagnostics, by table."""
    rows = injection_rows(cov.injection)
    rows["covariances"] = _total_rows(prepared_case, cov)
    if diagnostics is None:
        return rows
    rows["covariances"] += _source_rows(prepared_case, diagnostics)
    if diagnostics.adjoint:
        rows["adjoint"] = _adjoint_rows(diagnostics.event, diagnostics.adjoint)
    rows["sensitivity"] = _sensitivity_rows(prepared_case, diagnostics)
    rows["observability"] = _observability_rows(diagnostics)
    rows["nonlinearity"] = _nonlinearity_rows(diagnostics)
    rows["error_bound"] = _bound_rows(diagnostics)
    rows["allan"] = _allan_rows(diagnostics)
    rows["protection"] = _protection_rows(prepared_case, diagnostics)
    return rows


def _axis_groups(prepared_case: PreparedCase) -> list[list[int]]:
    """Return the outputs of attitude, velocity and position that have three axes; then those of a backup."""
    groups = []
    for quantity in _WITH_BACKUP:
        group = [k for k, output in enumerate(prepared_case.outputs) if output.quantity == quantity]
        if len(group) == 3:
            groups.append(group)
    return groups


def _covariance_rows(prepared_case: PreparedCase, group: list[int], true: Floats, formal: Floats) -> Rows:
    """Return the rows of the upper triangle of a covariance.

    Parameters
    ----------
    prepared_case : PreparedCase
        The prepared case, with its outputs.
    group : list of int
        Indices of three outputs.
    true, formal : (3, 3) array
        Covariance of the true error, and covariance assumed by the filter, SI.
    """
    outputs = [prepared_case.outputs[k] for k in group]
    return [
        {
            "quantity": outputs[i].quantity,
            "axis": outputs[i].axis,
            "other_axis": outputs[j].axis,
            "unit": outputs[i].unit,
            "true_si2": float(true[i, j]),
            "formal_si2": float(formal[i, j]),
        }
        for i, j in _UPPER
    ]


def _total_rows(prepared_case: PreparedCase, cov: CovHistory) -> Rows:
    """Return the rows of the covariances of all sources together, at the events."""
    rows: Rows = []
    for event, t in prepared_case.trajectory.events.items():
        k = int(np.argmin(np.abs(cov.t - t)))
        name = {"event": event, "t_s": float(cov.t[k]), "source": ""}
        for group in _axis_groups(prepared_case):
            block = np.ix_(group, group)
            true = cov.true_cov[k][block]
            formal = cov.formal_cov[k][block]
            entries = _covariance_rows(prepared_case, group, true, formal)
            rows += [name | entry for entry in entries]
    return rows


def _source_rows(prepared_case: PreparedCase, diagnostics: CaseDiagnostics) -> Rows:
    """Return the rows of the covariances by source, at the events; the filter has no covariance by source."""
    missing = np.full((3, 3), np.nan)
    rows: Rows = []
    for budget in diagnostics.source_covariances:
        for source, covariances in zip(budget.sources, budget.covariance, strict=True):
            name = {"event": budget.event, "t_s": budget.time, "source": source}
            for group, true in zip(_axis_groups(prepared_case), covariances, strict=False):
                rows += [name | entry for entry in _covariance_rows(prepared_case, group, true, missing)]
    return rows


def _adjoint_rows(event: str, budget: AdjointBudget) -> Rows:
    """Return the contributions by axis and, as their sum, of the norm; bins without contribution are omitted."""
    series = [
        (output.quantity, output.axis, output.unit, budget.contribution[k]) for k, output in enumerate(budget.outputs)
    ]
    for quantity in dict.fromkeys(output.quantity for output in budget.outputs):
        axes = []
        for k, output in enumerate(budget.outputs):
            if output.quantity == quantity and output.axis != NORM:
                axes.append(k)
        norm = np.sum([budget.contribution[k] for k in axes], axis=0)
        series.append((quantity, NORM, budget.outputs[axes[0]].unit, norm))

    rows: Rows = []
    for quantity, axis, unit, variance in series:
        for source, time_bin in zip(*np.nonzero(variance > 0.0), strict=True):
            rows.append(
                {
                    "event": event,
                    "t_s": budget.time,
                    "bin_start_s": float(budget.edges[time_bin]),
                    "bin_end_s": float(budget.edges[time_bin + 1]),
                    "source": budget.sources[source],
                    "quantity": quantity,
                    "axis": axis,
                    "unit": unit,
                    "variance_si2": float(variance[source, time_bin]),
                }
            )
    return rows


def _sensitivity_rows(prepared_case: PreparedCase, diagnostics: CaseDiagnostics) -> Rows:
    unit_by_quantity = {output.quantity: output.unit for output in prepared_case.outputs}
    rows: Rows = []
    for sensitivity in diagnostics.sensitivity:
        for s, source in enumerate(sensitivity.sources):
            for f, factor in enumerate(sensitivity.factors):
                rows.append(
                    {
                        "event": diagnostics.event,
                        "t_s": sensitivity.time,
                        "source": source,
                        "quantity": sensitivity.quantity,
                        "unit": unit_by_quantity[sensitivity.quantity],
                        "factor_ratio": factor,
                        "frozen_si": float(sensitivity.frozen_rms[s, f]),
                        "retuned_si": float(sensitivity.retuned_rms[s, f]),
                    }
                )
    return rows


def _observability_rows(diagnostics: CaseDiagnostics) -> Rows:
    return [
        {
            "phase": phase.name,
            "t_s": phase.start,
            "t_end_s": phase.end,
            "measurement_count": phase.measurement_count,
            "state_count": len(phase.singular_values),
            "rank_count": phase.rank,
            "tolerance_ratio": phase.tolerance,
            "singular_number": k + 1,
            "singular_ratio": float(value),
            "weakest_direction": phase.weakest_direction,
            "direction": phase.directions[k] if phase.directions else phase.weakest_direction,
        }
        for phase in diagnostics.phases
        for k, value in enumerate(phase.singular_values)
    ]


def injection_rows(law: InjectionLaw | None) -> dict[str, Rows]:
    """Return the rows of linear covariance of an injection; none without guidance."""
    if law is None:
        return {}
    if law.reason:
        return {"injection_expected": [{"reason": law.reason, "quantity": "", "unit": ""}]}
    return {
        "injection_expected": _expected_rows(law),
        "injection_covariances": _injection_covariance_rows(law),
    }


def _expected_rows(law: InjectionLaw) -> Rows:
    """Return the rows of the quantities of an injection; target, knowledge and execution are of the orbit only."""
    sigma = np.sqrt(np.diag(law.covariance.sum(axis=0)))
    missing = np.full(len(INJECTION) - len(ORBIT), np.nan)
    target = np.append(law.target, missing)
    knowledge = np.append(np.sqrt(law.knowledge.sum(axis=0)), missing)
    execution = np.append(np.sqrt(law.execution.sum(axis=0)), missing)
    return [
        {
            "reason": "",
            "quantity": quantity,
            "unit": INJECTION_UNITS[quantity],
            "reference_si": float(law.reference[k]),
            "target_si": float(target[k]),
            "mean_si": float(law.mean[k]),
            "sigma_si": float(sigma[k]),
            "second_order_si": float(law.second_order[k]),
            "knowledge_si": float(knowledge[k]),
            "execution_si": float(execution[k]),
        }
        for k, quantity in enumerate(INJECTION)
    ]


def _injection_covariance_rows(law: InjectionLaw) -> Rows:
    """Return the rows of the upper triangles of the covariances of an injection, by source."""
    rows: Rows = []
    for k, source in enumerate(law.sources):
        group = "navigation" if k < law.n_navigation else "vehicle"
        for i, quantity in enumerate(INJECTION):
            for j in range(i, len(INJECTION)):
                rows.append(
                    {
                        "source": source,
                        "source_group": group,
                        "quantity": quantity,
                        "other_quantity": INJECTION[j],
                        "unit": INJECTION_UNITS[quantity],
                        "other_unit": INJECTION_UNITS[INJECTION[j]],
                        "covariance_si2": float(law.covariance[k, i, j]),
                    }
                )
    return rows


def _nonlinearity_rows(diagnostics: CaseDiagnostics) -> Rows:
    states = [f"{quantity} {axis}" for quantity in _QUANTITIES for axis in "xyz"]  # of the filter, in frame i
    return [
        {
            "event": event,
            "t_s": nonlinearity.time,
            "propagation_ratio": nonlinearity.motion,
            "state": states[nonlinearity.state],
            "transition_ratio": nonlinearity.transition,
            "measurement_ratio": nonlinearity.rows,
        }
        for event, nonlinearity in diagnostics.nonlinearities
    ]


def _allan_rows(diagnostics: CaseDiagnostics) -> Rows:
    return [
        {
            "sensor": curve.sensor,
            "unit": curve.unit,
            "tau_s": float(tau),
            "simulated_si": float(curve.stream[k]),
            "card_si": float(curve.card[k]),
            "white_noise_si": float(curve.white[k]),
            "bias_instability_si": float(curve.instability[k]),
            "random_walk_si": float(curve.walk[k]),
        }
        for curve in diagnostics.allan
        for k, tau in enumerate(curve.tau)
    ]


def _protection_rows(prepared_case: PreparedCase, diagnostics: CaseDiagnostics) -> Rows:
    """Return the protection levels by time, quantity and axis; 3d: the length of the box of the three axes."""
    protection_levels = diagnostics.protection
    if protection_levels is None:
        return []
    axes = [output.axis for output in prepared_case.outputs if output.quantity == "position"]
    satellites = np.array([*protection_levels.satellites, ""])  # the last is that of no satellite, number -1
    rows: Rows = []
    for q, (quantity, unit) in enumerate(PROTECTED.items()):
        worst = satellites[protection_levels.worst_satellite[:, q].astype(int)]
        level = _append_norm(protection_levels.level[:, q])
        fault_free = _append_norm(protection_levels.fault_free_level[:, q])
        sigma = _append_norm(protection_levels.sigma[:, q])
        for a, axis in enumerate((*axes, "3d")):
            for k, t in enumerate(protection_levels.t):
                rows.append(
                    {
                        "t_s": float(t),
                        "quantity": quantity,
                        "axis": axis,
                        "unit": unit,
                        "level_si": float(level[k, a]),
                        "fault_free_si": float(fault_free[k, a]),
                        "sigma_si": float(sigma[k, a]),
                        "satellite": str(worst[k]),
                    }
                )
    return rows


def _append_norm(values: Floats) -> Floats:
    """Return values (n, 3) with their norms as fourth column."""
    return np.hstack([values, np.linalg.norm(values, axis=1)[:, None]])


def _bound_rows(diagnostics: CaseDiagnostics) -> Rows:
    """Return the bounds of the error by the initial covariance (Q) and by the measurements (R)."""
    bound = diagnostics.bound
    if bound is None:
        return []
    matrices = [("Q", "initial sigma^2", bound.smallest_eigenvalue, bound.largest_eigenvalue)]
    matrices += [("R", unit, low, high) for unit, low, high in bound.noise_bounds]
    return [
        {
            "matrix": matrix,
            "unit": unit,
            "lower_bound_si": low,
            "upper_bound_si": high,
            "rank_count": bound.rank,
            "state_count": bound.state_count,
            "weakest_direction": diagnostics.weakest_direction,
        }
        for matrix, unit, low, high in matrices
    ]
