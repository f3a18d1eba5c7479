"""Atmospheric delays of the signals: true delays, and those that the filter corrects."""

from collections.abc import Callable
from datetime import datetime, timedelta
from functools import cache
from typing import NamedTuple

import numpy as np

from lvnav_trade.gnss.delay_cards import AtmosphereCard, CorrectionsCard, NoIonosphere, correction_models
from lvnav_trade.gnss.delay_models import DelayGeometry, ionosphere_delay, troposphere_delay
from lvnav_trade.gnss.receiver_cards import ReceiverCard
from lvnav_trade.gnss.visibility import antenna_motion
from lvnav_trade.quantities.frames import earth_angle, ecef_from_eci, geodetic_from_ecef, unit
from lvnav_trade.quantities.line_of_sight import look_angles
from lvnav_trade.quantities.records import Floats, Sky
from lvnav_trade.quantities.times import leap_seconds
from lvnav_trade.trajectory.flight import Trajectory

HALF_STEP = 0.25  # s to either side of an epoch for the rate of a delay


class Delays(NamedTuple):
    """Atmospheric delays (m) of the code and their rates (m/s) in the Doppler, (n_epoch, n_sat, 2) each.

    They are zero for satellites that are not tracked. The ionosphere advances the carrier as much as it delays the
    code, so its rate in the Doppler has the opposite sign.

    troposphere : True tropospheric delay.
    ionosphere : True ionospheric delay.
    modelled_troposphere : Tropospheric delay in the filter's correction.
    modelled_ionosphere : Ionospheric delay in the filter's correction.
    """

    troposphere: Floats
    ionosphere: Floats
    modelled_troposphere: Floats
    modelled_ionosphere: Floats

    @property
    def residual(self) -> Floats:
        """Residual delay of the code after the filter's correction, (n_epoch, n_sat, 2) m, m/s."""
        true = self.troposphere + self.ionosphere
        modelled_delay = self.modelled_troposphere + self.modelled_ionosphere
        return np.asarray(true - modelled_delay)

    @property
    def phase_residual(self) -> Floats:
        """Residual delay of the carrier phase after the filter's correction, (n_epoch, n_sat) m."""
        air = self.troposphere - self.modelled_troposphere
        charge = self.ionosphere - self.modelled_ionosphere
        return np.asarray(air[..., 0] - charge[..., 0])


def _geometry(trajectory: Trajectory, receiver: ReceiverCard, sky: Sky, shift: float) -> tuple[DelayGeometry, Floats]:
    """Return position and lines of sight of the antenna some time after each epoch, and these times (n_epoch,) s.

    Parameters
    ----------
    trajectory, receiver
        True flight, and card of the receiver.
    sky
        Satellites at the epochs.
    shift
        s. Time after each epoch; negative: before.
    """
    theta0 = trajectory.theta0
    t = np.clip(sky.t + shift, trajectory.start, trajectory.end)
    antenna_r_i, _ = antenna_motion(trajectory, receiver, t)
    time_since_epoch = (t - sky.t)[:, None, None]
    satellite_r_i = sky.r_i + time_since_epoch * sky.v_i
    line = satellite_r_i - antenna_r_i[:, None, :]
    direction = unit(line)
    azimuth, elevation = look_angles(theta0, t, antenna_r_i, direction)
    earth_rotation = earth_angle(theta0, t)
    antenna_r_e = ecef_from_eci(antenna_r_i, earth_rotation)
    latitude, longitude, height = geodetic_from_ecef(antenna_r_e)
    day_of_year, seconds_of_day = _start_of_day(trajectory)
    geometry = DelayGeometry(day_of_year, seconds_of_day + t, latitude, longitude, height, azimuth, elevation)
    return geometry, t


def _start_of_day(trajectory: Trajectory) -> tuple[float, float]:
    """Return day of the year and second of the day of lift-off, in the time scale of GPS (UTC plus leap seconds)."""
    lift_off = datetime.fromisoformat(trajectory.epoch)
    start = lift_off + timedelta(seconds=leap_seconds(lift_off))
    midnight = start.replace(hour=0, minute=0, second=0, microsecond=0)
    day_of_year = float(start.timetuple().tm_yday)
    seconds_of_day = (start - midnight).total_seconds()
    return day_of_year, seconds_of_day


def delays(
    trajectory: Trajectory,
    receiver: ReceiverCard,
    sky: Sky,
    atmosphere: AtmosphereCard,
    corrections: CorrectionsCard,
) -> Delays:
    """Return true and modelled atmospheric delays along the nominal flight.

    The models of the filter are evaluated at the true position of the antenna instead of the estimate. The difference
    is at most 1 cm per metre of position error, near the ground and the horizon.

    Parameters
    ----------
    trajectory, receiver
        True flight, and card of the receiver.
    sky
        Satellites at the epochs.
    atmosphere
        Card of the true atmosphere.
    corrections
        Card of the filter's corrections.
    """

    @cache
    def geometries() -> list[tuple[DelayGeometry, Floats]]:
        return [_geometry(trajectory, receiver, sky, shift) for shift in (-HALF_STEP, 0.0, HALF_STEP)]

    def delay_and_rate(model_type: str, delay: Callable[[DelayGeometry], Floats], carrier_sign: float) -> Floats:
        if model_type == "none":
            return np.zeros((*sky.is_tracked.shape, 2))
        (earlier_geometry, t_earlier), (present_geometry, _), (later_geometry, t_later) = geometries()
        earlier_delay = delay(earlier_geometry)
        present_delay = delay(present_geometry)
        later_delay = delay(later_geometry)
        time_difference = (t_later - t_earlier)[:, None]
        rate = carrier_sign * (later_delay - earlier_delay) / time_difference
        values = np.stack([present_delay, rate], axis=2)
        return np.where(sky.is_tracked[:, :, None], values, 0.0)

    # two frequencies remove the ionosphere to first order, so it is neither true nor corrected
    air = atmosphere.troposphere
    charge = NoIonosphere() if receiver.is_dual else atmosphere.ionosphere
    air_hat, charge_hat = correction_models(corrections, atmosphere, not receiver.is_dual)
    return Delays(
        troposphere=delay_and_rate(air.kind, lambda g: troposphere_delay(air, g), 1.0),
        ionosphere=delay_and_rate(charge.kind, lambda g: ionosphere_delay(charge, g), -1.0),
        modelled_troposphere=delay_and_rate(air_hat.kind, lambda g: troposphere_delay(air_hat, g), 1.0),
        modelled_ionosphere=delay_and_rate(charge_hat.kind, lambda g: ionosphere_delay(charge_hat, g), -1.0),
    )
