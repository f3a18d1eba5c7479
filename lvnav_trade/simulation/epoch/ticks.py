"""IMU samples as measurements, tick by tick: in a run, or in the joint covariance."""

from lvnav_trade.filter.policies.imu_samples import advance_open_loop, correct_tick, mechanise_motion, predict_samples
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.vehicle import N_SAMPLE, advance, mirror, update_samples
from lvnav_trade.simulation.epoch.joint_ticks import (
    advance_joint,
    begin_tick,
    finish_ticks,
    nominal_tick,
    update_joint_tick,
)


@inlined
def _run_tick(run, work, parts, case, tick):
    """Correct the estimates of a run (run number, or None) after a tick, and integrate the estimated motion."""
    if run is not None:
        correct_tick(work, parts, case)
        mechanise_motion(work, parts.motion, case, tick)


@jit
def _joint_tick(joint, flight, work, motion, case, tick):
    """Update the joint covariance (Joint, or None) by the samples of a tick, and set the integrals over the tick."""
    if joint is not None:
        options = case.options
        update_joint_tick(joint, flight, motion, case.model, options.vehicle, options.units, tick)
        nominal_tick(work.sums, flight.reference, tick, case.tick)


@inlined
def sample_window(work, parts, case, joint, flight, w):
    """Update by the IMU samples of window w, tick by tick, and propagate the estimated motion over each tick.

    Slow effects (gravity gradient, decay, clock) are propagated at the end of the window, see `filter.model`.

    Parameters
    ----------
    work, parts, case : as in `process.process_epoch`
    joint, flight : Joint and NominalFlight of linear covariance, where samples are as predicted; None in a run
    w : window
    """
    vehicle, motion, first = case.options.vehicle, parts.motion, case.schedule.first_tick[w]
    at = vehicle.motion
    for k in range(case.schedule.n_tick[w]):
        predict_samples(parts.run, work, motion, vehicle, k, case.tick)
        begin_tick(joint, motion, vehicle, first + k)
        for i in range(N_SAMPLE):
            work.P[at + i, at + i] = work.P[at + i, at + i] + vehicle.walk[first + k, i]
        update_samples(
            work.P,
            work.x,
            motion.K,
            motion.weight,
            motion.residual,
            motion.z,
            vehicle.variance,
            motion.h,
            vehicle.columns,
            case.model.n_estimated,
        )
        _run_tick(parts.run, work, parts, case, first + k)
        _joint_tick(joint, flight, work, motion, case, first + k)
        advance(work.P, motion.moved, work.sums, case.tick, at)
        advance_open_loop(parts.open_loop, work.x, work.sums, case.tick, at)
        advance_joint(joint, flight, work.sums, case.tick, at)
    mirror(work.P)
    finish_ticks(joint)
