"""The tables of what the receiver hears and tracks: satellites over time, and every change of state of a channel."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lvnav_trade.records import IDLE, TRACKING
from lvnav_trade.scenario import Scenario

if TYPE_CHECKING:
    from lvnav_trade.engines.setup.prepare import Prepared

STEP = 1.0
"""Seconds between the stored skies at least: a receiver at 10 Hz adds nothing that a figure could show."""


def sky_tables(prepared: Prepared) -> dict[str, dict[str, Any]]:
    """Return the columns of `satellites` and `transitions`."""
    return {"satellites": _satellites(prepared), "transitions": _transitions(prepared)}


def thresholds(scenario: Scenario) -> dict[str, Any]:
    """Return the C/N0 (dB-Hz) above which the receiver finds and keeps satellites, as columns of one row; NaN where it
    has no link budget or no tracking.
    """
    receiver = scenario.receiver
    tracking = receiver.tracking if receiver.link is not None else None
    found, kept = (tracking.acquire_above, tracking.track_above) if tracking is not None else (np.nan, np.nan)
    return {"acquire_above_db_hz": [found], "track_above_db_hz": [kept]}


def _satellites(prepared: Prepared) -> dict[str, Any]:
    """List the satellites that are up or have a channel; where there are none the highest, so that no epoch is lost."""
    sky, delays = prepared.sky, prepared.delays
    step = max(1, round(STEP / float(np.median(np.diff(sky.t))))) if len(sky.t) > 1 else 1
    elevation, tracked = sky.elevation[::step], sky.tracked[::step]
    shown = (elevation > 0.0) | tracked | (sky.state[::step] != IDLE)
    bare = ~np.any(shown, axis=1)
    shown[bare, np.argmax(elevation[bare], axis=1)] = True
    row, column = np.nonzero(shown)

    def picked(values: Any) -> Any:
        return np.asarray(values)[::step][row, column]

    def measured(values: Any) -> Any:
        return np.where(tracked[row, column], picked(values), np.nan)

    troposphere, ionosphere = delays.troposphere[:, :, 0], delays.ionosphere[:, :, 0]
    return {
        "t_s": sky.t[::step][row],
        "satellite": np.array(sky.names)[column],
        "system": np.array(sky.systems)[column],
        "azimuth_rad": picked(sky.azimuth),
        "elevation_rad": picked(sky.elevation),
        "tracked": picked(sky.tracked),
        "state": np.array(TRACKING)[picked(sky.state)],
        "antenna_number": picked(sky.antenna).astype(np.int64) + 1,
        "cn0_db_hz": picked(sky.cn0),
        "range_sigma_m": measured(sky.range_sigma),
        "rate_sigma_m_per_s": measured(sky.rate_sigma),
        "troposphere_m": measured(troposphere),
        "troposphere_left_m": measured(troposphere - delays.modelled_troposphere[:, :, 0]),
        "ionosphere_m": measured(ionosphere),
        "ionosphere_left_m": measured(ionosphere - delays.modelled_ionosphere[:, :, 0]),
        "latency_s": (prepared.t_epoch - sky.t)[::step][row],
    }


def _transitions(prepared: Prepared) -> dict[str, Any]:
    every = prepared.sky.transitions
    return {
        "t_s": [change.t for change in every],
        "satellite": [change.satellite for change in every],
        "from_state": [change.before for change in every],
        "to_state": [change.after for change in every],
        "reason": [change.reason for change in every],
    }
