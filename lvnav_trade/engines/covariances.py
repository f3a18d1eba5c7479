"""Linear covariance of a case of any kind: covariance(prepared) -> CovHistory."""

from __future__ import annotations

from lvnav_trade.engines import lincov, reported, vehicle_lincov
from lvnav_trade.engines.prepare import Prepared
from lvnav_trade.records import CovHistory


def covariance(prepared: Prepared) -> CovHistory:
    """Return the filter's own and the true covariance of a case over its nominal flight, the true one by source."""
    if prepared.vehicle is not None:
        return vehicle_lincov.covariance(prepared)
    return reported.beside_covariance(prepared, lincov.covariance(prepared))
