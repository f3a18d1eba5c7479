"""What linear covariance expects of a filter: normalised errors squared, innovations that its gate rejects."""

import numpy as np
from scipy.special import chdtrc

from lvnav_trade.records import Floats


def expected_nees(formal: Floats, total: Floats) -> Floats:
    """Return tr(formal^-1 total) of each history time (n_hist,); NaN where the filter is certain of a state.

    Both (n_hist, m, m) are brought to the filter's sigmas first: states differ by ten orders of magnitude.
    """
    sigma = np.sqrt(np.diagonal(formal, axis1=1, axis2=2))
    sound = np.all(sigma > 0.0, axis=1)
    scale = sigma[sound, :, None] * sigma[sound, None, :]
    expected = np.full(len(formal), np.nan)
    expected[sound] = np.trace(np.linalg.solve(formal[sound] / scale, total[sound] / scale), axis1=1, axis2=2)
    return expected


def false_rejection(gate_squared: float, ratio: Floats) -> Floats:
    """Return the probability (n_epoch,) that the gate rejects a good measurement, of the epoch's most endangered row.

    A row's normalised innovation is normal with the expected square `ratio` (n_epoch, n_row); a matched filter has 1.
    """
    worst = ratio.max(axis=1, initial=1e-300)
    return chdtrc(1, gate_squared / worst) if np.isfinite(gate_squared) else np.zeros_like(worst)
