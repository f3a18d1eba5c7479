"""Every sensor with every state of its errors goes through linear covariance, runs, tables and the report."""

from __future__ import annotations

from pathlib import Path

import pytest

from lvnav_trade import api
from lvnav_trade.api import Results
from lvnav_trade.quantities.state_layout import EXTRAS, PARAMETERS
from lvnav_trade.results.tables.dictionary import SI_SUFFIX
from lvnav_trade.sensors.family import SENSOR_STATES, SENSORS, card_kind
from tests.building import shipped_sensors

MEMBERS = {card_kind(card): card for card in SENSORS}
"""Every sensor by its kind."""
CARDS = shipped_sensors()
"""A card of each kind that is shipped."""
BETWEEN_IMUS = {
    "angle_difference",
    "velocity_difference",
}  # these need two IMUs: tests/sensors/test_imu_difference.py
CAMPAIGN = """\
name: every
seed: 1
base:
  trajectory: trajectories/two_stage_leo
  imu: imu/tactical_fog
  constellation: constellations/gps_24
  receiver: receivers/l1_two_metre
  filter: {{card: filters/tight, measurements: [pseudorange, range_rate, {measurements}], extra_states: [{states}]}}
  initial: {{tilt: "0.1 deg", heading: "0.05 deg", position: "1 m", velocity: "0.01 m/s"}}
  sensors: {{{sensors}}}
monte_carlo: {{runs: 8}}
"""


def test_every_unit_of_a_state_has_a_column() -> None:
    units = {unit for unit, *_ in EXTRAS.values()} | {kind.unit for kind in PARAMETERS.values()}
    units |= {state.unit for state in SENSOR_STATES.values()} | {card.unit for card in SENSORS}
    assert {unit for unit in units for unit in unit.split(" or ")} <= {*SI_SUFFIX}


@pytest.mark.slow
def test_every_sensor_and_state_reaches_the_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert {*CARDS, *BETWEEN_IMUS} == {*MEMBERS}
    states = {state.name for kind in CARDS for state in MEMBERS[kind].model.states.values()}
    assert states == {*SENSOR_STATES}
    monkeypatch.chdir(tmp_path)
    text = CAMPAIGN.format(
        measurements=", ".join(MEMBERS[kind].measurement for kind in CARDS),
        states=", ".join(sorted(states)),
        sensors=", ".join(f"{kind}: {card}" for kind, card in CARDS.items()),
    )
    Path("every.yaml").write_text(text)
    folder = api.run("every.yaml").folder
    found = Results(folder)
    assert {*found.history.quantity} >= states
    assert not found.failures
    assert (folder / "report.html").stat().st_size > 100_000
