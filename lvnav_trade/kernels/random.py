"""Keyed draws: a normal depends only on (seed, source, run, epoch, index), never on the order of drawing.

Counter-based generator Philox4x32-10 (Salmon et al., Parallel random numbers: as easy as 1, 2, 3, SC11) and the
Box-Muller transform, for one run or eight lanes. With 32 bits per word a normal is at most 6.8 sigma.
"""

import math
import zlib

import numpy as np

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import bits, from_bits, sqrt, to_float, where, word_like

_LOW = np.uint64(0xFFFFFFFF)
_32 = np.uint64(32)
_MULTIPLIER_0, _MULTIPLIER_1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_WEYL_0, _WEYL_1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_MANTISSA, _ONE_BITS = np.uint64(0x000FFFFFFFFFFFFF), np.uint64(0x3FF0000000000000)
_52, _30 = np.uint64(52), np.uint64(30)
_EIGHTH_TURN, _QUADRANTS = np.uint64(1 << 29), np.uint64(3)
_TWO_PI, _LN2 = 2.0 * math.pi, math.log(2.0)
_2M32 = 2.0**-32


def source_word(name: str) -> np.uint64:
    """Return the 32-bit word that identifies a named noise source in the counter of each draw."""
    return np.uint64(zlib.crc32(name.encode()))


def seed_words(seed: int) -> tuple[np.uint64, np.uint64]:
    """Return the two 32-bit key words of a campaign seed (0 <= seed < 2**64)."""
    low = seed & 0xFFFFFFFF
    high = (seed >> 32) & 0xFFFFFFFF
    return np.uint64(low), np.uint64(high)


@jit
def philox(c0, c1, c2, c3, k0, k1):
    """Return the four 32-bit output words (stored in 64 bits) of Philox4x32-10.

    Parameters
    ----------
    c0, c1, c2, c3 : words of the counter, 32 bits each, stored in 64 bits
    k0, k1 : words of the key, 32 bits each, see `seed_words`
    """
    for _ in range(10):
        # high and low words of two products are permuted over the counter; the key is a Weyl sequence
        p0 = (c0 & _LOW) * _MULTIPLIER_0
        p1 = (c2 & _LOW) * _MULTIPLIER_1
        c0 = (p1 >> _32) ^ c1 ^ k0
        c2 = (p0 >> _32) ^ c3 ^ k1
        c1 = p1 & _LOW
        c3 = p0 & _LOW
        k0 = (k0 + _WEYL_0) & _LOW
        k1 = (k1 + _WEYL_1) & _LOW
    return c0, c1, c2, c3


@jit
def log_unit(x):
    """Return the natural logarithm of a normal float64 in (0, 2), to 2 ulp (absolute 1e-16 near 1).

    The mantissa is taken between sqrt(1/2) and sqrt(2); 2 atanh((m - 1) / (m + 1)) by its series, remainder below
    1e-18.
    """
    word = bits(x)
    exponent = to_float(word >> _52) - 1023.0
    mantissa = from_bits((word & _MANTISSA) | _ONE_BITS)
    is_large = mantissa > 1.4142135623730951
    mantissa = where(is_large, 0.5 * mantissa, mantissa)
    exponent = where(is_large, exponent + 1.0, exponent)
    # 2 atanh(s) = 2 s + s z (2/3 + 2/5 z + 2/7 z^2 + ...), z = s^2
    s = (mantissa - 1.0) / (mantissa + 1.0)
    z = s * s
    series = 2.0 / 19.0 + z * (2.0 / 21.0)
    series = 2.0 / 15.0 + z * (2.0 / 17.0 + z * series)
    series = 2.0 / 11.0 + z * (2.0 / 13.0 + z * series)
    series = 2.0 / 7.0 + z * (2.0 / 9.0 + z * series)
    series = 2.0 / 3.0 + z * (2.0 / 5.0 + z * series)
    log_mantissa = 2.0 * s + s * z * series
    return exponent * _LN2 + log_mantissa


@jit
def cos_sin_turn(word):
    """Return cosine and sine of the angle word / 2**32 turns, absolute error below 3e-16.

    The two leading bits choose the quadrant; Taylor series on a quarter of a right angle, remainder below 1e-17.
    """
    quadrant = ((word + _EIGHTH_TURN) >> _30) & _QUADRANTS
    turn = to_float(word) * _2M32
    turn = where(turn >= 0.875, turn - 1.0, turn)
    q = to_float(quadrant)
    a = (turn - 0.25 * q) * _TWO_PI
    z = a * a
    # sin a = a - a^3/3! + ... - a^15/15!, cos a = 1 - a^2/2! + ... + a^16/16!
    s = -1.0 / 1307674368000.0 * z + 1.0 / 6227020800.0
    s = s * z - 1.0 / 39916800.0
    s = s * z + 1.0 / 362880.0
    s = s * z - 1.0 / 5040.0
    s = s * z + 1.0 / 120.0
    s = s * z - 1.0 / 6.0
    s = a + a * z * s
    c = 1.0 / 20922789888000.0 * z - 1.0 / 87178291200.0
    c = c * z + 1.0 / 479001600.0
    c = c * z - 1.0 / 3628800.0
    c = c * z + 1.0 / 40320.0
    c = c * z - 1.0 / 720.0
    c = c * z + 1.0 / 24.0
    c = 1.0 + z * (z * c - 0.5)
    is_odd = (q == 1.0) | (q == 3.0)
    cosine = where(is_odd, s, c)
    sine = where(is_odd, c, s)
    is_negative = (q == 1.0) | (q == 2.0)
    cosine = where(is_negative, -cosine, cosine)
    sine = where(q >= 2.0, -sine, sine)
    return cosine, sine


@jit
def normals(k0, k1, source, run, epoch, index):
    """Return four independent standard normals of a named source at an epoch.

    Parameters
    ----------
    k0, k1 : key words of the seed, see `seed_words`
    source : word of the source, see `source_word`
    run : number of the run, a word or eight lanes
    epoch : number of the epoch or tick, a word
    index : distinguishes draws of the same epoch (satellite, group of axes), a word
    """
    epoch_word = word_like(run, epoch)
    name_word = word_like(run, source)
    index_word = word_like(run, index)
    w0, w1, w2, w3 = philox(epoch_word, run, name_word, index_word, k0, k1)
    # Box-Muller: sqrt(-2 ln u) cos(2 pi v) and sqrt(-2 ln u) sin(2 pi v), with u in (0, 1)
    u = (to_float(w0) + 0.5) * _2M32
    radius = sqrt(-2.0 * log_unit(u))
    cosine, sine = cos_sin_turn(w1)
    n0 = radius * cosine
    n1 = radius * sine
    u = (to_float(w2) + 0.5) * _2M32
    radius = sqrt(-2.0 * log_unit(u))
    cosine, sine = cos_sin_turn(w3)
    n2 = radius * cosine
    n3 = radius * sine
    return n0, n1, n2, n3
