"""How a metric moves with one source's sigma: with gains frozen, and honestly, with the filter re-tuned."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.engines.lincov.history import covariance
from lvnav_trade.engines.prepare import prepare
from lvnav_trade.records import CovHistory, Floats
from lvnav_trade.scenario import Scenario

FACTORS = (0.1, 0.3, 1.0, 3.0, 10.0)

# Where the sigma of each source stands in a scenario; the power is that of the field in the source's sigma.
_SENSORS = {"gyro": "gyro", "accelerometer": "accel"}
_ROWS = {
    "random walk": "random_walk",
    "bias repeatability": "bias_repeatability",
    "bias instability": "bias_instability",
    "rate random walk": "rate_random_walk",
    "scale factor": "scale_factor",
    "scale-factor drift": "scale_factor_drift",
    "misalignment": "misalignment",
    "nonlinearity": "nonlinearity",
    "g-sensitivity": "g_sensitivity",
    "quantisation": "quantisation",
}
_FIELDS: dict[str, tuple[tuple[tuple[str, ...], int], ...]] = {
    "initial attitude": ((("initial", "tilt"), 1), (("initial", "heading"), 1)),
    "initial velocity": ((("initial", "velocity"), 1),),
    "initial position": ((("initial", "position"), 1),),
    "receiver clock start": (
        (("receiver", "clock", "initial_bias"), 1),
        (("receiver", "clock", "initial_drift"), 1),
    ),
    # h0 and h-2 are variances
    "receiver clock": ((("receiver", "clock", "h0"), 2), (("receiver", "clock", "h_minus2"), 2)),
    "pseudorange noise": ((("receiver", "pseudorange_sigma"), 1),),
    "range-rate noise": ((("receiver", "range_rate_sigma"), 1),),
    "position solution noise": ((("receiver", "solution", "position_sigma"), 1),),
    "velocity solution noise": ((("receiver", "solution", "velocity_sigma"), 1),),
} | {
    f"{label} {row}": ((("imu", sensor, field), 1),)
    for label, sensor in _SENSORS.items()
    for row, field in _ROWS.items()
    if (label, row) != ("accelerometer", "g-sensitivity")
}


class Sensitivity(NamedTuple):
    """How the norm of a quantity's true error at one time moves with each source's sigma.

    time s; quantity; sources (n_source,) names; factors (n_factor,); frozen, retuned (n_source, n_factor) true
    root-mean-square of the norm, SI: with the gains of the campaign's filter, and with a filter that knows the new
    sigma.
    """

    time: float
    quantity: str
    sources: tuple[str, ...]
    factors: tuple[float, ...]
    frozen: Floats
    retuned: Floats


def _multiplied(model: Any, path: tuple[str, ...], factor: float) -> Any:
    head, rest = path[0], path[1:]
    value = getattr(model, head)
    return model.model_copy(update={head: _multiplied(value, rest, factor) if rest else value * factor})


def scaled(scenario: Scenario, source: str, factor: float) -> Scenario:
    """Return the scenario with the sigma of one named source multiplied; a filter that is `matched` follows."""
    for path, power in _FIELDS[source]:
        scenario = _multiplied(scenario, path, factor**power)
    return scenario


def _norm(history: CovHistory, hist: int, columns: list[int]) -> float:
    return float(np.sqrt(np.sum(history.true_sigma[hist, columns] ** 2 + history.mean[hist, columns] ** 2)))


def _again(scenario: Scenario, source: str, factor: float, known: dict[tuple[str, float], CovHistory]) -> CovHistory:
    if (source, factor) not in known:
        known[source, factor] = covariance(prepare(scaled(scenario, source, factor)))
    return known[source, factor]


def sensitivity(
    scenario: Scenario,
    history: CovHistory,
    time: float,
    quantity: str,
    columns: list[int],
    share: float = 0.01,
    known: dict[tuple[str, float], CovHistory] | None = None,
) -> Sensitivity:
    """Return the frozen and the re-tuned metric for every source that makes up at least `share` of its variance.

    Parameters
    ----------
    history
        Linear covariance of the scenario as it is.
    time
        s since lift-off, a history time.
    quantity, columns
        Name of a three-axis quantity and the columns that hold it.
    known
        Linear covariances by (source, factor), found and added to: the next quantity asks for the same.
    """
    known = {} if known is None else known
    hist = int(np.argmin(np.abs(history.t - time)))
    by_source = history.budget[hist][:, columns].sum(axis=1)
    total = by_source.sum() + np.sum(history.mean[hist, columns] ** 2)
    chosen = [k for k in np.argsort(-by_source) if by_source[k] >= share * by_source.sum()]
    factors = np.array(FACTORS)
    frozen = np.sqrt(total + (factors**2 - 1.0) * by_source[chosen][:, None])
    retuned = np.empty_like(frozen)
    for row, k in enumerate(chosen):
        for column, factor in enumerate(FACTORS):
            again = history if factor == 1.0 else _again(scenario, history.sources[k], factor, known)
            retuned[row, column] = _norm(again, int(np.argmin(np.abs(again.t - time))), columns)
    return Sensitivity(
        float(history.t[hist]), quantity, tuple(history.sources[k] for k in chosen), FACTORS, frozen, retuned
    )
