"""A launch of our own for tests of the closed loop: a body whose numbers do not change, so that closed forms hold."""

from __future__ import annotations

from typing import Any

import numpy as np
from ruamel.yaml import YAML

from lvnav_trade.campaign.syntax.cards import shipped
from lvnav_trade.envelope import EnvelopeCard
from lvnav_trade.world.control.ascent import Body
from lvnav_trade.world.control.loop import BURN, COAST
from lvnav_trade.world.control.missions import Launch
from lvnav_trade.world.control_cards import ControllerCard, RotationCard, WindCard
from lvnav_trade.world.sensors.imu import ImuCard

EFFECTIVENESS = 10.0  # 1/s^2


def settings(name: str) -> dict[str, Any]:
    """Return the fields of a card that comes with the tool, with those of the spreads that a vehicle names."""
    found: dict[str, Any] = YAML(typ="safe").load((shipped("configs") / f"{name}.yaml").read_text())
    if "dispersions" in found:
        found["dispersions"] = settings(found["dispersions"])
    return found


def design(frequency: float, damping: float, instability: float = 0.0) -> dict[str, Any]:
    """Return the gains that give a rigid body with an ideal nozzle a natural frequency (rad/s) and a damping ratio.

    The body obeys angle'' = instability x angle - EFFECTIVENESS x nozzle (both 1/s^2).
    """
    attitude, rate = (frequency**2 + instability) / EFFECTIVENESS, 2.0 * damping * frequency / EFFECTIVENESS
    return {"attitude": attitude, "rate": f"{rate} s"}


def steady_launch(duration: float = 20.0, motor: int = 1, gains: Any = None, nozzle: Any = None, **body: Any) -> Launch:
    """Return a launch whose body is the same at all ticks; fields of `Body` are given as numbers or arrays."""
    rotation, controller = settings("rotation/three_motor"), settings("controllers/three_motor")
    rotation["nozzle"] |= {"misalignment": "0 deg"} | (nozzle or {})
    controller |= {"guidance": None} | ({"gains": [gains] * 3} if gains else {})
    t = np.arange(round(duration * 200.0) + 1) / 200.0
    numbers: dict[str, Any] = {
        "effectiveness": EFFECTIVENESS if motor else 0.0, "thrust_load": 30.0 if motor else 0.0, "moment": 0.0,
        "force": 0.0, "airspeed": 500.0, "slip": (0.0, 0.0), "wind": ((0.0, 0.0), (0.0, 0.0)), "gust": 0.0,
        "gust_rate": 1.0, "thruster": 0.002, "rate": (0.0, 0.0), "turn": (0.0, 0.0), "turn_rate": (0.0, 0.0),
    } | body  # fmt: skip
    arrays = {
        name: value if isinstance(value, np.ndarray) else np.broadcast_to(np.array(value, dtype=float),
                                                                         (t.size, *np.shape(value))).copy()
        for name, value in numbers.items()
    }  # fmt: skip
    number = np.full(t.size, motor, dtype=np.int64)
    return Launch(
        Body(t=t, motor=number, stack=np.maximum(number, 1), **arrays),
        np.full(t.size, BURN if motor else COAST, dtype=np.int64),
        RotationCard.model_validate(rotation),
        ControllerCard.model_validate(controller),
        WindCard.model_validate(settings("wind/moderate") | {"spread": "0 %"}),
        ImuCard.model_validate(settings("imu/kvh1750_003")),
        EnvelopeCard(),
    )
