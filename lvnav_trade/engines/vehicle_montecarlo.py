"""Runs with an attitude reference: arrays of one run or of eight, and `fly_vehicle` on them."""

from __future__ import annotations

from typing import Any

import numpy as np

from lvnav_trade.engines.inputs import Work
from lvnav_trade.engines.prepare import Prepared
from lvnav_trade.engines.vehicle_flight import Own, fly_vehicle, own_shapes
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import aligned_zeros, view
from lvnav_trade.kernels.vector import WIDTH


@jit
def fly_vehicle_lanes(
    w: Any, o: Any, schedule: Any, unit: Any, signals: Any, start: Any, history: Any, belief: Any, vehicle: Any,
    k0: Any, k1: Any,
) -> None:  # fmt: skip
    """Fly eight runs: `fly_vehicle` on lane views of arrays whose last axis is the runs."""
    work = Work(
        view(w.run), view(w.nav), view(w.sums), view(w.previous), view(w.increments), view(w.P), view(w.X), view(w.D),
        view(w.x), view(w.K), view(w.H), view(w.z), view(w.antenna), view(w.rate), view(w.true_par),
        view(w.true_tables), view(w.par), view(w.tables), view(w.remainder), view(w.clock), view(w.clock_hat),
        view(w.shared), view(w.extra), view(w.ranges), view(w.solution), view(w.err), view(w.sigma), view(w.nees),
        view(w.nis), view(w.n_row), view(w.n_reject), view(w.innovation), view(w.failed), view(w.t_failed),
        view(w.told), view(w.ground), None, None, None, None,
    )  # fmt: skip
    own = Own(
        view(o.motion), view(o.sample), view(o.z), view(o.weight), view(o.residual), view(o.gain), view(o.moved),
        view(o.row),
    )  # fmt: skip
    fly_vehicle(work, own, schedule, unit, signals, start, history, belief, vehicle, k0, k1)


def fly(prepared: Prepared, work: Work, k0: np.uint64, k1: np.uint64, lanes: bool) -> Work:
    """Fly the runs that `work` is made for; return it filled, with the outputs of this kind of flight."""
    end = (WIDTH,) if lanes else ()
    shape = (prepared.t_hist.size, len(prepared.outputs), *end)
    work = work._replace(err=aligned_zeros(shape), sigma=aligned_zeros(shape))
    own = Own(**{name: aligned_zeros(one + end) for name, one in own_shapes(prepared.layout.n_state).items()})
    fixed = (prepared.schedule, prepared.unit, prepared.signals, prepared.start, prepared.record, prepared.belief)
    (fly_vehicle_lanes if lanes else fly_vehicle)(work, own, *fixed, prepared.vehicle, k0, k1)
    return work
