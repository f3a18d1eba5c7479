"""Expected consistency of a filter by linear covariance: NEES, and false rejections by the gate."""

import numpy as np
from scipy.special import chdtrc

from lvnav_trade.quantities.records import Floats


def expected_nees(formal: Floats, total: Floats) -> Floats:
    """Return the expected NEES tr(formal^-1 total) at each history time, (n_hist,).

    It is NaN where a formal variance is zero. Both covariances are normalised by the formal sigmas first, because
    states differ by ten orders of magnitude.

    Parameters
    ----------
    formal
        (n_hist, m, m) SI squared. Covariance of the filter.
    total
        (n_hist, m, m) SI squared. Second moment of the true error.
    """
    sigma = np.sqrt(np.diagonal(formal, axis1=1, axis2=2))
    sound = np.all(sigma > 0.0, axis=1)
    scale = sigma[sound, :, None] * sigma[sound, None, :]
    expected = np.full(len(formal), np.nan)
    expected[sound] = np.trace(np.linalg.solve(formal[sound] / scale, total[sound] / scale), axis1=1, axis2=2)
    return expected


def false_rejection(gate_squared: float, ratio: Floats) -> Floats:
    """Return the largest probability, over the measurements of each epoch, that the gate rejects a valid measurement.

    A normalised innovation is normal, with the expected square `ratio` (n_epoch, n_row); in a matched filter it is 1.
    """
    worst = ratio.max(axis=1, initial=1e-300)
    return chdtrc(1, gate_squared / worst) if np.isfinite(gate_squared) else np.zeros_like(worst)
