"""How far tropospheric corrections are from traced rays, along an ascent and over elevation and height; for 0013.

Run as ``python docs/design/tropospheric_delay.py``: prints a table, draws tropospheric_delay.png beside the decision,
takes some ten seconds.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.colors import SymLogNorm

from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.syntax.card_lookup import campaign_file
from lvnav_trade.gnss.delay_cards import (
    AnyElevationTroposphere,
    BeanThayerProfile,
    NiellTroposphere,
    RayTracedTroposphere,
    SaastamoinenTroposphere,
    SpilkerTroposphere,
)
from lvnav_trade.gnss.delay_models import DelayGeometry, troposphere_delay
from lvnav_trade.gnss.visibility import antenna_motion, sky
from lvnav_trade.quantities.frames import earth_angle, ecef_from_eci, geodetic_from_ecef
from lvnav_trade.trajectory.flight import build

DOCS = Path(__file__).resolve().parents[1]
FIGURE = DOCS / "decisions/0013-tropospheric-delay.png"
SCALE, EARTH = 7518.8, 6371e3  # m, h_tau and R_e of Canepa and Servidia
TRUTHS = {
    "standard atmosphere": RayTracedTroposphere(),
    "atmosphere of simulators": RayTracedTroposphere(profile=BeanThayerProfile()),
}
COLORS = {"standard atmosphere": "C0", "atmosphere of simulators": "C1"}
MODELS = {
    "Canepa-Servidia": AnyElevationTroposphere(),
    "Spilker": SpilkerTroposphere(),
    "Saastamoinen": SaastamoinenTroposphere(),
    "Niell": NiellTroposphere(),
}


def mask(height: np.ndarray) -> np.ndarray:
    """Return the lowest elevation (rad) of Canepa and Servidia, section 6.3.1."""
    low = np.radians(10.0) * (10.0 * SCALE - height) / (10.0 * SCALE)
    high = -np.arccos(np.minimum((EARTH + 10.0 * SCALE) / (EARTH + height), 1.0))
    return np.where(height <= 10.0 * SCALE, low, high)


def ascent() -> tuple[np.ndarray, DelayGeometry]:
    """Return times (n_epoch,) s and the geometry of all satellites along the shipped two-stage ascent."""
    base = load(campaign_file("campaigns/smoke.yaml"), ()).base
    trajectory = build(base.trajectory)
    t = np.arange(0.0, float(trajectory.events["injection"]), 1.0)
    receiver = base.receiver.model_copy(update={"mask": np.radians(-30.0), "channels": 64})
    seen = sky(base.constellation, receiver, trajectory, t)
    r_i, _ = antenna_motion(trajectory, receiver, t)
    place = geodetic_from_ecef(ecef_from_eci(r_i, earth_angle(trajectory.theta0, t)))
    return t, DelayGeometry(213.0, 43200.0, *place, seen.azimuth, seen.elevation)


def over_the_map() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return height (m), elevation (deg) and the error (m) of Canepa and Servidia's model, NaN below the Earth."""
    height, degrees = np.linspace(0.0, 100e3, 401), np.linspace(-10.0, 20.0, 601)
    elevation = np.broadcast_to(np.radians(degrees), (height.size, degrees.size))
    zero = np.zeros(height.size)
    geometry = DelayGeometry(
        213.0, 43200.0, zero + np.radians(-38.6), zero, height, np.zeros_like(elevation), elevation
    )
    error = residual(TRUTHS["standard atmosphere"], geometry)
    blocked = elevation < -np.arccos(EARTH / (EARTH + height[:, None]))
    return height, degrees, np.where(blocked, np.nan, error)


def residual(truth: RayTracedTroposphere, geometry: DelayGeometry) -> np.ndarray:
    """Return the delay (m) of Canepa and Servidia's model less that of traced rays."""
    return troposphere_delay(MODELS["Canepa-Servidia"], geometry) - troposphere_delay(truth, geometry)


def anywhere(geometry: DelayGeometry) -> DelayGeometry:
    """Return the same receivers looking at elevations from the mask to the zenith, to the north."""
    low = mask(geometry.height)[:, None]
    elevation = low + np.linspace(0.0, 1.0, 60) ** 2 * (np.pi / 2 - low)
    return geometry._replace(azimuth=np.zeros_like(elevation), elevation=elevation)


def main() -> None:
    """Print the errors behind the mask and draw them."""
    t, geometry = ascent()
    hidden = geometry.elevation < mask(geometry.height)[:, None]
    figure, axes = plt.subplots(3, 1, figsize=(7.5, 9.0), layout="constrained", height_ratios=(2, 2, 3))
    for name, truth in TRUTHS.items():
        delay = np.where(hidden, np.nan, troposphere_delay(truth, geometry))
        print(f"rays through the {name}: up to {np.nanmax(delay):.2f} m")
        for label, model in MODELS.items():
            error = np.where(hidden, np.nan, troposphere_delay(model, geometry) - delay)
            print(f"    {label:16s} error {np.nanmin(error):7.3f} to {np.nanmax(error):6.3f} m, rms {rms(error):.3f} m")
            if label == "Canepa-Servidia":
                axes[1].plot(t, error, color=COLORS[name], lw=0.8)[0].set_label(name)
        spread = residual(truth, anywhere(geometry))
        print(f"    Canepa-Servidia  at any elevation above the mask {spread.min():.3f} to {spread.max():.3f} m")
        axes[1].fill_between(t, spread.min(axis=1), spread.max(axis=1), color=COLORS[name], alpha=0.2, lw=0.0)
        axes[0].plot(t, delay, color=COLORS[name], lw=0.8)
    axes[0].set(ylabel="delay of traced rays, m", title="Lines: satellites above the mask of section 6.3.1")
    axes[1].axhline(-1.0, color="0.4", lw=0.8, ls=":")
    axes[1].axhline(1.0, color="0.4", lw=0.8, ls=":")
    axes[1].set(xlabel="time since lift-off, s", ylabel="correction less rays, m", ylim=(-1.3, 1.3))
    axes[1].set_title("Shaded: any elevation above the mask")
    axes[1].legend(title="Canepa-Servidia against the", loc="lower right", fontsize=8)
    height, degrees, error = over_the_map()
    norm = SymLogNorm(0.1, vmin=-50.0, vmax=50.0)
    image = axes[2].pcolormesh(degrees, height / 1e3, error, norm=norm, cmap="RdBu_r", rasterized=True)
    contours = axes[2].contour(
        degrees, height / 1e3, error, [-30.0, -10.0, -1.0, 1.0, 10.0], colors="k", linewidths=0.6
    )
    axes[2].clabel(contours, fmt="%g m", fontsize=7)
    axes[2].plot(np.degrees(mask(height)), height / 1e3, "k--", lw=1.2, label="mask of section 6.3.1")
    axes[2].set(xlabel="elevation, deg", ylabel="height, km", title="Without the mask, standard atmosphere")
    axes[2].legend(loc="upper right", fontsize=8)
    figure.colorbar(image, ax=axes[2], label="correction less rays, m")
    figure.savefig(FIGURE, dpi=90)
    print(f"at sea level, elevation 0: {error[0, np.argmin(np.abs(degrees))]:.1f} m")


def rms(error: np.ndarray) -> float:
    """Return the root mean square of what is not hidden."""
    return float(np.sqrt(np.nanmean(error**2)))


if __name__ == "__main__":
    main()
