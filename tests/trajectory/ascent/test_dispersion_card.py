"""Spreads of a vehicle, and what a mission asks of them: what cannot be is refused in a line."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from lvnav_trade.trajectory.ascent.dispersion_card import SOURCES, Dispersion, DispersionsCard
from lvnav_trade.trajectory.flight import identity
from tests.trajectory.flight_cases import CONFIGS, ascent_card, ascent_settings, launcher_settings


def test_every_shipped_vehicle_has_all_spreads_and_says_that_they_are_assumed():
    names = [path.stem for path in sorted((CONFIGS / "vehicles").glob("*.yaml"))]
    assert len(names) == 6
    settings = {
        launcher_settings(name)["vehicle"]["name"]: launcher_settings(name)
        for name in ("two_stage_leo", "electron_leo", "churchill_sso", "pslv_polar", "pslv_sub_gto", "vega_polar")
    }
    assert set(settings) == set(names)
    for one in settings.values():
        spreads = DispersionsCard.model_validate(one["vehicle"]["dispersions"])
        marked = {path for path, _ in spreads.assumed}
        assert all(getattr(spreads, name) > 0.0 for name in SOURCES)
        assert {*SOURCES, "wind_length"} == marked


@pytest.mark.parametrize(("changes", "message"), [
    ({"dispersion": {"draw": "all"}}, "need guidance"),
    ({"dispersion": {"sigmas": {"thrust": 1.0}}}, "need guidance"),
    ({"cutoff": "time"}, "cutoff: has no effect without guidance"),
    ({"attitude_lag": "0.5 s"}, "attitude_lag: has no effect without guidance"),
    ({"guidance": "explicit", "attitude_lag": "1 ms"}, "greater than or equal to 0.01"),
    ({"guidance": "explicit", "dispersion": {"pitch_program": "0.1 deg"}}, "pitch_program"),
    ({"guidance": "explicit", "dispersion": {"sigmas": {"thrust": 7.0}}}, "beyond six sigma"),
    ({"guidance": "explicit", "parking": {"perigee": "200 km"},
      "target": {"perigee": "350 km", "apogee": "600 km", "inclination": "45 deg"}}, "with a parking orbit"),
    ({"guidance": "explicit", "dispersion": {}}, "changes nothing"),
])  # fmt: skip
def test_what_has_no_meaning_is_refused(changes, message):
    with pytest.raises(ValidationError, match=message):
        ascent_card(**changes)


def test_spreads_that_the_vehicle_lacks_are_refused():
    settings = ascent_settings()
    settings["vehicle"] = {name: one for name, one in settings["vehicle"].items() if name != "dispersions"}
    with pytest.raises(ValidationError, match="which the vehicle does not have"):
        ascent_card(vehicle=settings["vehicle"], guidance="explicit", dispersion={"draw": "all"})
    bare = {**settings["vehicle"], "dispersions": {"name": "bare", "source": "test", "thrust": "1 %"}}
    with pytest.raises(ValidationError, match="names wind, whose spread"):
        ascent_card(vehicle=bare, guidance="explicit", dispersion={"draw": ["wind"]})


def test_all_are_drawn_or_those_that_are_named():
    assert Dispersion(draw="all").drawn_sources == SOURCES
    assert Dispersion(draw=("wind",)).drawn_sources == ("wind",)
    assert Dispersion(thrust=1.01).drawn_sources == ()


def test_a_wind_length_without_wind_is_refused():
    with pytest.raises(ValidationError, match="wind_length"):
        DispersionsCard(name="x", source="y", wind_length="3 km")


def test_guided_runs_fly_along_the_same_nominal_flight():
    assert identity(ascent_card(guidance="explicit", dispersion={"draw": "all"})) == identity(ascent_card())
    assert identity(ascent_card(dispersion={"thrust": 1.01})) != identity(ascent_card())
