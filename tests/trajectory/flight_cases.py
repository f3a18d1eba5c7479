"""The shipped flights, built once for all tests of this folder."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from lvnav_trade.trajectory.ascent.profile import RecordedAscent
from lvnav_trade.trajectory.ascent.vehicle_cards import VehicleAscent
from lvnav_trade.trajectory.flight import Trajectory, build
from lvnav_trade.trajectory.flights.orbital import OrbitalFlight
from lvnav_trade.trajectory.flights.sounding import SoundingFlight

CONFIGS = Path(__file__).resolve().parents[2] / "configs"


def _load(name: str) -> dict[str, Any]:
    return YAML(typ="safe").load((CONFIGS / f"{name}.yaml").read_text())


def _load_vehicle(name: str) -> dict[str, Any]:
    """Settings of a vehicle, its spreads filled in."""
    vehicle = _load(name)
    return {**vehicle, "dispersions": _load(vehicle["dispersions"])}


def ascent_settings() -> dict[str, Any]:
    """Settings of the two-stage ascent, its vehicle filled in."""
    settings = _load("trajectories/two_stage_leo")
    settings["vehicle"] = _load_vehicle(settings["vehicle"])
    return settings


def record_settings() -> dict[str, Any]:
    """Settings of the recorded ascent, its file made absolute."""
    settings = _load("trajectories/falcon9_formosat5")
    settings["file"] = str(CONFIGS / "trajectories" / settings["file"])
    return settings


def ascent_card(**changes: Any) -> VehicleAscent:
    """The two-stage ascent, some settings changed."""
    return VehicleAscent.model_validate({**ascent_settings(), **changes})


def record_card(**changes: Any) -> RecordedAscent:
    """The recorded ascent, some settings changed."""
    return RecordedAscent.model_validate({**record_settings(), **changes})


@cache
def ascent() -> Trajectory:
    """The two-stage ascent."""
    return build(ascent_card())


@cache
def recorded() -> Trajectory:
    """The recorded ascent."""
    return build(record_card())


def launcher_settings(name: str) -> dict[str, Any]:
    """Settings of a shipped ascent, its vehicle filled in, its record made absolute."""
    settings = _load(f"trajectories/{name}")
    settings["vehicle"] = _load_vehicle(settings["vehicle"])
    recorded = settings.get("recorded", {})
    if "file" in recorded:
        recorded["file"] = str(CONFIGS / "trajectories" / recorded["file"])
    return settings


@cache
def launch(name: str) -> Trajectory:
    """A shipped ascent."""
    return build(VehicleAscent.model_validate(launcher_settings(name)))


def sounding_settings(**changes: Any) -> dict[str, Any]:
    """Settings of the sounding rocket, without its oscillations, some changed."""
    return {**_load("trajectories/shefex2_class"), "oscillation": [], **changes}


@cache
def sounding() -> Trajectory:
    """The sounding rocket, without its oscillations."""
    return build(SoundingFlight.model_validate(sounding_settings()))


def orbital_settings(**changes: Any) -> dict[str, Any]:
    """Settings of the recovery from orbit, some changed."""
    return {**_load("trajectories/recovery_polar"), **changes}


@cache
def recovery() -> Trajectory:
    """The recovery from orbit."""
    return build(OrbitalFlight.model_validate(orbital_settings()))
