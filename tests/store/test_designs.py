"""The table of many designs from its parts."""

from __future__ import annotations

import numpy as np

from lvnav_trade.campaign.space.evaluate import TEXTS, Rows
from lvnav_trade.store.designs import impossible, table_of


def part(numbers: list[int], **columns: list[float]) -> Rows:
    texts = {name: tuple(f"{name}{n}" for n in numbers) for name in TEXTS}
    return Rows(np.array(numbers), texts, {name: np.array(values) for name, values in columns.items()}, 1, 0.0, 0.0)


def test_rows_come_in_the_order_of_their_numbers_and_a_missing_column_is_empty() -> None:
    table = table_of([part([4, 0], a_m=[4.0, 0.0]), part([2], b_ratio=[7.0])])
    assert table["design_number"].to_pylist() == [0, 2, 4]
    assert table["case"].to_pylist() == ["case0", "case2", "case4"]
    np.testing.assert_array_equal(table["a_m"].to_numpy(), [0.0, np.nan, 4.0])
    np.testing.assert_array_equal(table["b_ratio"].to_numpy(), [np.nan, 7.0, np.nan])


def test_impossible_designs_are_counted_by_reason_the_most_frequent_first() -> None:
    rows = part([0, 1, 2, 3])
    rows.texts["case"] = ("", "x", "", "")  # type: ignore[index]
    rows.texts["reason"] = ("seldom", "remark", "often", "often")  # type: ignore[index]
    assert list(impossible(table_of([rows])).items()) == [("often", 2), ("seldom", 1)]
