"""Reference from Python: fields, schema, cards, metrics."""

from __future__ import annotations

import pytest

from lvnav_trade import api
from lvnav_trade.campaign.syntax import card_lookup as shelf
from lvnav_trade.campaign.syntax.card_lookup import CardInfo
from lvnav_trade.quantities.errors import InputError


def test_fields_at_a_path_have_type_default_and_meaning():
    (part,) = api.fields("monte_carlo")
    rows = {row.field: row for row in part.rows}
    assert rows["runs"].type
    with pytest.raises(InputError, match="did you mean 'monte_carlo'"):
        api.fields("monte_carl")


def test_the_schema_is_one_of_json():
    assert {"$defs", "properties"} <= set(api.schema())


def test_cards_are_listed_by_folder_and_read(monkeypatch):
    some = [CardInfo(name, "title", "source", f"{name}.yaml") for name in ("imu/a", "imu/b", "imus/c", "filters/d")]
    with monkeypatch.context() as patch:  # reading every card takes seconds
        patch.setattr(shelf, "catalogue", lambda _, prefix: [card for card in some if card.name.startswith(prefix)])
        assert [card.name for card in api.cards("imu")] == ["imu/a", "imu/b"]
        assert [card.name for card in api.cards("imus/")] == ["imus/c"]
        assert api.cards() == some
    assert "random_walk" in api.card_text("imu/tactical_fog")
    with pytest.raises(InputError, match=r"no folder 'imus' \(did you mean 'imu'"):
        api.cards("imus")


def test_metrics_have_units_and_tables_meanings():
    found = api.metrics("velocity_error")
    units = dict(zip(found.metrics.metric, found.metrics.unit, strict=True))
    assert units["velocity_error_3d"] == "m/s"
    assert "rms" in api.metrics().tables
    assert "velocity_error_3d" in found._repr_html_()
    with pytest.raises(InputError, match="no metric contains 'velocty_error'"):
        api.metrics("velocty_error")
