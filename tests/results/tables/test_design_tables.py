"""The table of many designs from its parts."""

from __future__ import annotations

import numpy as np
import pyarrow.parquet as pq

from lvnav_trade.campaign.space.evaluate_designs import TEXTS, EvaluatedDesigns
from lvnav_trade.results.tables.design_tables import earlier_table, impossible_design_counts, passes, table_of


def part(numbers: list[int], **columns: list[float]) -> EvaluatedDesigns:
    texts = {name: tuple(f"{name}{n}" for n in numbers) for name in TEXTS}
    return EvaluatedDesigns(
        np.array(numbers), texts, {name: np.array(values) for name, values in columns.items()}, 1, 0.0, 0.0
    )


def test_rows_come_in_the_order_of_their_numbers_and_a_missing_column_is_empty() -> None:
    table = table_of([part([4, 0], a_m=[4.0, 0.0]), part([2], b_ratio=[7.0])], "mine", 3)
    assert table["design_number"].to_pylist() == [0, 2, 4]
    assert table["case"].to_pylist() == ["case0", "case2", "case4"]
    np.testing.assert_array_equal(table["a_m"].to_numpy(), [0.0, np.nan, 4.0])
    np.testing.assert_array_equal(table["b_ratio"].to_numpy(), [np.nan, 7.0, np.nan])


def test_impossible_designs_are_counted_by_reason_the_most_frequent_first() -> None:
    rows = part([0, 1, 2, 3])
    rows.texts["case"] = ("", "x", "", "")  # type: ignore[index]
    rows.texts["reason"] = ("seldom", "remark", "often", "often")  # type: ignore[index]
    assert list(impossible_design_counts(table_of([rows], "mine", 4)).items()) == [("often", 2), ("seldom", 1)]


def test_a_table_is_kept_where_it_is_sound_and_of_the_same_question(tmp_path) -> None:
    file = tmp_path / "designs.parquet"
    assert earlier_table(file, "mine") is None
    table = table_of([part([0, 1], a_m=[1.0, 2.0])], "mine", 7)
    pq.write_table(table, file, write_page_checksum=True)
    found = earlier_table(file, "mine")
    assert found is not None
    assert found.equals(table)
    assert passes(found) == 7
    assert earlier_table(file, "another") is None
    content = file.read_bytes()
    file.write_bytes(content[: len(content) // 2])
    assert earlier_table(file, "mine") is None
