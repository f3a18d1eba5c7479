"""Samples of the IMU as measurements of a filter whose states are rate and specific force of the vehicle."""

from typing import NamedTuple

from lvnav_trade.filter.ekf import correct_parameters, correct_receiver
from lvnav_trade.filter.policies.epoch_differences import correct_previous_epoch
from lvnav_trade.kernels.jit import inline_jit, jit
from lvnav_trade.kernels.lanes import number_like, zeros_of
from lvnav_trade.kernels.mechanisation import mechanise
from lvnav_trade.kernels.transition import correct_motion
from lvnav_trade.kernels.vehicle import N_SAMPLE, advance_vector, fill_samples
from lvnav_trade.quantities.records import Floats, Ints


class VehicleModel(NamedTuple):
    """Model of the vehicle's motion in a filter that processes IMU samples, and the true motion it is compared with.

    motion : First of the six motion states: rate (3) and specific force (3), body axes.
    blocks : (2, n_block, 2). Number and driver of each parameter block of gyro and accelerometer; number -1 none.
    columns : (6, 1 + n_block). States of the Jacobian row of each scalar of a sample.
    walk : (n_tick, 6) SI squared. Variance of the step of each motion state into each tick.
    variance : (6,) SI squared. Noise variance of each scalar of a sample.
    rate : (n_tick, 3) rad/s. True mean angular rate over each tick, body axes.
    force : (n_tick, 3) m/s^2. True mean specific force over each tick, body axes.
    """

    motion: int
    blocks: Ints
    columns: Ints
    walk: Floats
    variance: Floats
    rate: Floats
    force: Floats


class ImuSampleWork(NamedTuple):
    """Arrays of a run whose filter processes IMU samples as measurements. A sample has rate (3) and specific force (3).

    rate : (3,) rad/s. Estimated body rate, body axes.
    force : (3,) m/s^2. Estimated specific force, body axes.
    sample : (6,) rad/s, m/s^2. Sample of the last tick, as the IMU outputs it.
    z : (6,). Sample minus its prediction.
    weight : (6,). Inverse of the innovation variance of each scalar.
    residual : (6,). Innovation of each scalar after the scalars before it.
    K : (6, n_state). P h' of each scalar after the scalars before it.
    covariance_scratch : (9, n_state). Scratch of the covariance propagation over a tick.
    h : (6, n_entry). Jacobian of the sample.
    """

    rate: Floats
    force: Floats
    sample: Floats
    z: Floats
    weight: Floats
    residual: Floats
    K: Floats
    covariance_scratch: Floats
    h: Floats


def new_sample_work(n_state: int, n_entry: int, lanes: int = 0) -> ImuSampleWork:
    """Return the arrays of a run's samples: one run, or `lanes` runs on the last axis."""
    shapes = {
        "rate": (3,),
        "force": (3,),
        "sample": (6,),
        "z": (6,),
        "weight": (6,),
        "residual": (6,),
        "K": (6, n_state),
        "covariance_scratch": (9, n_state),
        "h": (6, max(1, n_entry)),
    }
    return ImuSampleWork(**zeros_of(shapes, lanes))


@jit
def begin_motion(motion, samples):
    """Set the estimated motion to zero, and the last sample to the first true sample."""
    if samples is not None:
        for i in range(3):
            motion.rate[i] = number_like(motion.rate[0], 0.0)
            motion.force[i] = number_like(motion.rate[0], 0.0)
            motion.sample[i] = number_like(motion.rate[0], samples.rate[0, i])
            motion.sample[3 + i] = number_like(motion.rate[0], samples.force[0, i])


@jit
def store_last_sample(work, motion, samples, n_tick, dt):
    """Store the last sample of a window, as the IMU outputs it."""
    if samples is not None:
        for i in range(N_SAMPLE):
            motion.sample[i] = work.increments[n_tick - 1, i] / dt


@jit
def correct_vehicle(work, motion, model, vehicle):
    """Feed back the errors of the estimated motion and of the IMU's parameters, open loop or closed."""
    if vehicle is not None:
        correct_parameters(work, model)
        for b in range(model.par_offset.shape[0]):
            for i in range(3):
                work.x[model.par_offset[b] + i] = number_like(work.x[0], 0.0)
        for i in range(6):
            estimate = motion.rate if i < 3 else motion.force
            state = vehicle.motion + i
            estimate[i % 3] = estimate[i % 3] + work.x[state]
            work.x[state] = number_like(work.x[0], 0.0)


@inline_jit
def correct_tick(work, optional_state, case):
    """Add the error state to the estimates after a tick. An open loop corrects motion and IMU parameters only."""
    correct_vehicle(work, optional_state.motion, case.model, case.options.vehicle)
    _correct_closed(work, optional_state.previous_epoch, optional_state.open_loop, case.options.differences, case.model)


@jit
def _correct_closed(work, previous_epoch, open_loop, differences, model):
    if open_loop is None:
        correct_motion(work.nav, work.x)
        correct_receiver(work, model)
        correct_previous_epoch(work.x, previous_epoch, differences, model)
        for i in range(model.n_state):
            work.x[i] = number_like(work.x[0], 0.0)


@inline_jit
def predict_samples(run, work, motion, vehicle, tick, dt):
    """Set `motion.z` to the sample minus its prediction, and `motion.h` to the Jacobian.

    The prediction is the estimated motion plus the errors by the estimated IMU parameters.

    Parameters
    ----------
    run : number of the run; None in linear covariance, which has no sample
    tick : tick of the window
    dt : s, of a tick
    """
    if run is not None:
        fill_samples(motion.h, vehicle.blocks, motion.rate, motion.force)
        for i in range(3):
            for sensor in range(2):
                r = 3 * sensor + i
                prediction = motion.rate[i] if sensor == 0 else motion.force[i]
                for k in range(vehicle.blocks.shape[1]):
                    b = vehicle.blocks[sensor, k, 0]
                    if b >= 0:
                        parameter_error = motion.h[r, 1 + k] * work.par[b, i]
                        prediction = prediction + parameter_error
                sample = work.increments[tick, r] / dt
                motion.sample[r] = sample
                motion.z[r] = sample - prediction


@inline_jit
def mechanise_motion(work, motion, case, tick):
    """Integrate the strapdown over a tick with the estimated motion in place of the measured increments."""
    for i in range(3):
        work.increments[0, i] = case.tick * motion.rate[i]
        work.increments[0, 3 + i] = case.tick * motion.force[i]
    mechanise(work.nav, work.sums, work.previous, work.increments, 1, case.tick, case.model.strapdown, case.tick * tick)


@jit
def advance_open_loop(open_loop, x, sums, dt, motion):
    """Propagate the error state x (n,) of an open loop (OpenLoop, or None) over a tick."""
    if open_loop is not None:
        advance_vector(x, sums, dt, motion)
