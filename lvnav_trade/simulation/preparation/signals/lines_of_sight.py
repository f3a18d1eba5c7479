"""Lines of sight of a flight: from the antennas of the vehicle to the satellites, at the epochs."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lvnav_trade.gnss.reception import factors
from lvnav_trade.kernels.earth import GM
from lvnav_trade.quantities.frames import matrices
from lvnav_trade.quantities.line_of_sight import Sight, point_mass_gravitation, point_motion, sight
from lvnav_trade.quantities.records import Floats, Motion, Sky
from lvnav_trade.quantities.shared_cards import NoiseFactor
from lvnav_trade.trajectory.flight import Trajectory, motion


class Lines(NamedTuple):
    """Lines of sight at the epochs, frame i, and the motion of the vehicle.

    trajectory : True flight.
    t : (n_epoch,) s since lift-off. Times of validity of the measurements.
    motion : Motion of the vehicle.
    C_b_i : (n_epoch, 3, 3). Attitude of the vehicle, body to frame i.
    position : (n_epoch, 3) m. Position of the point of the receiver's solution.
    velocity : (n_epoch, 3) m/s. Velocity of that point.
    vehicle_acceleration : (n_epoch, 3) m/s^2. Acceleration of the vehicle, without that by the lever arm.
    sight : (n_epoch, n_sat). Line from the receiving antenna to the satellite.
    acceleration : (n_epoch, n_sat) m/s^2. Second derivative of the range.
    """

    trajectory: Trajectory
    t: Floats
    motion: Motion
    C_b_i: Floats
    position: Floats
    velocity: Floats
    vehicle_acceleration: Floats
    sight: Sight
    acceleration: Floats

    def noise_factors(self, tables: Sequence[NoiseFactor], measurements: Sequence[str]) -> list[Floats | float]:
        """Return the factor (n_epoch, 1) on the sigma of each measurement."""
        return factors(tables, measurements, self.trajectory, self.t)


def lines_of(trajectory: Trajectory, lever_b: Floats, sky: Sky) -> Lines:
    """Return the lines of sight of a flight.

    Parameters
    ----------
    trajectory
        True flight.
    lever_b
        (3,) m. From the IMU to the point of the receiver's solution, body axes.
    sky
        Satellites at the epochs, and the antennas that receive them.
    """
    vehicle = motion(trajectory, sky.t)
    C_b_i = matrices(vehicle.q_b_i)
    position, velocity = point_motion(vehicle, C_b_i, lever_b)
    specific_force_i = np.einsum("nij,nj->ni", C_b_i, vehicle.f_b)
    acceleration = point_mass_gravitation(vehicle.r_i, GM) + specific_force_i
    antennas = [point_motion(vehicle, C_b_i, lever) for lever in sky.lever_arms]
    antenna_r_i = np.stack([r_i for r_i, _ in antennas], axis=1)
    antenna_v_i = np.stack([v_i for _, v_i in antennas], axis=1)
    receiving = sky.antenna[:, :, None]
    lines = sight(
        sky.r_i - np.take_along_axis(antenna_r_i, receiving, axis=1),
        sky.v_i - np.take_along_axis(antenna_v_i, receiving, axis=1),
    )
    relative_acceleration = point_mass_gravitation(sky.r_i, GM) - acceleration[:, None, :]
    return Lines(
        trajectory=trajectory,
        t=sky.t,
        motion=vehicle,
        C_b_i=C_b_i,
        position=position,
        velocity=velocity,
        vehicle_acceleration=acceleration,
        sight=lines,
        acceleration=lines.acceleration(relative_acceleration),
    )
