"""What an altimeter measures on the nominal flight, and the variance that the filter models."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.engines.inputs import Altimeter
from lvnav_trade.engines.sensors import measures
from lvnav_trade.frames import geodetic_from_ecef
from lvnav_trade.kernels.random import source_word
from lvnav_trade.observables.altitude import AltimeterCard
from lvnav_trade.records import Floats
from lvnav_trade.scenario import Scenario, sensor_model, sensor_of
from lvnav_trade.world.flight.trajectory import Trajectory, motion

NOISE = "altimeter noise"


class Height(NamedTuple):
    """An altimeter at the epochs, each (n_epoch,): on, whether it measures; true height m; sigma of its white noise m;
    variance m^2 of a measurement in the filter's model.
    """

    on: NDArray[np.bool_]
    true: Floats
    sigma: Floats
    variance: Floats


def height_of(scenario: Scenario, trajectory: Trajectory, t_epoch: Floats) -> Height | None:
    """Return what the altimeter of a scenario measures at the epochs (s); None if the filter does not use one."""
    card = sensor_of(scenario, "altitude")
    if not isinstance(card, AltimeterCard):
        return None
    # heights are the same in frame i: it turns about the ellipsoid's axis
    true = geodetic_from_ecef(motion(trajectory, t_epoch).r_i)[2]
    model = sensor_model(scenario, card)
    return Height(
        on=measures(scenario, card, trajectory.events, t_epoch) & (true >= card.lowest) & (true <= card.highest),
        true=true,
        sigma=np.hypot(card.sigma, card.share * true),
        variance=model.sigma**2 + (model.share * true) ** 2,
    )


def altimeter_of(height: Height | None) -> Altimeter | None:
    """Return the altimeter for the kernels, None where there is none."""
    if height is None:
        return None
    return Altimeter(on=height.on, height=height.true, source=source_word(NOISE))
