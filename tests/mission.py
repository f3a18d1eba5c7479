"""Results of flights whose end is known: coasting orbits and falls, with covariances in the axes of the flight."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from lvnav_trade.kernels.earth import GM, J2, SEMI_MAJOR
from lvnav_trade.quantities.frames import Elements, state_from_elements
from lvnav_trade.results.tables.engine_tables import CaseInfo
from lvnav_trade.results.tables.write import open_results
from lvnav_trade.simulation.statistics import summarise
from tests import synthetic

CASE = "cccccccccccc"
SUN_SYNCHRONOUS = Elements(6.9e6, 0.012, np.radians(97.5), 1.0, 1.2, 0.9)
"""At injection; a = 6900 km, e = 0.012: some 440 by 605 km."""
CIRCULAR = Elements(6.9e6, 0.0, np.radians(97.5), 1.0, 0.0, 0.9)


def gravitation(r_i: np.ndarray) -> np.ndarray:
    """Return point mass and J2 written out for the tests, another way than the code does."""
    x, y, z = r_i
    r = np.linalg.norm(r_i)
    s = 5.0 * (z / r) ** 2
    k = 1.5 * J2 * (SEMI_MAJOR / r) ** 2
    return -GM / r**3 * np.array([x * (1 + k * (1 - s)), y * (1 + k * (1 - s)), z * (1 + k * (3 - s))])


def coast(r_i: np.ndarray, v_i: np.ndarray, t: np.ndarray, oblate: bool = True, **kwargs: Any) -> Any:
    """Return scipy's solution of free flight over the times t, from the first of them on."""

    def slope(_: float, y: np.ndarray) -> np.ndarray:
        pull = gravitation(y[:3]) if oblate else -GM * y[:3] / np.linalg.norm(y[:3]) ** 3
        return np.concatenate([y[3:], pull])

    start = np.concatenate([r_i, v_i])
    return solve_ivp(slope, (t[0], t[-1]), start, "DOP853", t, rtol=1e-12, atol=1e-6, **kwargs)


def flight(r_i: np.ndarray, v_i: np.ndarray) -> Any:
    """Return a prepared scenario of `synthetic` that coasts through this state at injection."""
    made = synthetic.prepared_case()
    t, at = made.reference.t, synthetic.EVENTS["injection"]
    back = coast(r_i, v_i, np.concatenate([[at], t[t < at][::-1]]))
    ahead = coast(r_i, v_i, np.concatenate([[at], t[t >= at]]))
    y = np.concatenate([back.y[:, :0:-1], ahead.y[:, 1:]], axis=1).T
    flight = made.reference._replace(r_i=y[:, :3], v_i=y[:, 3:])
    return SimpleNamespace(**{**vars(made), **synthetic.truth_of(flight)})


def results(
    folder: Path,
    orbit: Elements | tuple[np.ndarray, np.ndarray] = SUN_SYNCHRONOUS,
    n_run: int = 200,
    factor: float = 1.0,
    campaign: str = synthetic.CAMPAIGN,
    failing: tuple[int, ...] = (),
) -> Path:
    """Write the results of one case that coasts through an orbit, or a state, at injection."""
    r_i, v_i = state_from_elements(orbit) if isinstance(orbit, Elements) else orbit
    prepared_case = flight(r_i, v_i)
    reported = synthetic.covariance(factor)
    written = open_results(folder, "synthetic", campaign, {"seed": 7}, "resume")
    for first in range(0, n_run, 40):
        block = synthetic.block(reported, first, min(40, n_run - first), failing=failing)
        written.write_block(CASE, summarise(block, synthetic.EVENTS, reported.true_sigma, synthetic.OUTPUTS))
    info = CaseInfo(CASE, "imu=fine", {"imu": "fine"})
    written.write_case(
        info, prepared_case, reported, written.block_summaries(CASE) if n_run else None, synthetic.explanation(reported)
    )
    written.finish({"timings_s": {}, "cases": [CASE]})
    return folder
