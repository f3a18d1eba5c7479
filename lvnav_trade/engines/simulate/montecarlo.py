"""Monte Carlo: run_block(prepared, seed, first_run, n_run) -> RunBlock, eight runs at a time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numba import config

from lvnav_trade.engines.setup.inputs import Held, Misses, Sizes, Work, work_shapes
from lvnav_trade.engines.setup.prepare import Prepared, prepare
from lvnav_trade.engines.setup.recorded import values_of
from lvnav_trade.engines.simulate.flight import fly
from lvnav_trade.filters.feedforward import new_open_loop
from lvnav_trade.filters.late import N_PAST
from lvnav_trade.filters.monitor import Watch, new_watch
from lvnav_trade.filters.samples import new_motion
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import aligned_zeros, view
from lvnav_trade.kernels.random import seed_words
from lvnav_trade.kernels.vector import WIDTH
from lvnav_trade.receivers.base import N_STATE as N_RECEIVER
from lvnav_trade.receivers.base import new_receiver
from lvnav_trade.records import NO_CHANGES, WAITING, Floats, RunBlock


@jit
def fly_lanes(
    w: Any,
    schedule: Any,
    unit: Any,
    signals: Any,
    sensors: Any,
    start: Any,
    history: Any,
    model: Any,
    options: Any,
    k0: Any,
    k1: Any,
) -> None:
    """Fly eight runs: `fly` on lane views of arrays whose last axis is the runs."""
    fly(view(w), schedule, unit, signals, sensors, start, history, model, options, k0, k1)


def new_work(prepared: Prepared, lanes: bool) -> Work:
    """Return the arrays of one run, or of eight in lanes, zero."""
    model, signals = prepared.model, prepared.signals
    shapes = work_shapes(Sizes(
        n_state=prepared.layout.n_state,
        n_par=len(prepared.layout.parameters),
        n_true=prepared.unit.sigma.size,
        n_block=model.block_rows.size,
        n_tick=int(prepared.schedule.n_tick.max(initial=0)),
        n_hist=prepared.t_hist.size,
        n_epoch=prepared.t_epoch.size,
        n_slot=signals.used.shape[1],
        n_channel=len(prepared.channel_names),
        n_antenna=len(model.lever_arms),
        n_entry=model.entry.shape[1],
        n_shared=signals.shared.start.size,
        n_extra=model.extra_offset.size,
        n_row=prepared.n_row,
        n_out=len(prepared.outputs),
        n_sensor=len(prepared.devices),
    ))  # fmt: skip
    end = (WIDTH,) if lanes else ()
    arrays: dict[str, Any] = {
        name: aligned_zeros(shape + end, np.uint64 if name == "run" else np.float64) for name, shape in shapes.items()
    }
    options, n_lane = prepared.options, WIDTH if lanes else 0
    is_open = prepared.scenario.filter.feedback == "open"
    layout, sampled = prepared.layout, options.vehicle is not None or options.samples is not None
    n_entry = 0 if options.vehicle is None else options.vehicle.columns.shape[1]
    n_hist, n = prepared.t_hist.size, layout.n_state
    return Work(
        **arrays,
        rx=None if options.solver is None else new_receiver(n_lane, len(prepared.sky.names)),
        open_loop=new_open_loop(n, len(layout.parameters), model.extra_offset.size, n_lane) if is_open else None,
        past=None if options.late is None else aligned_zeros((options.late.n_ring + 1, N_PAST, *end)),
        watch=None
        if options.rules is None
        else new_watch(prepared.t_epoch.size, prepared.channels.n_receiver, prepared.n_row, n_lane),
        motion=new_motion(n, n_entry, n_lane) if sampled else None,
        held=None if options.report is None else Held(aligned_zeros((N_RECEIVER, *end)),
                                                      aligned_zeros((N_RECEIVER, N_RECEIVER, *end))),
        misses=None if options.misses is None else Misses(*(aligned_zeros((n_hist, n, *end)) for _ in range(2))),
    )  # fmt: skip


def _fly(prepared: Prepared, seed: int, runs: Floats, lanes: bool) -> Work:
    work = new_work(prepared, lanes)
    work.run[0] = runs if lanes else runs[0]
    chosen = np.flatnonzero(prepared.signals.shared.given)
    if chosen.size:
        values = values_of(prepared.recorded, seed, runs)
        work.shared[chosen] = values if lanes else values[:, 0]
    p = prepared
    fixed = (p.schedule, p.unit, p.signals, p.sensors, p.start, p.record, p.model, p.options)
    (fly_lanes if lanes else fly)(work, *fixed, *seed_words(seed))
    return work


def compile_kernels(prepared: Prepared) -> None:
    """Compile what flies runs (or load it from the cache) without flying any: a flight of no windows."""
    none = np.zeros(0, dtype=np.int64)
    grounded = prepared._replace(schedule=prepared.schedule._replace(
        first_tick=none, n_tick=none, length=none, epoch=none, hist=none
    ))  # fmt: skip
    _fly(grounded, 0, np.arange(WIDTH, dtype=np.uint64), not config.DISABLE_JIT)


def simulated(prepared: Prepared, seed: int, n_run: int) -> Iterator[Misses]:
    """Yield what the transition misses of runs 0 to n_run - 1, some runs at a time, runs on the first axis."""
    lanes = not config.DISABLE_JIT
    width = WIDTH if lanes else 1
    for first in range(0, n_run, width):
        work = _fly(prepared, seed, np.arange(first, first + width, dtype=np.uint64), lanes)
        runs = [np.moveaxis(array, -1, 0) if lanes else array[None] for array in work.misses]
        yield Misses(*(array[: n_run - first] for array in runs))


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
