"""How a metric moves with one source's sigma: with gains frozen, and honestly, with the filter re-tuned."""

from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.engines.lincov.history import covariance
from lvnav_trade.engines.setup.prepare import prepare
from lvnav_trade.records import CovHistory, Floats
from lvnav_trade.scenario import Scenario, sensors_used
from lvnav_trade.sources import Field, fields_of

FACTORS = (0.1, 0.3, 1.0, 3.0, 10.0)


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
    """Return a card (or the cards of a mapping) with one number multiplied; of several parts that number in each."""
    head, rest = path[0], path[1:]
    if isinstance(model, dict):
        return model | {head: _multiplied(model[head], rest, factor)}
    if head not in type(model).model_fields and "parts" in type(model).model_fields:
        return model.model_copy(update={"parts": tuple(_multiplied(part, path, factor) for part in model.parts)})
    value = getattr(model, head, None)
    if value is None:
        return model
    return model.model_copy(update={head: _multiplied(value, rest, factor) if rest else value * factor})


def _fields(scenario: Scenario, source: str) -> tuple[Field, ...]:
    """Return the fields that hold the sigma of a source: of a sensor's noise those of its card."""
    used = sensors_used(scenario)
    alone = {name: [c.measurement for c in used.values()].count(card.measurement) == 1 for name, card in used.items()}
    for name, card in used.items():
        if source == (card.noise if alone[name] else f"{card.noise} {name}"):
            return tuple((("sensors", name, field), 1) for field in card.noise_fields)
        for error in card.lasting():
            if source == error.source:
                return ((("sensors", name, error.field), 1),)
    return fields_of(source)


def scaled(scenario: Scenario, source: str, factor: float) -> Scenario:
    """Return the scenario with the sigma of one named source multiplied; a filter that is `matched` follows."""
    for path, power in _fields(scenario, source):
        scenario = _multiplied(scenario, path, factor**power)
    return scenario


def _norm(history: CovHistory, hist: int, columns: list[int]) -> float:
    return float(np.sqrt(np.sum(history.true_sigma[hist, columns] ** 2 + history.mean[hist, columns] ** 2)))


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

    Sources whose sigma is no field of the scenario are left out.

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
    chosen = [k for k in np.argsort(-by_source)
              if by_source[k] >= share * by_source.sum() and _fields(scenario, history.sources[k])]  # fmt: skip
    factors = np.array(FACTORS)
    frozen = np.sqrt(total + (factors**2 - 1.0) * by_source[chosen][:, None])
    retuned = np.empty_like(frozen)
    for row, k in enumerate(chosen):
        for column, factor in enumerate(FACTORS):
            key = history.sources[k], factor
            if factor != 1.0 and key not in known:
                known[key] = covariance(prepare(scaled(scenario, *key)))
            again = history if factor == 1.0 else known[key]
            retuned[row, column] = _norm(again, int(np.argmin(np.abs(again.t - time))), columns)
    return Sensitivity(
        float(history.t[hist]), quantity, tuple(history.sources[k] for k in chosen), FACTORS, frozen, retuned
    )
