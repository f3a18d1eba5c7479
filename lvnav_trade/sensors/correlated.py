"""Correlated measurement errors: random errors correlated over time, or between measurements."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.quantities.records import Floats


class CorrelatedError(NamedTuple):
    """Random errors with a common cause, correlated over time or between measurements.

    The errors of different labels are independent. Each is a constant, a Gauss-Markov process, or a new draw at every
    epoch.

    source : Physical cause.
    kind : Kind of the error, as in `partials`; source, kind and label together address the random draws.
    sigma : SI. Standard deviation.
    field : Field of the sensor's card for sigma, and of the filter model for the assumed sigma.
    time_constant : s. Infinite for a constant, 0 for an error that is new at every epoch.
    labels : Label of each error: a satellite, a system, an axis; empty for a single error.
    partial : Function of the flight that returns the derivative (n_epoch, n_scalar, n_label) of a sensor's scalars by
        the errors; None: a single error, added to all scalars. Measurements of satellites use `partials.partial`.
    state : Extra state of the filter that models it; empty: none.
    """

    source: str
    kind: str
    sigma: float
    field: str
    time_constant: float
    labels: tuple[str, ...] = ("",)
    partial: Callable[[Any], Floats] | None = None
    state: str = ""

    def partials(self, flight: Any, n_scalar: int) -> Floats:
        """Return the derivative (n_epoch, n_scalar, n_label) of a sensor's scalars by the errors along a flight."""
        shape = (flight.t.size, n_scalar, len(self.labels))
        return np.ones(shape) if self.partial is None else np.broadcast_to(self.partial(flight), shape)
