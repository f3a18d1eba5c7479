"""Sums of sinusoids: small rotation and displacement from the lines of a spectrum, and their time derivatives."""

import math

import numpy as np

from lvnav_trade.kernels.jit import array_jit

N_WAVE = 15  # rotation vector, its rate, displacement, its rate, its acceleration, three each


@array_jit
def sum_of_waves(t, omega, turn, shift):
    """Return the sum over spectral lines of the real part of amplitude times exp(i omega t), and its derivatives.

    With the amplitude a + i b of a line: a cos(w t) - b sin(w t), its rate -w (a sin(w t) + b cos(w t)), its
    acceleration -w^2 (a cos(w t) - b sin(w t)).

    Parameters
    ----------
    t : (n,) s
    omega : (k,) rad/s
    turn, shift : (k, 6) real and imaginary parts of the amplitudes of rotation vector (rad) and displacement (m)

    Returns
    -------
    (n, 15) rotation vector (rad), its rate (rad/s), displacement (m), velocity (m/s), acceleration (m/s^2)
    """
    out = np.zeros((t.size, 15))
    for n in range(t.size):
        for k in range(omega.size):
            w = omega[k]
            phase = w * t[n]
            c = math.cos(phase)
            s = math.sin(phase)
            for axis in range(3):
                a = turn[k, axis]
                b = turn[k, axis + 3]
                in_phase = a * c - b * s
                in_quadrature = a * s + b * c
                out[n, axis] += in_phase
                out[n, axis + 3] -= w * in_quadrature
                a = shift[k, axis]
                b = shift[k, axis + 3]
                in_phase = a * c - b * s
                in_quadrature = a * s + b * c
                out[n, axis + 6] += in_phase
                out[n, axis + 9] -= w * in_quadrature
                out[n, axis + 12] -= w * w * in_phase
    return out
