"""Sums of sinusoids: small rotation and displacement from the lines of a spectrum, and their time derivatives."""

import math

import numpy as np

from lvnav_trade.kernels.jit import array_jit, jit

N_WAVE = 15  # rotation vector, its rate, displacement, its rate, its acceleration, three each


@array_jit
def sum_of_waves(t, omega, turn, shift):
    """Return the sum over spectral lines of the real part of amplitude times exp(i omega t), and its derivatives.

    With the amplitude a + i b of a line: a cos(w t) - b sin(w t), its rate -w (a sin(w t) + b cos(w t)), its
    acceleration -w^2 (a cos(w t) - b sin(w t)).

    All times of a line come before the next line. The phase then grows in even steps. Sine and cosine of such phases
    take half of the time of phases in random order, presumably because the processor predicts their branches.

    Parameters
    ----------
    t : (n,) s
    omega : (k,) rad/s
    turn, shift : (k, 6) real and imaginary parts of the amplitudes of rotation vector (rad) and displacement (m)

    Returns
    -------
    (n, 15) rotation vector (rad), its rate (rad/s), displacement (m), velocity (m/s), acceleration (m/s^2)
    """
    sums = np.zeros((N_WAVE, t.size))
    cosine = np.empty(t.size)
    sine = np.empty(t.size)
    for k in range(omega.size):
        w = omega[k]
        for n in range(t.size):
            phase = w * t[n]
            cosine[n] = math.cos(phase)
            sine[n] = math.sin(phase)
        for axis in range(3):
            a = turn[k, axis]
            b = turn[k, axis + 3]
            if a != 0.0 or b != 0.0:  # most lines move one axis only
                _add_wave(sums[axis], sums[axis + 3], a, b, w, cosine, sine)
            a = shift[k, axis]
            b = shift[k, axis + 3]
            if a != 0.0 or b != 0.0:
                _add_wave(sums[axis + 6], sums[axis + 9], a, b, w, cosine, sine)
                _add_acceleration(sums[axis + 12], a, b, w, cosine, sine)
    return sums.T


@jit
def _add_wave(wave, rate, a, b, w, cosine, sine):
    """Add the wave of a line along an axis, and its rate, to sums.

    Parameters
    ----------
    wave, rate : (n,) sums
    a, b : real and imaginary part of the amplitude
    w : rad/s, angular frequency
    cosine, sine : (n,) of the phase w t
    """
    for n in range(cosine.size):
        in_phase = a * cosine[n] - b * sine[n]
        in_quadrature = a * sine[n] + b * cosine[n]
        wave[n] += in_phase
        rate[n] -= w * in_quadrature


@jit
def _add_acceleration(acceleration, a, b, w, cosine, sine):
    """Add the second derivative of the wave of a line along an axis to sums (n,); arguments as in `_add_wave`."""
    for n in range(cosine.size):
        in_phase = a * cosine[n] - b * sine[n]
        acceleration[n] -= w * w * in_phase
