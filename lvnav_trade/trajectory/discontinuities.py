"""Rows of a file that are not smooth: gaps in time, and jumps of the specific force where an event is missing."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.records import Floats

_MANY = 6.0  # times the longer neighbouring interval: above it an interval is a gap, below it a change of rate


class RowGap(NamedTuple):
    """A gap between two rows of a file.

    row : Index of the last row before the gap.
    start, end : s. Times of the rows before and after it.
    usual_interval : s. Longer of the intervals around it.
    """

    row: int
    start: float
    end: float
    usual_interval: float

    @property
    def length(self) -> float:
        """Length in s."""
        return self.end - self.start


def find_gaps(t: Floats) -> list[RowGap]:
    """Return the gaps between rising times t (n,) in s."""
    interval = np.diff(t)
    next_interval = np.append(interval[1:], 0.0)
    previous_interval = np.append(0.0, interval[:-1])
    neighbour = np.maximum(next_interval, previous_interval)
    is_gap = (interval > _MANY * neighbour) & (neighbour > 0.0)
    gaps = []
    for k in np.flatnonzero(is_gap).tolist():
        gap = RowGap(
            row=k,
            start=float(t[k]),
            end=float(t[k + 1]),
            usual_interval=float(neighbour[k]),
        )
        gaps.append(gap)
    return gaps


def bridged_gaps(
    t: Floats, required_end: float, longest: float, file: str, places: Sequence[str] = ()
) -> tuple[list[RowGap], RowGap | None]:
    """Return the gaps that a spline bridges, and the gap at which the data end.

    Parameters
    ----------
    t : (n,) s
        Rising times of the rows.
    required_end : float
        Time (s) up to which data are required. At a longer gap after it the data end.
    longest : float
        Longest gap (s) that a spline bridges.
    file : str
        Name of the file for messages.
    places : sequence of str
        Line of each row, for messages.

    Raises
    ------
    InputError
        A gap longer than `longest` begins before `required_end`.
    """
    gaps: list[RowGap] = []
    for gap in find_gaps(t):
        if gap.length <= longest:
            gaps.append(gap)
        elif gap.start >= required_end:
            return gaps, gap
        else:
            line = f":{places[gap.row + 1]}" if places else ""
            raise InputError(
                f"{file}{line}: no data between {gap.start:g} s and {gap.end:g} s, where the rows around are "
                f"{gap.usual_interval:.3g} s apart; at most {longest:g} s are bridged"
            )
    return gaps, None


def gap_remarks(gaps: Sequence[RowGap]) -> list[str]:
    """Return the remark on the gaps that a spline bridges; an empty list without gaps."""
    if not gaps:
        return []
    longest = max(gaps, key=lambda gap: gap.length)
    span = f"{longest.start:.6g} to {longest.end:.6g} s"
    if len(gaps) == 1:
        return [f"no data from {span}: a spline through the rows on both sides fills the hole"]
    return [
        f"{len(gaps)} holes without data, the longest from {span}: a spline through the rows on both sides fills them"
    ]


_SIDE = 3  # intervals on each side of a jump, to which a straight line is fitted
_SMALLEST = 1.0  # m/s^2; smaller jumps (a fairing, a throttled engine) are not reported
_SIGNIFICANT = 10.0  # threshold in sigmas of one interval's force; the difference of the two lines has 2.2 sigmas
_BURIED = 1.6  # of that threshold: up to this size noise may spoil the fit of a true jump
_STRAIGHT = 0.15  # of the jump: largest deviation from the lines; ramps and single wrong rows have more
_FLAT = 0.5  # of the jump: largest rise or fall of those lines
_COAST = 0.25  # of the force on the other side of a jump: below it the engine counts as off
_NEAR = 0.5  # s, plus two intervals: a declared event so close to a jump explains it


class ForceJump(NamedTuple):
    """A jump of the specific force.

    time : s. Estimated time within the interval.
    force_before, force_after : m/s^2. Specific force at either side.
    width : s. Length of the interval.
    """

    time: float
    force_before: float
    force_after: float
    width: float


def force_jumps(t: Floats, force: Floats, coarsest: float, noise: Floats | float = 0.0) -> list[ForceJump]:
    """Return the jumps of a specific force in order of time.

    Jumps that noise may explain are not returned. Intervals are joined in pairs repeatedly, to find the jumps that
    noise hides in shorter intervals.

    Parameters
    ----------
    t : (n + 1,) s
        Increasing times.
    force : (n,) m/s^2
        Mean specific force over each interval.
    coarsest : float
        Longest joined interval (s).
    noise : float or (n + 1,)
        One sigma (m/s) of the velocities from which the force is computed; 0 if unknown.

    Returns
    -------
    list of ForceJump
    """
    jumps: list[ForceJump] = []
    velocity_noise = np.broadcast_to(noise, t.shape)
    largest_size = np.full(force.shape, np.inf)  # size above which a finer interval would have shown the jump
    while force.size > 2 * _SIDE:
        width = np.diff(t)
        force_noise = np.hypot(velocity_noise[1:], velocity_noise[:-1]) / width
        noise_level = np.maximum(_estimate_noise(force), force_noise)
        limit = np.maximum(_SMALLEST, _SIGNIFICANT * noise_level)
        usual_width = np.median(width)
        merge_distance = _SIDE * usual_width
        new_jumps = []
        for jump in _find_jumps(t, force, limit, largest_size):
            if all(abs(jump.time - other_jump.time) > merge_distance for other_jump in jumps):
                new_jumps.append(jump)
        jumps += new_jumps
        if 2.0 * usual_width > coarsest or np.all(limit <= _SMALLEST):
            break
        # Join the intervals in pairs: their velocity gains add, the noise of the inner velocity drops out.
        n_pair = force.size // 2
        n_paired = 2 * n_pair
        undetected_size = np.where(limit > _SMALLEST, _BURIED * limit, 0.0)
        first_undetected = undetected_size[:n_paired:2]
        second_undetected = undetected_size[1:n_paired:2]
        largest_size = np.minimum(first_undetected, second_undetected)
        interval_gain = (force * width)[:n_paired]
        velocity_gain = interval_gain.reshape(n_pair, 2).sum(axis=1)
        t = t[: n_paired + 1 : 2]
        velocity_noise = velocity_noise[: n_paired + 1 : 2]
        force = velocity_gain / np.diff(t)
    return sorted(jumps, key=lambda jump: jump.time)


def _estimate_noise(force: Floats) -> float:
    """Return one sigma of the force of an interval, estimated robustly from second differences.

    The median ignores a few jumps. A second difference of white noise has sqrt(6) sigmas; the median absolute value of
    a Gaussian is 0.6745 sigmas.
    """
    second_difference = np.abs(np.diff(force, 2))
    median = float(np.median(second_difference))
    return median / (0.6745 * math.sqrt(6.0))


class _Candidates(NamedTuple):
    """Intervals that may contain a jump.

    k : (m,). Index of the interval.
    force_before, force_after : (2, m) m/s^2. Fitted lines on either side, at both ends of the interval.
    size : (m,) m/s^2. Smaller of the differences of both lines at the ends.
    residual : (m,) m/s^2. Larger residual of both lines.
    share : (m,). Part of the interval before the jump, by its mean force.
    steepness : (m,) m/s^2. Larger rise or fall of both lines over their length.
    """

    k: NDArray[np.int64]
    force_before: Floats
    force_after: Floats
    size: Floats
    residual: Floats
    share: Floats
    steepness: Floats

    def is_jump(self, smallest_size: Floats, largest_size: Floats) -> NDArray[np.bool_]:
        """Return which candidates are jumps of a size between `smallest_size` and `largest_size` (n,) m/s^2."""
        difference = self.force_after - self.force_before
        # lines that cross within the interval are a bend, not a jump
        has_one_sign = difference[0] * difference[1] > 0.0
        is_straight = self.residual <= _STRAIGHT * self.size
        is_candidate = has_one_sign & is_straight
        is_candidate &= np.abs(self.share - 0.5) <= 0.6
        is_large = self.size > smallest_size[self.k]
        was_hidden = self.size <= largest_size[self.k]
        is_candidate &= is_large & was_hidden
        # wrong rows may also lie on a straight line, but on a steep one
        is_candidate &= self.steepness <= _FLAT * self.size
        return np.asarray(is_candidate)


def _candidates(t: Floats, force: Floats) -> _Candidates:
    """Return the candidates for a jump: all intervals with room for a line on either side."""
    interval_middle = 0.5 * (t[1:] + t[:-1])
    level, slope, middle, residual = _fit_lines(interval_middle, force)
    k = np.arange(_SIDE, force.size - _SIDE)
    first, second = k - _SIDE, k + 1  # the lines before and after an interval
    ends = t[[k, k + 1]]
    first_slope, second_slope = slope[first], slope[second]
    force_before = level[first] + first_slope * (ends - middle[first])
    force_after = level[second] + second_slope * (ends - middle[second])
    # mean force = share x before + (1 - share) x after
    mean_before = np.mean(force_before, axis=0)
    mean_after = np.mean(force_after, axis=0)
    difference = mean_before - mean_after
    divisor = np.where(difference == 0.0, 1.0, difference)
    share = (force[k] - mean_after) / divisor
    jump_at_ends = np.abs(force_after - force_before)
    steepest = np.maximum(np.abs(first_slope), np.abs(second_slope))
    width = t[k + 1] - t[k]
    return _Candidates(
        k=k,
        force_before=force_before,
        force_after=force_after,
        size=np.min(jump_at_ends, axis=0),
        residual=np.maximum(residual[first], residual[second]),
        share=share,
        steepness=_SIDE * width * steepest,
    )


def _find_jumps(t: Floats, force: Floats, smallest_size: Floats, largest_size: Floats) -> Iterator[ForceJump]:
    """Yield the jumps of the specific force at one interval length, the clearest first.

    No jump lies within the fitted lines of another.

    Parameters
    ----------
    t : (n + 1,) s
        Increasing times.
    force : (n,) m/s^2
        Mean specific force over each interval.
    smallest_size, largest_size : (n,) m/s^2
        Smallest and largest size of a jump in each interval.
    """
    candidates = _candidates(t, force)
    is_jump = candidates.is_jump(smallest_size, largest_size)
    score = np.where(is_jump, candidates.size - 3.0 * candidates.residual, 0.0)
    while score.size and np.max(score) > 0.0:
        best = int(np.argmax(score))
        k = candidates.k[best]
        begin, end = t[k], t[k + 1]
        width = end - begin
        share = min(max(float(candidates.share[best]), 0.0), 1.0)
        yield ForceJump(
            time=float(begin + share * width),
            force_before=float(candidates.force_before[0, best]),
            force_after=float(candidates.force_after[1, best]),
            width=float(width),
        )
        first_near = max(best - _SIDE, 0)
        last_near = best + _SIDE
        score[first_near : last_near + 1] = 0.0


def _fit_lines(t: Floats, force: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Fit straight lines to every `_SIDE` successive forces.

    Parameters
    ----------
    t : (n,) s
        Middle of each interval.
    force : (n,) m/s^2
        Mean specific force over each interval.

    Returns
    -------
    level, slope, middle, residual : (n - _SIDE + 1,)
        Force (m/s^2) at the mean time, slope (m/s^3), mean time (s), and largest residual (m/s^2).
    """
    times = np.lib.stride_tricks.sliding_window_view(t, _SIDE)
    forces = np.lib.stride_tricks.sliding_window_view(force, _SIDE)
    middle = times.mean(axis=1)
    level = forces.mean(axis=1)
    x = times - middle[:, None]
    y = forces - level[:, None]
    covariance = np.sum(x * y, axis=1)
    variance = np.sum(x**2, axis=1)
    slope = covariance / variance
    residual = np.abs(y - slope[:, None] * x)
    largest_residual = np.max(residual, axis=1)
    return level, slope, middle, largest_residual


