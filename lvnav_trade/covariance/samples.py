"""Expected innovations of IMU samples as measurements."""

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.vehicle import N_SAMPLE


@jit
def expected_of_samples(true, ticks, motion, vehicle):
    """Return the expected sum of squares of the normalised innovations of the samples of the last tick.

    Parameters
    ----------
    true : Components
    ticks : SampleScratch, with mean innovation and innovation covariance by source
    motion : Motion, with P h' and weights of the filter's sequential update
    vehicle : VehicleModel
    """
    S, T, h, columns, total = ticks.expected, ticks.turned, motion.h, vehicle.columns, 0.0
    for r in range(N_SAMPLE):
        for q in range(N_SAMPLE):
            T[r, q] = 1.0 if q == r else 0.0
            S[r, q] = ticks.seen[r] * ticks.seen[q]
            for source in range(true.group.shape[0]):
                S[r, q] += ticks.S[true.group[source], r, q, true.lane[source]]
    # samples are processed in sequence: innovation r is T_r z, with T_r = e_r - sum over q < r of h_r K_q weight_q T_q
    for r in range(N_SAMPLE):
        for q in range(r):
            seen = 0.0
            for k in range(columns.shape[1]):
                seen += h[r, k] * motion.K[q, columns[r, k]]
            factor = seen * motion.weight[q]
            for k in range(N_SAMPLE):
                T[r, k] -= factor * T[q, k]
        value = 0.0
        for k in range(N_SAMPLE):
            for q in range(N_SAMPLE):
                value += T[r, k] * S[k, q] * T[r, q]
        total += value * motion.weight[r]
    return total
