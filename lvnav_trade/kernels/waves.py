"""Sums of sinusoids: a small rotation and displacement as many lines of a spectrum make it, and their derivatives."""

import math

import numpy as np

from lvnav_trade.kernels.jit import making_arrays

N_WAVE = 15  # rotation vector, its rate, displacement, its rate, its acceleration, three each


@making_arrays
def sum_of_waves(t, omega, turn, shift):
    """Return the real part of sums over lines of amplitude times exp(i omega t), and derivatives in time, (n, 15).

    Parameters
    ----------
    t : (n,) s
    omega : (k,) rad/s
    turn, shift : (k, 6) real and imaginary parts of the amplitudes of rotation vector (rad) and displacement (m)
    """
    out = np.zeros((t.size, 15))
    for n in range(t.size):
        for k in range(omega.size):
            w = omega[k]
            c, s = math.cos(w * t[n]), math.sin(w * t[n])
            for axis in range(3):
                a, b = turn[k, axis], turn[k, axis + 3]
                out[n, axis] += a * c - b * s
                out[n, axis + 3] -= w * (a * s + b * c)
                a, b = shift[k, axis], shift[k, axis + 3]
                out[n, axis + 6] += a * c - b * s
                out[n, axis + 9] -= w * (a * s + b * c)
                out[n, axis + 12] -= w * w * (a * c - b * s)
    return out
