"""Consistency of the innovations of some runs: mean square, and rejections by the gate."""

import math

import numpy as np
from scipy import stats

from lvnav_trade.covariance.selfcheck.check import CheckResult
from lvnav_trade.kernels.vehicle import N_SAMPLE
from lvnav_trade.quantities.records import CovHistory, Floats
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.preparation.prepare import PreparedCase

RUNS = 32
KIND = "innovations"
MAX_REJECTION = 0.01
"""Probability of rejecting a valid measurement above which linear covariance does not describe the filter."""


def innovations(prepared_case: PreparedCase, history: CovHistory, seed: int) -> list[CheckResult]:
    """Return checks of the mean square of normalised innovations, and of their number beyond the gate.

    For a filter that models the whole truth the mean square is 1 per scalar (chi-square). For any other filter linear
    covariance gives the expected mean square. The runs are the first of the campaign. Bounds follow from the scatter of
    the runs, so they are also valid for innovations that are correlated within a run.

    Parameters
    ----------
    prepared_case
        Prepared case.
    history
        Linear covariance of the case.
    seed
        Seed of the campaign.
    """
    reason = _obstacle(prepared_case, history)
    if reason:
        return [CheckResult(KIND, "mean square", reason=reason)]
    block = run_block(prepared_case, seed, 0, RUNS)
    n_sample = 0 if prepared_case.options.vehicle is None else N_SAMPLE
    n_scalar = prepared_case.channels.n_channel + n_sample
    completed_innovations = block.innovation[block.failed == 0]
    z = completed_innovations[:, :, :n_scalar]
    n_run = len(z)
    if n_run < RUNS // 2:
        return [CheckResult(KIND, "mean square", remark=f"{RUNS - n_run} of {RUNS} runs failed")]
    count = np.isfinite(z).sum(axis=(1, 2))
    expected_square = float(history.expected_nis.sum() / history.n_row.sum())
    square = np.nansum(z**2, axis=(1, 2)) / count
    remark = f"{int(count.mean())} scalars a run, {n_run} runs; expected {expected_square:.3f}"
    min_sigma = expected_square * math.sqrt(2.0 / count.sum())
    law = _law(square, expected_square, min_sigma)
    mean_square = float(square.mean())
    return [
        CheckResult(KIND, "mean square", mean_square, remark=remark, distribution=law),
        *_gate(prepared_case, history, z, count),
    ]


def _gate(prepared_case: PreparedCase, history: CovHistory, z: Floats, count: Floats) -> list[CheckResult]:
    """Return the check of the number of innovations beyond the gate against the expected number; empty without a gate.

    Parameters
    ----------
    prepared_case
        Prepared case.
    history
        Linear covariance of the case.
    z
        (n_run, n_epoch, n_scalar). Normalised innovations; NaN without a measurement.
    count
        (n_run,). Number of innovations of each run.
    """
    gate_squared = prepared_case.model.gate_squared
    gate = math.sqrt(gate_squared)
    if math.isinf(gate):
        return []
    has_rows = history.n_row > 0
    n_row = history.n_row[has_rows]
    ratio = history.expected_nis[has_rows] / n_row
    chance = stats.chi2.sf(gate_squared / ratio, 1)
    expected_rejections = np.sum(chance * n_row)
    probability = float(expected_rejections / history.n_row.sum())
    total = int(count.sum())
    expected_count = probability * total
    exceedance_count = (np.abs(z) > gate).sum(axis=(1, 2))
    remark = f"beyond {gate:g} sigma, of {total}; expected {expected_count:.3g}"
    # innovations that are correlated within a run scatter more than independent ones
    spread = float(exceedance_count.std(ddof=1)) * math.sqrt(len(z))
    poisson = math.sqrt(max(expected_count, 1e-300))
    law = stats.binom(total, probability)
    if spread > 1.5 * poisson and expected_count > 20.0:
        law = stats.norm(expected_count, spread)
    n_beyond = float(exceedance_count.sum())
    return [CheckResult(KIND, "refused by the gate", n_beyond, remark=remark, distribution=law)]


def _law(values: Floats, expected_mean: float, min_sigma: float) -> object:
    """Return the distribution of the mean of some values.

    Parameters
    ----------
    values
        (n_run,). Values by run.
    expected_mean
        Expected mean.
    min_sigma
        Smallest standard deviation of the mean.
    """
    n = len(values)
    sigma_of_mean = float(values.std(ddof=1)) / math.sqrt(n)
    sigma = max(min_sigma, sigma_of_mean)
    return stats.t(n - 1, expected_mean, sigma)


def _obstacle(prepared_case: PreparedCase, history: CovHistory) -> str:
    """Return the reason why linear covariance does not give the innovations of a case; empty if it does."""
    if not history.n_row.sum():
        return "the filter takes no measurement on this flight"
    if prepared_case.options.rules is not None:
        return "a mode logic decides run by run which measurements are used"
    if history.false_rejection.max(initial=0.0) > MAX_REJECTION:
        return "the gate rejects more than 1 % of good measurements, and linear covariance knows no gate"
    return ""
