"""What the modules of sensors state of their evidence, as entries of the report's list."""

from __future__ import annotations

from lvnav_trade.campaign.definition.metric_names import sensor_entries
from lvnav_trade.sensors.family import SENSORS, card_kind

ENTRIES = sensor_entries()


def test_an_entry_is_used_where_a_sensor_is_there_and_the_filter_takes_it():
    radar = next(entry for entry in ENTRIES if entry["name"] == "Radar altimeter")
    assert radar["used"] == [{"sensors.*.kind": "altimeter", "filter.measurements": "altitude"}]
    assert {check["by"] for check in radar["checks"]} == {"closed form", "both engines"}
    assert "Terrain" in radar["omits"]


def test_sensors_that_share_their_evidence_are_one_entry():
    both = next(entry for entry in ENTRIES if entry["name"] == "Difference of two inertial units")
    assert [one["sensors.*.kind"] for one in both["used"]] == ["angle_difference", "velocity_difference"]
    used = [one["sensors.*.kind"] for entry in ENTRIES for one in entry["used"]]
    assert used == [card_kind(card) for card in SENSORS]
