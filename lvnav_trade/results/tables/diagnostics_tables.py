"""Tables of the covariance diagnostics, from covariances at events to observability."""

from typing import Any

import numpy as np

from lvnav_trade.covariance.diagnostics.case_diagnostics import CaseDiagnostics
from lvnav_trade.quantities.records import INJECTION, ORBIT, AdjointBudget, CovHistory, Floats, InjectionLaw
from lvnav_trade.quantities.state_layout import PROTECTED
from lvnav_trade.results.tables.run_tables import INJECTION_UNITS
from lvnav_trade.simulation.preparation.prepare import Prepared
from lvnav_trade.simulation.statistics import NORM

_QUANTITIES = ("attitude", "velocity", "position")
_WITH_BACKUP = (*_QUANTITIES, *(f"backup_{quantity}" for quantity in _QUANTITIES))
_UPPER = tuple(zip(*np.triu_indices(3), strict=True))
Rows = list[dict[str, Any]]


def diagnostics_rows(prepared: Prepared, cov: CovHistory, found: CaseDiagnostics | None) -> dict[str, Rows]:
    """Return the rows of the tables that were asked for."""
    if found is None:
        return {"covariances": _totals(prepared, cov), **injection_rows(cov.injection)}
    return {
        **injection_rows(cov.injection),
        "covariances": [*_totals(prepared, cov), *_by_source(prepared, found)],
        "adjoint": _adjoint(found.event, found.adjoint) if found.adjoint else [],
        "sensitivity": _sensitivity(prepared, found),
        "observability": _observability(found),
        "nonlinearity": _nonlinearity(found),
        "error_bound": _error_bound(found),
        "allan": _allan(found),
        "protection": _protection(prepared, found),
    }


def _groups(prepared: Prepared) -> list[list[int]]:
    """Return the columns of attitude, velocity and position that have three axes; then those of a backup."""
    found = ([k for k, one in enumerate(prepared.outputs) if one.quantity == quantity] for quantity in _WITH_BACKUP)
    return [columns for columns in found if len(columns) == 3]


def _entries(prepared: Prepared, columns: list[int], true: Floats, formal: Floats, **label: Any) -> Rows:
    """List the upper triangle of a covariance (3, 3)."""
    outputs = [prepared.outputs[k] for k in columns]
    return [
        {
            **label,
            "quantity": outputs[i].quantity,
            "axis": outputs[i].axis,
            "other_axis": outputs[j].axis,
            "unit": outputs[i].unit,
            "true_si2": float(true[i, j]),
            "formal_si2": float(formal[i, j]),
        }
        for i, j in _UPPER
    ]


def _totals(prepared: Prepared, cov: CovHistory) -> Rows:
    rows = []
    for event, t in prepared.trajectory.events.items():
        at = int(np.argmin(np.abs(cov.t - t)))
        for columns in _groups(prepared):
            true, formal = (part[at][np.ix_(columns, columns)] for part in (cov.true_cov, cov.formal_cov))
            rows += _entries(prepared, columns, true, formal, event=event, t_s=float(cov.t[at]), source="")
    return rows


def _by_source(prepared: Prepared, diagnostics: CaseDiagnostics) -> Rows:
    none = np.full((3, 3), np.nan)
    return [
        row
        for part in diagnostics.by_source
        for source, covariance in zip(part.sources, part.covariance, strict=True)
        for columns, true in zip(_groups(prepared), covariance, strict=False)
        for row in _entries(prepared, columns, true, none, event=part.event, t_s=part.time, source=source)
    ]


def _adjoint(event: str, budget: AdjointBudget) -> Rows:
    """List the contributions by axis and, as their sum, of the norm; bins without any are left out."""
    series = [(o.quantity, o.axis, o.unit, budget.contribution[k]) for k, o in enumerate(budget.outputs)]
    for quantity in dict.fromkeys(output.quantity for output in budget.outputs):
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


def _sensitivity(prepared: Prepared, diagnostics: CaseDiagnostics) -> Rows:
    units = {output.quantity: output.unit for output in prepared.outputs}
    return [
        {
            "event": diagnostics.event,
            "t_s": part.time,
            "source": source,
            "quantity": part.quantity,
            "unit": units[part.quantity],
            "factor_ratio": factor,
            "frozen_si": float(part.frozen[s, f]),
            "retuned_si": float(part.retuned[s, f]),
        }
        for part in diagnostics.sensitivity
        for s, source in enumerate(part.sources)
        for f, factor in enumerate(part.factors)
    ]


