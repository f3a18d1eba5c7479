"""A body of our own for tests of the controlled attitude: its numbers do not change, so that closed forms hold."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from ruamel.yaml import YAML

from lvnav_trade.campaign.syntax.card_lookup import tool_folder
from lvnav_trade.imu.error_model import ImuCard
from lvnav_trade.kernels.jit import array_jit
from lvnav_trade.kernels.random import seed_words
from lvnav_trade.quantities.shared_cards import EnvelopeCard
from lvnav_trade.trajectory.control_cards import ControllerCard, FeedbackCard, RotationCard, WindCard
from lvnav_trade.trajectory.guided import autopilot, axis_state, loop
from lvnav_trade.trajectory.guided.missions import Missions, controlled_attitude

EFFECTIVENESS = 10.0  # 1/s^2
RATE = 200.0  # Hz


class Body(NamedTuple):
    """What the body meets at n ticks, see `autopilot.LateralForces`; motor: number of the burning stage."""

    motor: np.ndarray
    effectiveness: np.ndarray
    thrust_load: np.ndarray
    moment: np.ndarray
    force: np.ndarray
    airspeed: np.ndarray
    slip: np.ndarray
    wind: np.ndarray
    gust: np.ndarray
    gust_rate: np.ndarray
    thruster: np.ndarray


class Steady(NamedTuple):
    """A launch that goes nowhere: a body, and what a launch has beside its ascent."""

    body: Body
    course: autopilot.CommandedAttitude
    rotation: RotationCard
    controller: ControllerCard
    wind: WindCard
    imu: ImuCard
    envelope: EnvelopeCard


def settings(name: str) -> dict[str, Any]:
    """Return the fields of a card that comes with the tool, with those of the spreads that a vehicle names."""
    found: dict[str, Any] = YAML(typ="safe").load((tool_folder("configs") / f"{name}.yaml").read_text())
    if "dispersions" in found:
        found["dispersions"] = settings(found["dispersions"])
    return found


def design(frequency: float, damping: float, instability: float = 0.0) -> dict[str, Any]:
    """Return the gains that give a rigid body with an ideal nozzle a natural frequency (rad/s) and a damping ratio.

    The body obeys angle'' = instability x angle - EFFECTIVENESS x nozzle (both 1/s^2).
    """
    attitude, rate = (frequency**2 + instability) / EFFECTIVENESS, 2.0 * damping * frequency / EFFECTIVENESS
    return {"attitude": attitude, "rate": f"{rate} s"}


def steady_launch(
    duration: float = 20.0, motor: int = 1, gains: Any = None, nozzle: Any = None, **given: Any
) -> Steady:
    """Return a body that is the same at all ticks; fields of `Body` and `CommandedAttitude` are given as numbers or
    arrays.
    """
    rotation, controller = settings("rotation/three_motor"), settings("controllers/three_motor")
    rotation["nozzle"] |= {"misalignment": "0 deg"} | (nozzle or {})
    controller |= {"guidance": None} | ({"gains": [gains] * 3} if gains else {})
    t = np.arange(round(duration * RATE) + 1) / RATE
    numbers: dict[str, Any] = {
        "effectiveness": EFFECTIVENESS if motor else 0.0, "thrust_load": 30.0 if motor else 0.0, "moment": 0.0,
        "force": 0.0, "airspeed": 500.0, "slip": (0.0, 0.0), "wind": (0.0, 0.0), "gust": 0.0,
        "gust_rate": 1.0, "thruster": 0.002, "rate": (0.0, 0.0), "turn": (0.0, 0.0), "turn_rate": (0.0, 0.0),
        "ahead": (1.0, 0.0, 0.0), "up": (0.0, 0.0, 1.0), "right": (0.0, 1.0, 0.0), "velocity": (0.0, 0.0, 0.0),
    } | given  # fmt: skip
    arrays = {
        name: value if isinstance(value, np.ndarray) else np.broadcast_to(np.array(value, dtype=float),
                                                                         (t.size, *np.shape(value))).copy()
        for name, value in numbers.items()
    }  # fmt: skip
    phase = np.full(t.size, autopilot.BURN if motor else autopilot.COAST, dtype=np.int64)
    return Steady(
        Body(np.full(t.size, motor, dtype=np.int64), *(arrays[name] for name in Body._fields[1:])),
        autopilot.CommandedAttitude(t, *(arrays[name] for name in autopilot.CommandedAttitude._fields[1:-1]), phase),
        RotationCard.model_validate(rotation),
        ControllerCard.model_validate(controller),
        WindCard.model_validate(settings("wind/moderate") | {"spread": "0 %"}),
        ImuCard.model_validate(settings("imu/kvh1750_003")),
        EnvelopeCard(),
    )


@array_jit
def _fly(control, body):
    for k in range(body.motor.size - 1):
        if body.motor[k] != control.counts[autopilot.MOTOR]:
            axis_state.ignite(control, body.motor[k], 0.0, 0.0)
        met = autopilot.LateralForces(
            body.effectiveness[k],
            body.thrust_load[k],
            body.moment[k],
            body.force[k],
            body.airspeed[k],
            (body.slip[k, 0], body.slip[k, 1]),
            (body.wind[k, 0], body.wind[k, 1]),
            (0.0, 0.0),
            body.gust[k],
            body.gust_rate[k],
            body.thruster[k],
        )
        loop.tick(control, met, (0.0, 0.0))
        loop.move(control, met, control.course.t[1] - control.course.t[0])
    axis_state.close(control)


def fly_steady(
    launch: Steady, feedback: FeedbackCard, runs: int, seed: int = 1, record_interval: int = 200, first_run: int = 0
) -> Missions:
    """Return runs of a body that goes nowhere, as `missions.fly_missions` does of a launch."""
    controls = []
    for n in range(runs):
        draws = autopilot.DrawKeys(*seed_words(seed), np.uint64(first_run + n))
        controls.append(controlled_attitude(launch, feedback, draws, record_interval))
        _fly(controls[-1], launch.body)
    return Missions(
        launch.course.t[:-1:record_interval],
        np.stack([one.history for one in controls]),
        np.array([loop.movement(one) for one in controls]),
        np.stack([one.sums for one in controls]),
    )
