"""Correlated measurement errors: random errors that last, or that several measurements share."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.records import Floats


class CorrelatedError(NamedTuple):
    """Random errors of one cause that last, or that several measurements share.

    Each label is an error of its own: a constant, a Gauss-Markov process, or a new draw at every epoch.

    source : Physical cause.
    kind : Kind of the error, as in `partials`; source, kind and label together address the random draws.
    sigma : SI. Standard deviation.
    field : Field of a sensor's card that states sigma, and of its filter model that assumes one.
    time_constant : s. Infinite for a constant, 0 for an error that is new at every epoch.
    labels : Label of each error: a satellite, a system, an axis; empty for one error alone.
    partial : Of a sensor: function of the flight that returns the derivative (n_epoch, n_scalar, n_label) of the
        scalars by the errors; None: one error, added to all scalars. What measures satellites has it by `kind`.
    state : Extra state of the filter that stands for it; empty: none.
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
        """Return the derivative (n_epoch, n_scalar, n_label) of a sensor's scalars by the errors, along a flight."""
        shape = (flight.t.size, n_scalar, len(self.labels))
        return np.ones(shape) if self.partial is None else np.broadcast_to(self.partial(flight), shape)
