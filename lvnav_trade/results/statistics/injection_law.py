"""Distribution of the injection of a guided ascent by linear covariance, from the tables of results."""

import numpy as np

from lvnav_trade.quantities.records import INJECTION, ORBIT, InjectionLaw
from lvnav_trade.results.tables.lookup import once, pick
from lvnav_trade.results.tables.read import Tables

_N = len(INJECTION)


def law_in(tables: Tables, case: str) -> InjectionLaw | None:
    """Return the distribution of the injection of a case by linear covariance; None without guidance.

    Results contain only the sums over all sources of knowledge and execution errors. They are assigned to the first
    source.
    """
    law: InjectionLaw | None = _law_in(tables, case)[0]
    return law


@once
def _law_in(tables: Tables, case: str) -> list[InjectionLaw | None]:
    return [_read(tables, case)]


def _read(tables: Tables, case: str) -> InjectionLaw | None:
    numbers = pick(tables.injection_expected, case=case)
    if numbers.empty:
        return None
    if str(numbers.why.iloc[0]):
        return InjectionLaw(str(numbers.why.iloc[0]))
    reference, target, mean, second_order, knowledge, execution = (
        numbers[f"{name}_si"].to_numpy(dtype=float)
        for name in ("reference", "target", "mean", "second_order", "knowledge", "execution")
    )
    rows = pick(tables.injection_joint, case=case)
    sources = list(dict.fromkeys(rows.source))
    covariance = np.zeros((len(sources), _N, _N))
    source = rows.source.map({name: k for k, name in enumerate(sources)}).to_numpy(dtype=int)
    place = {name: k for k, name in enumerate(INJECTION)}
    i, j = (rows[name].map(place).to_numpy(dtype=int) for name in ("quantity", "other_quantity"))
    covariance[source, i, j] = covariance[source, j, i] = rows.covariance_si2.to_numpy(dtype=float)
    of_sources = np.zeros((2, len(sources), len(ORBIT)))
    of_sources[:, 0] = np.square([knowledge[: len(ORBIT)], execution[: len(ORBIT)]])
    of_navigation = set(rows.source[rows.part == "navigation"])
    return InjectionLaw(
        reference=reference,
        target=target[: len(ORBIT)],
        mean=mean,
        second_order=second_order,
        sources=tuple(map(str, sources)),
        n_navigation=len(of_navigation),
        covariance=covariance,
        knowledge=of_sources[0],
        execution=of_sources[1],
    )
