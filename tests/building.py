"""Scenarios for tests: the shipped ascent, and short flights of our own whose truth is known to the formula.

A short flight stands in for what `prepare` builds from a trajectory card (see `flying`); the rest is the tool itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from ruamel.yaml import YAML
from scipy.integrate import solve_ivp

from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.syntax.card_lookup import campaign_file
from lvnav_trade.filter.assumed import ReceiverModel
from lvnav_trade.kernels.earth import gravity_j4
from lvnav_trade.quantities.frames import quaternions
from lvnav_trade.scenario.filter_models import filter_models
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.sensors.family import SENSORS, card_kind
from lvnav_trade.simulation.preparation import true_flight as room
from lvnav_trade.simulation.preparation.prepare import PreparedCase, prepare
from lvnav_trade.trajectory.flight import Phase, Trajectory, reference
from lvnav_trade.trajectory.truth import attitude_spline, position_spline

Floats = NDArray[np.float64]
ROOT = Path(__file__).parents[1]

SITE_R = np.array([4.05e6, -3.10e6, -4.12e6])  # m, frame i: 200 km above 39 S
SITE_V = np.array([2900.0, 3300.0, 700.0])  # m/s, frame i


def loaded(*settings: str) -> Scenario:
    """Return the scenario of the smoke campaign with settings such as ``base.filter=filters/loose``."""
    campaign = load(campaign_file("campaigns/smoke.yaml"), settings)
    return campaign.base


@lru_cache(maxsize=1)
def shipped_sensors() -> dict[str, str]:
    """Return a shipped card of every kind of sensor that has one, the first of its folder, as a campaign names it."""
    configs, kinds = ROOT / "configs", {card_kind(card) for card in SENSORS}
    read = {path: YAML(typ="safe").load(path) for path in sorted(configs.rglob("*.yaml"), reverse=True)}
    named = {card["kind"]: path for path, card in read.items() if card.get("kind") in kinds}
    return {kind: str(path.relative_to(configs).with_suffix("")) for kind, path in sorted(named.items())}


def with_fields(card: Any, **fields: Any) -> Any:
    """Return a card with fields replaced, read anew from its text, so that units and rules are checked.

    A name with dots reaches into cards within: ``{"gyro.scale_factor": "300 ppm"}`` is passed by ``**{...}``.
    """
    text = card.model_dump(mode="json")
    for name, value in fields.items():
        *way, last = name.split(".")
        at = text
        for key in way:
            at = at[key]
        at[last] = value
    return type(card).model_validate(text)


def assumed_receiver(scenario: Scenario, **numbers: float) -> ReceiverModel:
    """Return what the filter of a scenario assumes of the receiver, each number at hand, some of them replaced."""
    _, model, _ = filter_models(scenario)
    own = {name: getattr(model, name) for name in ReceiverModel.model_fields}
    return ReceiverModel.model_construct(**own | numbers)


def with_units(scenario: Scenario, units: list[dict[str, Any]], **fields: Any) -> Scenario:
    """Return a scenario whose inertial unit is several: each its own but for the fields given."""
    text = scenario.model_dump(mode="json")
    found = []
    for over in units:
        unit = {**text["imu"], **over}
        for sensor in ("gyro", "accel"):
            unit[sensor] = {**text["imu"][sensor], **over.get(sensor, {})}
        found.append(unit)
    text["imu"] = {"units": found, **fields}
    return Scenario.model_validate(text)


def with_difference(scenario: Scenario, units: list[dict[str, Any]], *beside: str) -> Scenario:
    """Return the scenario of several units, whose filter takes the difference of the first two, and more."""
    text = with_units(scenario, units).model_dump(mode="json")
    kinds = ("angle_difference", "velocity_difference")
    text["sensors"] = {kind: {"kind": kind} for kind in kinds}
    text["filter"]["measurements"] = [*beside, *kinds]
    return type(scenario).model_validate(text)


def fly(
    force: Callable[[float], Floats], t: Floats, r: Floats = SITE_R, v: Floats = SITE_V
) -> tuple[Floats, Floats, Floats]:
    """Integrate a specific force (m/s^2, frame i) and gravitation over times t (n,); return r, v, a at them, (n, 3)."""

    def slope(time: float, state: Floats) -> Floats:
        return np.concatenate([state[3:], force(time) + np.array(gravity_j4(*state[:3]))])

    found = solve_ivp(slope, (t[0], t[-1]), np.concatenate([r, v]), "DOP853", t, rtol=1e-13, atol=1e-9)
    state = found.y.T
    return state[:, :3], state[:, 3:], np.array([slope(time, s)[3:] for time, s in zip(t, state, strict=True)])


def flight(
    forces: list[tuple[float, Callable[[float], Floats]]],
    attitude: Callable[[Floats], Floats],
    start: float = 0.0,
    **site: Floats,
) -> Trajectory:
    """Return a trajectory of phases, each of a duration (s) and a specific force (frame i).

    attitude: quaternions (n, 4) at times (n,). Truth is the splines through the integrated motion, as everywhere.
    """
    phases, events = [], {"liftoff": start}
    where: dict[str, Floats] = dict(site)
    for number, (duration, force) in enumerate(forces):
        t = start + np.linspace(0.0, duration, max(8, round(4 * duration)) + 1)
        r, v, a = fly(force, t, **where)
        position = position_spline(t, r, v[[0, -1]], a[[0, -1]])
        phases.append(Phase(f"phase{number}", t[0], t[-1], position, attitude_spline(t, attitude(t))))
        start, where = t[-1], {"r": r[-1], "v": v[-1]}
        events[f"end{number}"] = start
    return Trajectory(tuple(phases), events, 0.3, "2024-03-20T12:00:00Z")


def turning(t: Floats) -> Floats:
    """Quaternions of a body that pitches by 1 deg/s and rolls by 4 deg/s, its x axis near the velocity."""
    x = SITE_V / np.linalg.norm(SITE_V)
    z = np.cross(x, SITE_R)
    z /= np.linalg.norm(z)
    y = np.cross(z, x)
    pitch, roll = np.radians(1.0) * t, np.radians(4.0) * t
    nose = np.cos(pitch)[:, None] * x + np.sin(pitch)[:, None] * y
    side = np.cos(pitch)[:, None] * y - np.sin(pitch)[:, None] * x
    c, s = np.cos(roll)[:, None], np.sin(roll)[:, None]
    return quaternions(np.stack([nose, c * side + s * z, c * z - s * side], axis=-1))


@lru_cache(maxsize=4)
def hop(boost: float = 20.0, coast: float = 10.0, push: float = 30.0) -> Trajectory:
    """Return a short flight: a boost along the velocity, then a coast, pitching and rolling all along."""
    along = push * SITE_V / np.linalg.norm(SITE_V)
    return flight([(boost, lambda t: along), (coast, lambda t: np.zeros(3))], turning)


@contextmanager
def flying(trajectory: Trajectory) -> Iterator[None]:
    """Let every scenario that is prepared here fly this trajectory, whatever its card says."""
    with (
        patch.object(room, "cached_trajectory", lambda *card: trajectory),
        patch.object(room, "cached_reference", lambda *card: reference(trajectory, card[-1])),
    ):
        yield


def prepare_hop(scenario: Scenario, trajectory: Trajectory | None = None, **how: Any) -> PreparedCase:
    """Prepare a scenario on the short flight (or another trajectory)."""
    with flying(trajectory or hop()):
        return prepare(scenario, **how)


IDEAL = ("base.imu.gyro.bandwidth=null", "base.imu.accel.bandwidth=null")
TURNED = {"orientation": ["20 deg", "-35 deg", "110 deg"]}
UNLIKE = {
    "gyro": {"bias_repeatability": "0.05 deg/h", "random_walk": "0.01 deg/sqrt(h)", "scale_factor": "10 ppm"},
    "accel": {"bias_repeatability": "1 mg", "random_walk": "0.1 mg/sqrt(Hz)", "misalignment": "0.2 mrad"},
    "lever_arm": ["-0.4 m", "0.2 m", "0 m"], **TURNED,
}  # fmt: skip
MATCHED = "base.imu=imu/tactical_fog_matched"
LOOSE, INERTIAL = "base.filter=filters/loose", "base.filter=filters/inertial"


@lru_cache(maxsize=32)
def case(*settings: str) -> PreparedCase:
    """Return the short flight, prepared, of the smoke campaign's scenario with settings."""
    return prepare_hop(loaded(*settings))


@lru_cache(maxsize=8)
def ascent(*settings: str) -> PreparedCase:
    """Return the shipped ascent, prepared, of the smoke campaign's scenario with settings."""
    return prepare(loaded(*settings))
