"""IMU samples in the results of linear covariance: expected innovations as measurements, and errors as outputs."""

from lvnav_trade.covariance.imu_array_errors import write_array_samples
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.transition import sensed_driver
from lvnav_trade.kernels.vehicle import N_SAMPLE


@jit
def expected_sample_nis(components, ticks, motion, vehicle):
    """Return the expected sum of squares of the normalised innovations of the samples of the last tick.

    Parameters
    ----------
    components : Components
    ticks : SampleScratch, with mean innovation and innovation covariance by source
    motion : ImuSampleWork, with P h' and weights of the filter's sequential update
    vehicle : VehicleModel
    """
    S = ticks.innovation_square
    T = ticks.sequence_matrix
    h = motion.h
    columns = vehicle.columns
    total = 0.0
    for r in range(N_SAMPLE):
        for q in range(N_SAMPLE):
            T[r, q] = 1.0 if q == r else 0.0
            S[r, q] = ticks.innovation_mean[r] * ticks.innovation_mean[q]
            for source in range(components.group.shape[0]):
                g = components.group[source]
                lane = components.lane[source]
                S[r, q] += ticks.S[g, r, q, lane]
    # samples are processed in sequence: innovation r is T_r z, with T_r = e_r - sum over q < r of h_r K_q weight_q T_q
    for r in range(N_SAMPLE):
        for q in range(r):
            projection = 0.0  # h_r K_q
            for k in range(columns.shape[1]):
                state = columns[r, k]
                projection += h[r, k] * motion.K[q, state]
            factor = projection * motion.weight[q]
            for k in range(N_SAMPLE):
                T[r, k] -= factor * T[q, k]
        square = 0.0  # expected square of innovation r, T_r S T_r'
        for k in range(N_SAMPLE):
            for q in range(N_SAMPLE):
                square += T[r, k] * S[k, q] * T[r, q]
        total += square * motion.weight[r]
    return total


@jit
def write_samples(results, hist, state, components, units, samples, tick, dt):
    """Write the error variance of IMU samples without their noise by source: raw, and corrected by the estimated bias.

    Parameters
    ----------
    results : PassResults, updated in place
    hist : history time
    state, components : JointCovariance, Components
    units : ImuArray, or None
    samples : ReportedSamples
    tick, dt : last tick; s, of a tick
    """
    _write_biases(results, hist, state, components, samples)
    if units is None:
        _write_components(results, hist, state, components, samples, tick)
    else:
        write_array_samples(results, hist, state, components, units, samples, tick, dt)


@jit
def _write_biases(results, hist, state, components, samples):
    for source in range(components.group.shape[0]):
        g = components.group[source]
        lane = components.lane[source]
        P = state.sources[g, ..., lane]
        for r in range(N_SAMPLE):
            bias = samples.bias[r]
            if bias >= 0:
                results.samples[hist, source, 6 + r] += P[bias, bias]


@jit
def _write_components(results, hist, state, components, samples, tick):
    """Add the variance of IMU error components to those of raw and corrected samples, for one IMU."""
    for j in range(components.sensor.shape[0]):
        sensor = components.sensor[j]
        driver = components.driver[j]
        if components.profile[j] >= 0 or driver < 0:
            continue
        u = sensed_driver(sensor, driver, samples.rate[tick], samples.force[tick])
        for axis in range(3):
            r = 3 * sensor + axis
            c = components.first[j] + axis
            source = components.source[c]
            k = components.slot[c]
            g = components.group[source]
            lane = components.lane[source]
            input_along = u[axis]
            variance = input_along * input_along * state.variance[g, k, 0, lane]
            results.samples[hist, source, r] += variance
            bias = samples.bias[r]
            first_pair = components.state_from[c]
            last_pair = components.state_from[c + 1]
            if bias < 0:
                results.samples[hist, source, 6 + r] += variance
            elif first_pair == last_pair or components.states[first_pair] != bias:
                # the error of the corrected sample is component plus bias error: their covariance counts twice
                covariance_term = 2.0 * input_along * state.cross[g, k, bias, lane]
                results.samples[hist, source, 6 + r] += variance + covariance_term
