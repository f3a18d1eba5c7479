"""Partial derivatives of IMU samples with respect to IMU errors, for one IMU and for the combined triad of an array."""

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.processes import profile_value
from lvnav_trade.kernels.transition import CONSTANT, GYRO, OTHER_0, OTHER_2, OWN_0, OWN_2, SQUARE, sensed_driver


@jit
def unit_input(frames, c, driver, own, other):
    """Return the driver of an error parameter of sensing axis c.

    Parameters
    ----------
    frames : (3, 3, 3) direction and misalignment directions of each axis, body axes
    c : sensing axis
    driver : as in `kernels.transition`
    own, other : (3,) inputs of the sensor itself and of the other sensor, body axes
    """
    if driver < 0 or driver == CONSTANT:
        return 1.0
    k, along = 0, own
    if OWN_0 <= driver and driver <= OWN_2:
        k = driver - OWN_0
    elif OTHER_0 <= driver and driver <= OTHER_2:
        k, along = (driver - OTHER_0 - c) % 3, other
    value = frames[c, k, 0] * along[0] + frames[c, k, 1] * along[1] + frames[c, k, 2] * along[2]
    return value * value if driver == SQUARE else value


@jit
def _fill_partials_of_array(a, true, units, tick, dt):
    """Set the partial derivatives of a sample of the combined triad with respect to the components of all IMUs."""
    for j in range(true.sensor.shape[0]):
        if true.sampled[j] and true.profile[j] < 0:
            sensor, triad, component = true.sensor[j], true.triad[j], true.first[j]
            source, k = true.source[component], true.slot[component]
            for c in range(3):
                u = tick_input(units, triad, sensor, c, true.driver[j], tick, dt)
                for i in range(3):
                    entering = lasting_share(units, tick, triad, sensor, i, c) * u
                    a[true.group[source], k + c, 3 * sensor + i, true.lane[source]] = entering


@jit
def lasting_share(units, tick, triad, sensor, i, c):
    """Return the weight by which a lasting error of sensing axis c enters axis i of the combined triad at a tick."""
    stage = units.stage[tick]
    return units.solved[stage, triad, sensor, i, c] * units.noisy[stage, sensor, 0, i]


@jit
def tick_input(units, triad, sensor, c, driver, tick, dt):
    """Return the driver of an error parameter of sensing axis c in the sample of a tick."""
    a, f = units.dtheta[triad, tick], units.dvel[triad, tick]
    angle, force = (a[0] / dt, a[1] / dt, a[2] / dt), (f[0] / dt, f[1] / dt, f[2] / dt)
    if sensor == GYRO:
        return unit_input(units.frames[triad], c, driver, angle, force)
    return unit_input(units.frames[triad], c, driver, force, angle)


@jit
def _add_profiles_of_array(z, true, unit, units, tick, t):
    """Add the deterministic errors (profiles) of all IMUs of an array to the deviation (6,) of a sample."""
    for j in range(true.sensor.shape[0]):
        if true.profile[j] >= 0:
            for c in range(3):
                sensor, solved = true.sensor[j], units.solved[units.stage[tick], true.triad[j], true.sensor[j]]
                u = tick_input(units, true.triad[j], sensor, c, true.driver[j], tick, unit.dt)
                value = u * profile_value(unit, true.profile[j], c, t)
                for i in range(3):
                    z[3 * sensor + i] += solved[i, c] * value


@jit
def fill_partials(a, true, units, vehicle, tick, dt):
    """Set the partial derivatives of the samples of a tick with respect to components that no filter state models.

    Parameters
    ----------
    a : (n_group, n_slot, 6) in lanes, set here
    true : Components
    units : Units of an IMU array; None for one IMU
    vehicle : VehicleModel
    tick, dt : index; s
    """
    if units is None:
        _fill_partials(a, true, vehicle, tick)
    else:
        _fill_partials_of_array(a, true, units, tick, dt)


@jit
def _fill_partials(a, true, vehicle, tick):
    for j in range(true.sensor.shape[0]):
        if true.sampled[j] and true.profile[j] < 0:
            u = sensed_driver(true.sensor[j], true.driver[j], vehicle.rate[tick], vehicle.force[tick])
            source, k = true.source[true.first[j]], true.slot[true.first[j]]
            for axis in range(3):
                a[true.group[source], k + axis, 3 * true.sensor[j] + axis, true.lane[source]] = u[axis]


@jit
def _add_profiles(z, true, unit, reference, tick, t):
    for j in range(true.sensor.shape[0]):
        if true.profile[j] >= 0 and true.sampled[j]:
            first = 3 * true.sensor[j]
            increment = reference.dtheta[tick] if true.sensor[j] == GYRO else reference.dvel[tick]
            for axis in range(3):
                u = 1.0 if true.driver[j] == CONSTANT else increment[axis] / unit.dt
                z[first + axis] += u * profile_value(unit, true.profile[j], axis, t)


@jit
def deviations(z, true, unit, units, reference, tick):
    """Set the deterministic errors of the samples of a tick: bandwidth, unsensed axes, and profiles without a state.

    Parameters
    ----------
    z : (6,) rad/s and m/s^2, set here
    true, unit : Components, Unit
    units : Units of an IMU array; None for one IMU
    reference : Reference, true motion
    tick : index
    """
    for i in range(3):
        z[i] = (unit.dtheta[tick, i] - reference.dtheta[tick, i]) / unit.dt
        z[3 + i] = (unit.dvel[tick, i] - reference.dvel[tick, i]) / unit.dt
    t = unit.start + unit.dt * (tick + 0.5)
    if units is None:
        _add_profiles(z, true, unit, reference, tick, t)
    else:
        _add_profiles_of_array(z, true, unit, units, tick, t)
