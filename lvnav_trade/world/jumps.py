"""Jumps of the specific force in the rows of a file: where an event is probably missing, as YAML to paste."""

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from lvnav_trade.records import Floats

_SIDE = 3  # intervals on each side of a jump, through which the force is a straight line
_SMALLEST = 1.0  # m/s^2; a fairing or a throttled engine may make less and is no reason to ask
_SIGNIFICANT = 10.0  # sigmas of an interval's force that a jump must exceed; two extrapolated lines differ by 2.2
_BURIED = 1.6  # of that limit, up to which noise may bend the lines beside a jump too far
_STRAIGHT = 0.15  # of the jump by which the force may leave the lines beside it: ramps and single wrong rows do more
_FLAT = 0.5  # of the jump by which those lines may rise or fall
_COAST = 0.25  # of the force on the other side of a jump, below which an engine is taken for off
_NEAR = 0.5  # s, and two intervals: an event that is declared so close to a jump is that of the jump


class Jump(NamedTuple):
    """A jump of the specific force at `time` (s), from `before` to `after` (m/s^2), in an interval of `width` s."""

    time: float
    before: float
    after: float
    width: float


def force_jumps(t: Floats, force: Floats, coarsest: float, noise: Floats | float = 0.0) -> list[Jump]:
    """Return the jumps of a force in order of time.

    t (n + 1,): rising times in s; force (n,): mean specific force (m/s^2) over each interval; noise: one sigma (m/s) of
    the velocities that it comes from, at each time or at all, as far as known. What noise may explain is no jump:
    intervals are joined two by two, up to `coarsest` s, for jumps that the noise of shorter ones hides.
    """
    found: list[Jump] = []
    stated, hidden = np.broadcast_to(noise, t.shape), np.full(force.shape, np.inf)
    while force.size > 2 * _SIDE:
        width = np.diff(t)
        limit = np.maximum(
            _SMALLEST, _SIGNIFICANT * np.maximum(_noise(force), np.hypot(stated[1:], stated[:-1]) / width)
        )
        near = _SIDE * np.median(width)
        new = _separate(t, force, limit, hidden)
        found += [jump for jump in new if all(abs(jump.time - one.time) > near for one in found)]
        if 2.0 * np.median(width) > coarsest or np.all(limit <= _SMALLEST):
            break
        n = force.size // 2
        missed = np.where(limit > _SMALLEST, _BURIED * limit, 0.0)
        hidden = np.minimum(missed[: 2 * n : 2], missed[1 : 2 * n : 2])
        gained = (force * width)[: 2 * n].reshape(n, 2).sum(axis=1)
        t, stated = t[: 2 * n + 1 : 2], stated[: 2 * n + 1 : 2]
        force = gained / np.diff(t)
    return sorted(found, key=lambda jump: jump.time)


def _noise(force: Floats) -> float:
    """Return one sigma of the force of an interval, from what neighbours do not share; few jumps do not count."""
    return float(np.median(np.abs(np.diff(force, 2)))) / (0.6745 * math.sqrt(6.0))


def _separate(t: Floats, force: Floats, limit: Floats, hidden: Floats) -> Iterator[Jump]:
    """Yield the jumps from `limit` to `hidden` (n,) m/s^2 of an interval, the clearest first, none within the lines
    beside another.
    """
    level, slope, middle, off = _lines(0.5 * (t[1:] + t[:-1]), force)
    k = np.arange(_SIDE, force.size - _SIDE)
    first, second = k - _SIDE, k + 1  # the lines before and after an interval
    before, after = (level[j] + slope[j] * (t[[k, k + 1]] - middle[j]) for j in (first, second))  # at both ends
    apart = after - before
    size, worst = np.min(np.abs(apart), axis=0), np.maximum(off[first], off[second])
    span = np.mean(before, axis=0) - np.mean(after, axis=0)
    part = (force[k] - np.mean(after, axis=0)) / np.where(span == 0.0, 1.0, span)  # of the interval before the jump
    clear = (apart[0] * apart[1] > 0.0) & (worst <= _STRAIGHT * size) & (np.abs(part - 0.5) <= 0.6)
    clear &= (size > limit[k]) & (size <= hidden[k])  # two lines that meet within the interval are a bend
    drift = _SIDE * (t[k + 1] - t[k]) * np.maximum(np.abs(slope[first]), np.abs(slope[second]))
    clear &= drift <= _FLAT * size  # wrong rows may make a straight line too, a steep one
    score = np.where(clear, size - 3.0 * worst, 0.0)
    while score.size and np.max(score) > 0.0:
        j = int(np.argmax(score))
        begin, end = t[k[j]], t[k[j] + 1]
        time = begin + min(max(float(part[j]), 0.0), 1.0) * (end - begin)
        yield Jump(float(time), float(before[0, j]), float(after[1, j]), float(end - begin))
        score[max(j - _SIDE, 0) : j + _SIDE + 1] = 0.0


def _lines(t: Floats, force: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the straight lines through `_SIDE` forces in a row, at times t (n,): level at their mean time, slope, that
    time, and the most by which a force is off, each (n - _SIDE + 1,).
    """
    at, of = (np.lib.stride_tricks.sliding_window_view(one, _SIDE) for one in (t, force))
    middle, level = at.mean(axis=1), of.mean(axis=1)
    far, rise = at - middle[:, None], of - level[:, None]
    slope = np.sum(far * rise, axis=1) / np.sum(far**2, axis=1)
    return level, slope, middle, np.max(np.abs(rise - slope[:, None] * far), axis=1)


def suggested_events(
    t: Floats, force: Floats, declared: Mapping[str, float], coarsest: float, noise: Floats | float = 0.0
) -> dict[str, str]:
    """Return names and times of the events that jumps of a force suggest and a card does not declare.

    Arguments as of `force_jumps`; declared: times (s) of the events by name. A force that ends is named a cut-off of
    the stage in turn, one that begins an ignition of the next; other steps are named by their sense.
    """
    found: dict[str, str] = {}
    stage, counts = 1, {"rise": 0, "fall": 0}
    for jump in force_jumps(t, force, coarsest, noise):
        if abs(jump.after) < _COAST * abs(jump.before):
            name = f"stage{stage}_cutoff"
            stage += 1
        elif abs(jump.before) < _COAST * abs(jump.after):
            name = f"stage{stage}_ignition"
        else:
            sense = "rise" if jump.after > jump.before else "fall"
            counts[sense] += 1
            name = f"{sense}_{counts[sense]}"
        near = _NEAR + 2.0 * jump.width
        if all(abs(jump.time - time) > near for time in declared.values()):
            digits = max(0, 1 - math.floor(math.log10(jump.width)))
            found[name] = f"{jump.time:.{digits}f} s"
    return found


def missing_events(
    t: Floats, force: Floats, declared: Mapping[str, float], coarsest: float, noise: Floats | float = 0.0
) -> str:
    """Return `suggested_events` as YAML; empty where there are none."""
    found = suggested_events(t, force, declared, coarsest, noise)
    if not found:
        return ""
    events = ", ".join(f"{name}: {time}" for name, time in found.items())
    return f"the specific force jumps where no event is declared; as YAML: events: {{{events}}}"
