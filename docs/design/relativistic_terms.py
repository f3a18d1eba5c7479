"""What relativity adds to the pseudoranges and range rates of an ascent, term by term; behind decision 0034.

Run as ``python docs/design/relativistic_terms.py``: prints a table, takes some seconds. Signs follow the pseudorange.
"""

from __future__ import annotations

import numpy as np

from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.syntax.card_lookup import campaign_file
from lvnav_trade.gnss.visibility import antenna_motion, sky
from lvnav_trade.kernels.clock import SPEED_OF_LIGHT, spectral_densities
from lvnav_trade.kernels.earth import GM, J2, OMEGA, SEMI_MAJOR
from lvnav_trade.quantities.frames import earth_angle, ecef_from_eci, geodetic_from_ecef
from lvnav_trade.trajectory.flight import build

ECCENTRICITY, AXIS = 0.02, 26.56e6  # of a GPS orbit: the limit that satellites are kept within, m
ORBIT_ERROR = 2.0  # m, of the broadcast position, along the velocity


def shapiro(sent: np.ndarray, received: np.ndarray) -> np.ndarray:
    """Return the gravitational delay (m) from satellites (..., 3) to a receiver (..., 3), m (Ashby 2003, section 5)."""
    around = np.linalg.norm(sent, axis=-1) + np.linalg.norm(received, axis=-1)
    distance = np.linalg.norm(sent - received, axis=-1)
    return 2.0 * GM / SPEED_OF_LIGHT**2 * np.log((around + distance) / (around - distance))


def clock_rate(r_i: np.ndarray, v_i: np.ndarray) -> np.ndarray:
    """Return by what part a clock (n, 3) in frame i is faster than one at rest on the geoid, to 1/c^2."""
    radius = np.linalg.norm(r_i, axis=-1)
    sine = r_i[:, 2] / radius
    oblate = 1.0 - J2 * (SEMI_MAJOR / radius) ** 2 * (1.5 * sine**2 - 0.5)
    potential = GM / radius * oblate + 0.5 * np.sum(v_i**2, axis=-1)
    geoid = GM / SEMI_MAJOR * (1.0 + 0.5 * J2) + 0.5 * (OMEGA * SEMI_MAJOR) ** 2
    return (geoid - potential) / SPEED_OF_LIGHT**2


def main() -> None:
    """Print the size of each term over the ascent of the small campaign."""
    base = load(campaign_file("campaigns/smoke.yaml"), ()).base
    trajectory = build(base.trajectory)
    t = np.arange(0.0, float(trajectory.events["injection"]), 1.0)
    seen = sky(base.constellation, base.receiver, trajectory, t)
    r_i, v_i = antenna_motion(trajectory, base.receiver, t)
    height = geodetic_from_ecef(ecef_from_eci(r_i, earth_angle(trajectory.theta0, t)))[2]

    root = np.sqrt(GM * AXIS)
    print(f"satellite clock, eccentricity {ECCENTRICITY}: {2.0 * ECCENTRICITY * root / SPEED_OF_LIGHT:.1f} m,", end=" ")
    print(f"{1e3 * 2.0 * ECCENTRICITY * GM / AXIS / SPEED_OF_LIGHT:.2f} mm/s at most;", end=" ")
    left = 2.0 * ORBIT_ERROR * np.sqrt(GM / AXIS) / SPEED_OF_LIGHT
    print(f"corrected with an orbit wrong by {ORBIT_ERROR:g} m: {1e3 * left:.2f} mm")

    delay = np.where(seen.is_tracked, shapiro(seen.r_i, r_i[:, None, :]), np.nan)
    apart = np.nanmax(delay, axis=1) - np.nanmin(delay, axis=1)
    rate = np.nanmax(np.abs(np.diff(delay, axis=0)))
    print(f"gravitational delay: {1e3 * np.nanmin(delay):.1f} to {1e3 * np.nanmax(delay):.1f} mm;", end=" ")
    print(f"between satellites at most {1e3 * np.nanmax(apart):.1f} mm; rate at most {1e3 * rate:.3f} mm/s")

    drift = SPEED_OF_LIGHT * clock_rate(r_i, v_i)
    print(f"clock of the vehicle: drift from {1e3 * drift[0]:.3f} to {1e3 * drift[-1]:.1f} mm/s at", end=" ")
    print(f"{height[-1] / 1e3:.0f} km and {np.linalg.norm(v_i[-1]):.0f} m/s; bias after {t[-1]:.0f} s", end=" ")
    print(f"{np.sum(drift):.1f} m; change of drift at most {1e3 * np.abs(np.diff(drift)).max():.2f} mm/s per s")
    clock = base.receiver.clock
    bias, walk = spectral_densities(clock.h0, clock.h_minus2)
    drift = np.sqrt(walk * t[-1]), np.sqrt(bias * t[-1] + walk * t[-1] ** 3 / 3.0)
    print(
        f"oscillator of the card: drift {1e3 * np.sqrt(walk):.1f} mm/s in 1 s, {1e3 * drift[0]:.0f} mm/s and", end=" "
    )
    print(f"{drift[1]:.0f} m over the ascent (1 sigma), after a drift of {clock.initial_drift:g} m/s at its start")


if __name__ == "__main__":
    main()
