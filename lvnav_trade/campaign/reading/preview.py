"""The flight of a trajectory card alone, as the tables `reference` and `events` of results have it."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydantic import TypeAdapter, ValidationError

from lvnav_trade import frames
from lvnav_trade.campaign.reading.expand import expanded
from lvnav_trade.campaign.reading.explain import explain
from lvnav_trade.campaign.syntax import fields
from lvnav_trade.campaign.syntax.cards import Shelf, nowhere
from lvnav_trade.campaign.syntax.tree import Node, plain
from lvnav_trade.errors import InputError
from lvnav_trade.scenario import Scenario
from lvnav_trade.world.flight.trajectory import TrajectoryCard, build, motion

_STEP = 1.0  # s between points


class Preview(NamedTuple):
    """A card's name, and columns by name as in the tables `reference` and `events`."""

    name: str
    reference: dict[str, Any]
    events: dict[str, Any]


def read_card(name: str, folder: Path) -> TrajectoryCard:
    """Return the trajectory card of a name such as trajectories/two_stage_leo, or of a path.

    Cards of the user's own are looked for beside and above `folder`. InputError where there is none, or it is wrong.
    """
    kind: Any = Scenario.model_fields["trajectory"].annotation
    node = expanded(Node(name, nowhere(name)), kind, Shelf.of(folder), "trajectory")
    try:
        return TypeAdapter(kind).validate_python(plain(node))
    except ValidationError as error:
        raise InputError(records=explain(error, node, fields.member(kind, node), "trajectory")) from None


def preview(card: TrajectoryCard) -> Preview:
    """Return the flight of a card every second and at its events; InputError where it cannot be flown."""
    flight = build(card)
    grid = np.arange(np.ceil(flight.start / _STEP), np.floor(flight.end / _STEP) + 1.0) * _STEP
    t = np.unique(np.concatenate([[flight.start], grid, list(flight.events.values()), [flight.end]]))
    m = motion(flight, t)
    theta = frames.earth_angle(flight.theta0, t)
    latitude, longitude, altitude = frames.geodetic_from_ecef(frames.ecef_from_eci(m.r_i, theta))
    reference = {
        "t_s": t,
        "latitude_rad": latitude,
        "longitude_rad": longitude,
        "altitude_m": altitude,
        "ground_speed_m_per_s": np.linalg.norm(frames.earth_velocity(m.r_i, m.v_i), axis=1),
    }
    names, times = list(flight.events), list(flight.events.values())
    events = {"event": names, "kind": ["event"] * len(names), "t_s": times, "t_end_s": times}
    return Preview(card.name, reference, events)
