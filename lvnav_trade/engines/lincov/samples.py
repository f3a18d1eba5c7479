"""Expected innovations of the IMU's samples, where they are measurements."""

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.vehicle import N_SAMPLE


@jit
def expected_of_samples(true, ticks, motion, vehicle):
    """Return the expected sum of squares of the normalised innovations of the last tick's samples."""
    S, T, h, columns, total = ticks.expected, ticks.turned, motion.h, vehicle.columns, 0.0
    for r in range(N_SAMPLE):
        for q in range(N_SAMPLE):
            T[r, q] = 1.0 if q == r else 0.0
            S[r, q] = ticks.seen[r] * ticks.seen[q]
            for source in range(true.group.shape[0]):
                S[r, q] += ticks.S[true.group[source], r, q, true.lane[source]]
    # samples are processed one after the other: innovation r is T_r z with what those before it have taken off
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
