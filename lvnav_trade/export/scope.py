"""Cases whose filter can be handed over: what decides ahead of the filter is not part of it."""

from lvnav_trade.engines.setup.prepare import Prepared
from lvnav_trade.errors import InputError


def refuse_redundant_imus(prepared: Prepared) -> None:
    """Raise InputError where redundant IMUs are tested ahead of the filter, which is informed of what is excluded."""
    units = prepared.options.units
    if units is not None and units.redundant is not None:
        raise InputError("redundant inertial units are tested before the filter: what decides of them is not exported")
