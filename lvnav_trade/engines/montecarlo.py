"""Monte Carlo: run_block(prepared, seed, first_run, n_run) -> RunBlock, eight runs at a time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import config

from lvnav_trade.engines import vehicle, vehicle_montecarlo
from lvnav_trade.engines.flight import fly
from lvnav_trade.engines.inputs import Sizes, Work, work_shapes
from lvnav_trade.engines.prepare import Prepared, prepare
from lvnav_trade.engines.recorded import values_of
from lvnav_trade.filters.belief import LOOSE, TIGHT
from lvnav_trade.filters.feedforward import lanes_of_aside, new_aside
from lvnav_trade.filters.late import N_PAST
from lvnav_trade.filters.monitor import Watch, lanes_of_watch, new_watch
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import aligned_zeros, view
from lvnav_trade.kernels.random import seed_words
from lvnav_trade.kernels.vector import WIDTH
from lvnav_trade.receivers.base import lanes_of, new_receiver
from lvnav_trade.records import NO_CHANGES, WAITING, Floats, RunBlock


@jit
def _view_of(array: Any) -> Any:
    """Return a lane view of an array, or None where there is none."""
    if array is None:
        return None
    return view(array)


@jit
def fly_lanes(
    w: Any,
    schedule: Any,
    unit: Any,
    signals: Any,
    start: Any,
    history: Any,
    belief: Any,
    options: Any,
    k0: Any,
    k1: Any,
) -> None:
    """Fly eight runs: `fly` on lane views of arrays whose last axis is the runs."""
    work = Work(
        view(w.run), view(w.nav), view(w.sums), view(w.previous), view(w.increments), view(w.P), view(w.X), view(w.D),
        view(w.x), view(w.K), view(w.H), view(w.z), view(w.antenna), view(w.rate), view(w.true_par),
        view(w.true_tables), view(w.par), view(w.tables), view(w.remainder), view(w.clock), view(w.clock_hat),
        view(w.shared), view(w.extra), view(w.ranges), view(w.solution), view(w.err), view(w.sigma), view(w.nees),
        view(w.nis), view(w.n_row), view(w.n_reject), view(w.innovation), view(w.failed), view(w.t_failed),
        view(w.told), view(w.ground), lanes_of(w.rx), lanes_of_aside(w.aside), lanes_of_watch(w.watch),
        _view_of(w.past),
    )  # fmt: skip
    fly(work, schedule, unit, signals, start, history, belief, options, k0, k1)


def channels(prepared: Prepared) -> int:
    """Return how many innovation channels a case has: two per satellite when tight, six when loose, and those of an
    attitude reference and of the inertial unit.
    """
    if prepared.vehicle is not None:
        return len(vehicle.CHANNELS)
    kind = prepared.belief.kind
    height = int(prepared.options.altimeter is not None)
    return height + 2 * len(prepared.sky.names) if kind == TIGHT else height + 6 if kind == LOOSE else 1


def new_work(prepared: Prepared, lanes: bool) -> Work:
    """Return the arrays of one run, or of eight in lanes, zero."""
    belief, signals = prepared.belief, prepared.signals
    shapes = work_shapes(Sizes(
        n_state=prepared.layout.n_state,
        n_par=len(prepared.layout.parameters),
        n_true=prepared.unit.sigma.size,
        n_block=belief.block_rows.size,
        n_tick=int(prepared.schedule.n_tick.max(initial=0)),
        n_hist=prepared.t_hist.size,
        n_epoch=prepared.t_epoch.size,
        n_slot=signals.used.shape[1],
        n_channel=channels(prepared),
        n_antenna=len(belief.levers),
        n_entry=belief.entry.shape[1],
        n_shared=signals.shared.start.size,
        n_extra=belief.extra_offset.size,
    ))  # fmt: skip
    end = (WIDTH,) if lanes else ()
    arrays: dict[str, Any] = {
        name: aligned_zeros(shape + end, np.uint64 if name == "run" else np.float64) for name, shape in shapes.items()
    }
    options, n_lane = prepared.options, WIDTH if lanes else 0
    is_open = prepared.scenario.filter.feedback == "open"
    return Work(
        **arrays,
        rx=None if options.solver is None else new_receiver(n_lane),
        aside=new_aside(prepared.layout.n_state, n_lane) if is_open else None,
        past=None if options.late is None else aligned_zeros((N_PAST, *end)),
        watch=None if options.rules is None else new_watch(prepared.t_epoch.size, n_lane),
    )


def _fly(prepared: Prepared, seed: int, runs: Floats, lanes: bool) -> Work:
    work = new_work(prepared, lanes)
    work.run[0] = runs if lanes else runs[0]
    chosen = np.flatnonzero(prepared.signals.shared.given)
    if chosen.size:
        values = values_of(prepared.recorded, seed, runs)
        work.shared[chosen] = values if lanes else values[:, 0]
    p = prepared
    if p.vehicle is not None:
        return vehicle_montecarlo.fly(p, work, *seed_words(seed), lanes)
    fixed = (p.schedule, p.unit, p.signals, p.start, p.record, p.belief, p.options)
    (fly_lanes if lanes else fly)(work, *fixed, *seed_words(seed))
    return work


def compile_kernels(prepared: Prepared) -> None:
    """Compile what flies runs (or load it from the cache) without flying any: a flight of no windows."""
    none = np.zeros(0, dtype=np.int64)
    grounded = prepared._replace(schedule=prepared.schedule._replace(
        first_tick=none, n_tick=none, length=none, epoch=none, hist=none
    ))  # fmt: skip
    _fly(grounded, 0, np.arange(WIDTH, dtype=np.uint64), not config.DISABLE_JIT)


_HANDED_OUT = ("err", "sigma", "nees", "nis", "n_row", "n_reject", "innovation", "failed", "t_failed")


def run_block(prepared: Prepared, seed: int, first_run: int, n_run: int, lanes: bool | None = None) -> RunBlock:
    """Fly runs first_run to first_run + n_run - 1.

    A run's numbers depend on the seed and its own number only, not on the block it is in. Lanes step eight runs at
    once and agree with one run at a time to rounding; lanes None takes them where compiled code is available.
    """
    use_lanes = not config.DISABLE_JIT if lanes is None else lanes
    width = WIDTH if use_lanes else 1
    joined: dict[str, Floats] = {}
    changes = [NO_CHANGES]
    for done in range(0, n_run, width):
        first, new = first_run + done, min(width, n_run - done)
        work = _fly(prepared, seed, np.arange(first, first + width, dtype=np.uint64), use_lanes)
        for name in _HANDED_OUT:
            array = getattr(work, name)
            runs = np.moveaxis(array, -1, 0) if use_lanes else array[None]
            whole = joined.setdefault(name, np.empty((n_run, *runs.shape[1:])))
            whole[done : done + new] = runs[:new]
        if work.watch is not None:
            changes.append(_changes(prepared, work.watch, first, new, use_lanes))
    return RunBlock(
        first_run=first_run,
        t=prepared.t_hist,
        err=joined["err"],
        sigma=joined["sigma"],
        nees=joined["nees"],
        t_epoch=prepared.t_epoch,
        nis=joined["nis"],
        n_row=joined["n_row"].astype(np.int32),
        n_reject=joined["n_reject"].astype(np.int32),
        innovation=joined["innovation"],
        failed=joined["failed"][:, 0].astype(np.int8),
        t_failed=joined["t_failed"][:, 0],
        changes=np.concatenate(changes),
    )


def _changes(prepared: Prepared, watch: Watch, first_run: int, n_run: int, lanes: bool) -> Floats:
    """Return the changes (n, 5) of what the filters of some runs do: run, t, mode before, mode after, reason."""
    found = [NO_CHANGES]
    for k in range(n_run):
        mode, reason = (array[:, k] if lanes else array for array in (watch.mode, watch.reason))
        at = np.flatnonzero(reason)
        before = np.concatenate([[WAITING], mode[:-1]])
        run = np.full(at.size, first_run + k, dtype=float)
        found.append(np.stack([run, prepared.t_epoch[at], before[at], mode[at], reason[at]], axis=1))
    return np.concatenate(found)


def replay(prepared: Prepared, seed: int, run: int) -> RunBlock:
    """Fly one run again, bit for bit as in its block, with every covariance step recorded.

    The extra history times cut windows where the block had none only at the covariance steps themselves, so the run's
    numbers are those of the block.
    """
    return run_block(prepare(prepared.scenario, every_step_beside=prepared.t_hist), seed, run, 1)
