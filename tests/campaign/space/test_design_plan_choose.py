"""Which designs are analysed whole."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from lvnav_trade.campaign.definition.run_counts import MonteCarlo
from lvnav_trade.campaign.space.design_plan import AT_RANDOM, front_rows, nearest_rows, select_designs

N = 60


def table(**columns: object) -> pa.Table:
    rng = np.random.default_rng(2)
    found = {
        "case": [f"{k:x}" for k in range(N)],
        "design_number": np.arange(100, 100 + N),
        "error_ratio": np.exp(rng.normal(0.0, 1.0, N)),
        "cost": rng.integers(1, 6, N).astype(float),
    }
    return pa.table(found | columns)


def test_the_best_some_at_random_and_those_nearest_to_a_limit(campaign) -> None:
    card = MonteCarlo(runs=40, most_cases=3)
    found = select_designs(table(), campaign.model_copy(update={"monte_carlo": card}))
    ratio = table()["error_ratio"].to_numpy()
    assert found["best"] == [100 + int(np.argmin(ratio))]
    assert len(found["at random"]) == AT_RANDOM
    by_nearness = np.argsort(np.abs(np.log(ratio)))
    assert found["undecided"] == (100 + by_nearness[:3]).tolist()


def test_without_spot_check_and_runs_the_best_one_alone(campaign) -> None:
    covariance = campaign.covariance.model_copy(update={"spot_check": 0})
    assert set(select_designs(table(), campaign.model_copy(update={"covariance": covariance}))) == {"best"}


def test_the_draw_is_that_of_the_seed(campaign) -> None:
    one, again = (select_designs(table(), campaign)["at random"] for _ in range(2))
    other = select_designs(table(), campaign.model_copy(update={"seed": 99}))["at random"]
    assert one == again != other


def test_no_design_on_the_front_is_dominated_and_every_other_is() -> None:
    found = table()
    rows = front_rows(found, np.arange(N))
    values = np.stack([found["error_ratio"].to_numpy(), found["cost"].to_numpy()], axis=1)

    def dominated(k: int) -> bool:
        return any((one <= values[k]).all() and (one < values[k]).any() for one in values)

    assert sorted(rows) == [k for k in range(N) if not dominated(k)]


def test_impossible_designs_and_those_without_numbers_are_never_chosen(campaign) -> None:
    ratio = np.full(N, np.nan)
    ratio[:5] = [0.0, 0.5, 1.1, 3.0, 0.9]
    case = ["", *(f"{k:x}" for k in range(1, N))]
    found = table(error_ratio=ratio, case=case)
    assert list(nearest_rows(np.arange(1, N), ratio)) == [2, 4, 1, 3]
    assert 100 not in [number for group in select_designs(found, campaign).values() for number in group]
    assert select_designs(found, campaign)["best"] == [101]