def suggested_events(
    t: Floats, force: Floats, declared_events: Mapping[str, float], coarsest: float, noise: Floats | float = 0.0
) -> dict[str, str]:
    """Return events that the jumps of a specific force suggest and the card does not declare.

    A force that ends is named as the cut-off of the current stage. A force that begins is named as the ignition of the
    next. Other steps are named by their sign.

    Parameters
    ----------
    t, force, coarsest, noise
        As in `force_jumps`.
    declared_events : mapping
        Times (s) of the declared events by name. Jumps close to these are omitted.

    Returns
    -------
    dict
        Time by name of the event, as text with unit.
    """
    suggestions: dict[str, str] = {}
    stage = 1
    counts = {"rise": 0, "fall": 0}
    for jump in force_jumps(t, force, coarsest, noise):
        if abs(jump.force_after) < _COAST * abs(jump.force_before):
            name = f"stage{stage}_cutoff"
            stage += 1
        elif abs(jump.force_before) < _COAST * abs(jump.force_after):
            name = f"stage{stage}_ignition"
        else:
            sense = "rise" if jump.force_after > jump.force_before else "fall"
            counts[sense] += 1
            name = f"{sense}_{counts[sense]}"
        tolerance = _NEAR + 2.0 * jump.width
        is_declared = any(abs(jump.time - time) <= tolerance for time in declared_events.values())
        if not is_declared:
            digits = max(0, 1 - math.floor(math.log10(jump.width)))
            suggestions[name] = f"{jump.time:.{digits}f} s"
    return suggestions


def missing_events(
    t: Floats, force: Floats, declared_events: Mapping[str, float], coarsest: float, noise: Floats | float = 0.0
) -> str:
    """Return the warning with `suggested_events` as YAML; empty if there are none. The arguments are the same."""
    suggestions = suggested_events(t, force, declared_events, coarsest, noise)
    if not suggestions:
        return ""
    events = ", ".join(f"{name}: {time}" for name, time in suggestions.items())
    return f"the specific force jumps where no event is declared; as YAML: events: {{{events}}}"
