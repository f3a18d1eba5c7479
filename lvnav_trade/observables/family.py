"""The family of sensors beside the receiver, for the kernels: one number and one line of each dispatch for a member.

A sensor measures up to three scalars at an epoch. Its truth at the epoch is four numbers, whatever they are.
"""

from __future__ import annotations

from lvnav_trade.kernels.jit import inlined
from lvnav_trade.observables import altitude, attitude

ALTIMETER, ATTITUDE_REFERENCE = range(2)
N_TRUTH, MOST = 4, 3
"""Numbers of a sensor's truth at an epoch; most scalars that a sensor measures at once."""


@inlined
def observe(out, code, truth, e0, e1, e2):
    """Set what a sensor measures.

    out : (4,) set; code : the member's number; truth : (4,) at the epoch; e0, e1, e2 : errors of its scalars, SI
    """
    if code == ALTIMETER:
        altitude.measure(out, truth, e0)
    elif code == ATTITUDE_REFERENCE:
        attitude.measure(out, truth, e0, e1, e2)


@inlined
def fill(H, z, at, code, observed, nav):
    """Set the Jacobian rows of a sensor, from row `at` on, and measured minus predicted.

    H : (n, n_entry), z : (n,) updated; observed : (4,) of `observe`; nav : (10,) navigation state, frame i
    """
    if code == ALTIMETER:
        z[at] = observed[0] - altitude.row(H[at], nav)
    elif code == ATTITUDE_REFERENCE:
        attitude.fill(H, z, at, observed, nav)