def _observability(diagnostics: CaseDiagnostics) -> Rows:
    return [
        {
            "phase": phase.name,
            "t_s": phase.start,
            "t_end_s": phase.end,
            "measurement_count": phase.rows,
            "state_count": len(phase.singular),
            "rank_count": phase.rank,
            "tolerance_ratio": phase.tolerance,
            "singular_number": k + 1,
            "singular_ratio": float(value),
            "weakest_direction": phase.weakest,
            "direction": phase.directions[k] if phase.directions else phase.weakest,
        }
        for phase in diagnostics.phases
        for k, value in enumerate(phase.singular)
    ]


def injection_rows(law: InjectionLaw | None) -> dict[str, Rows]:
    """Return the rows of linear covariance of an injection; none without guidance."""
    if law is None:
        return {}
    if law.why:
        return {"injection_expected": [{"reason": law.why, "quantity": "", "unit": ""}]}
    total = law.covariance.sum(axis=0)
    n_other = len(INJECTION) - len(ORBIT)
    columns = {
        "reference_si": law.reference,
        "target_si": np.append(law.target, np.full(n_other, np.nan)),
        "mean_si": law.mean,
        "sigma_si": np.sqrt(np.diag(total)),
        "second_order_si": law.second_order,
        "knowledge_si": np.append(np.sqrt(law.knowledge.sum(axis=0)), np.full(n_other, np.nan)),
        "execution_si": np.append(np.sqrt(law.execution.sum(axis=0)), np.full(n_other, np.nan)),
    }
    expected = [
        {
            "reason": "",
            "quantity": quantity,
            "unit": INJECTION_UNITS[quantity],
            **{name: float(values[k]) for name, values in columns.items()},
        }
        for k, quantity in enumerate(INJECTION)
    ]
    joint = [
        {
            "source": source,
            "source_group": "navigation" if number < law.n_navigation else "vehicle",
            "quantity": quantity,
            "other_quantity": INJECTION[j],
            "unit": INJECTION_UNITS[quantity],
            "other_unit": INJECTION_UNITS[INJECTION[j]],
            "covariance_si2": float(law.covariance[number, i, j]),
        }
        for number, source in enumerate(law.sources)
        for i, quantity in enumerate(INJECTION)
        for j in range(i, len(INJECTION))
    ]
    return {"injection_expected": expected, "injection_covariances": joint}


def _nonlinearity(diagnostics: CaseDiagnostics) -> Rows:
    names = [f"{quantity} {axis}" for quantity in _QUANTITIES for axis in "xyz"]  # frame i, as the filter carries them
    return [
        {
            "event": event,
            "t_s": part.time,
            "propagation_ratio": part.motion,
            "state": names[part.state],
            "transition_ratio": part.transition,
            "measurement_ratio": part.rows,
        }
        for event, part in diagnostics.nonlinear
    ]


def _allan(diagnostics: CaseDiagnostics) -> Rows:
    names = ("simulated_si", "card_si", "white_noise_si", "bias_instability_si", "random_walk_si")
    return [
        {"sensor": one.sensor, "unit": one.unit, "tau_s": float(tau), **dict(zip(names, map(float, row), strict=True))}
        for one in diagnostics.allan
        for tau, *row in zip(one.tau, one.stream, one.card, one.white, one.instability, one.walk, strict=True)
    ]


def _protection(prepared: Prepared, diagnostics: CaseDiagnostics) -> Rows:
    """Return the protection levels by time, quantity and axis; 3d: the length of the box of the three axes."""
    one, rows = diagnostics.protected, list[dict[str, Any]]()
    if one is None:
        return rows
    axes = [output.axis for output in prepared.outputs if output.quantity == "position"]
    for quantity, (name, unit) in enumerate(PROTECTED.items()):
        named = np.array([*one.satellites, ""])[one.worst[:, quantity].astype(int)]
        sizes = [
            np.hstack([part[:, quantity], np.linalg.norm(part[:, quantity], axis=1)[:, None]])
            for part in (one.level, one.fault_free, one.sigma)
        ]
        for axis, label in enumerate((*axes, "3d")):
            rows += [
                {
                    "t_s": float(t),
                    "quantity": name,
                    "axis": label,
                    "unit": unit,
                    "level_si": float(level),
                    "fault_free_si": float(free),
                    "sigma_si": float(sigma),
                    "satellite": str(worst),
                }
                for t, level, free, sigma, worst in zip(one.t, *(size[:, axis] for size in sizes), named, strict=True)
            ]
    return rows


def _error_bound(diagnostics: CaseDiagnostics) -> Rows:
    bound = diagnostics.bound
    if bound is None:
        return []
    ranks = {"rank_count": bound.rank, "state_count": bound.states, "weakest_direction": diagnostics.unbounded}
    matrices = [("Q", "initial sigma^2", bound.low, bound.high), *(("R", *row) for row in bound.rows)]
    return [
        {"matrix": matrix, "unit": unit, "lower_bound_si": low, "upper_bound_si": high, **ranks}
        for matrix, unit, low, high in matrices
    ]
