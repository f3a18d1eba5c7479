"""Check whether the filter of a case can be exported: decisions made ahead of the filter are not part of it."""

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.simulation.preparation.prepare import PreparedCase


def refuse_redundant_imus(prepared_case: PreparedCase) -> None:
    """Raise an InputError if redundant IMUs are tested ahead of the filter, which then receives the exclusions."""
    units = prepared_case.options.imu_array
    if units is not None and units.redundant is not None:
        raise InputError("redundant IMUs are tested before the filter, and this test is not exported")
