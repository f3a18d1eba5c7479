"""What an altimeter measures on the nominal flight, and what the filter believes of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.engines.inputs import Altimeter
from lvnav_trade.frames import geodetic_from_ecef
from lvnav_trade.kernels.random import source_word
from lvnav_trade.records import Floats
from lvnav_trade.scenario import Scenario, altimeter_belief
from lvnav_trade.world.flight.trajectory import Trajectory, motion

NOISE = "altimeter noise"


class Height(NamedTuple):
    """An altimeter at the epochs, each (n_epoch,): on, whether it measures; true height m; sigma of its white noise m;
    variance m^2 that the filter believes of a measurement.
    """

    on: NDArray[np.bool_]
    true: Floats
    sigma: Floats
    variance: Floats


def height_of(scenario: Scenario, trajectory: Trajectory, t_epoch: Floats) -> Height | None:
    """Return what the altimeter of a scenario measures at the epochs (s); None where there is none, or no filter for
    it.
    """
    card = scenario.altimeter
    if card is None or scenario.filter.kind == "inertial":
        return None
    # heights are the same in frame i: it turns about the ellipsoid's axis
    true = geodetic_from_ecef(motion(trajectory, t_epoch).r_i)[2]
    sigma, share = altimeter_belief(scenario)
    return Height(
        on=(true >= card.lowest) & (true <= card.highest),
        true=true,
        sigma=np.hypot(card.sigma, card.share * true),
        variance=sigma**2 + (share * true) ** 2,
    )


def altimeter_of(height: Height | None) -> Altimeter | None:
    """Return the altimeter for the kernels, None where there is none."""
    if height is None:
        return None
    return Altimeter(on=height.on, height=height.true, source=source_word(NOISE))
