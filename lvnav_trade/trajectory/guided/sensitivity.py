"""Derivatives of an injection along the reference flight: by navigation errors, and by the sources of the vehicle.

The reference flight is that of the vehicle without draws and with a perfect navigation. Its pieces are flown again with
one number changed at a time, and their derivatives are multiplied from the cut-off back to lift-off. So the flight
itself is the only statement of the model. The time of the cut-off gives way: the flight ends when the navigated energy
is that of the target.
"""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from lvnav_trade.kernels.earth import GM
from lvnav_trade.kernels.jit import making_arrays
from lvnav_trade.quantities.reads import remembered
from lvnav_trade.quantities.records import INJECTION, ORBIT, Floats
from lvnav_trade.trajectory.ascent.equations_of_motion import Propulsion, height_above
from lvnav_trade.trajectory.ascent.legs import COASTING
from lvnav_trade.trajectory.ascent.vehicle_cards import VehicleAscent
from lvnav_trade.trajectory.guided.ascent_runs import Injection, empty_mass, inject
from lvnav_trade.trajectory.guided.draws import NO_RUN, WIND_TOP, Sigmas, deviations, draw, numbers, vehicle_of, wind_of
from lvnav_trade.trajectory.guided.explicit import LAMBDA, N_KEPT, REFERENCE, STARTED, TURN
from lvnav_trade.trajectory.guided.guidance_plan import GuidancePlan, plan_of
from lvnav_trade.trajectory.guided.guided_dynamics import (
    WHOLE,
    AscentInputs,
    Cutoff,
    NavigationErrors,
    Wind,
    fly_last,
    guide,
    rates,
    step,
)
from lvnav_trade.trajectory.guided.orbit_numbers import orbit_difference, orbit_of, with_apsides
from lvnav_trade.trajectory.guided.pilots import INJECTED, GuidedPilot

_CHUNK = 1.0  # s, of the pieces that are flown again with a number changed
_MASS = 6  # place of the mass in a state, after position and velocity
_LEFT = INJECTION.index("propellant_left")
# Steps of the central differences. Their second order is a millionth of the first, round-off less.
_MOTION_STEPS = np.array([10.0] * 3 + [0.1] * 3 + [1e-5] + [1e-4] * 3)  # m, m/s, a share of the mass, a direction
_ERROR_STEPS = np.array([1e-4] * 3 + [0.1] * 3 + [10.0] * 3)  # rad, m/s, m
_WIND_STEP = 1.0  # m/s
# Of what guidance keeps, see `explicit`; 0: a number that nothing changes
_KEPT_STEPS = np.array([0.1] * 3 + [10.0] * 9 + [1e-4] * 3 + [1e-6] * 3 + [1e-2] * 3 + [0.1] * 3 + [0.0] * 2)

_STEERING = np.array([*range(LAMBDA, LAMBDA + 3), *range(TURN, TURN + 3), REFERENCE])
"""What of that the command between two passes depends on."""


class InjectionSensitivity(NamedTuple):
    """First-order change of an injection.

    why : Why there is none; empty where there is.
    reference : (n_number,). Numbers of `INJECTION` of the reference flight, SI.
    target : (n_orbit,). The target orbit, SI.
    navigation : (n_t, n_number, 9). Change by a navigation error at each of the times: attitude (rad), velocity (m/s)
        and position (m), frame i, truth less estimate, see `dynamics.NavigationErrors`.
    knowledge : (n_t, n_orbit, 9). Change of the achieved orbit less the navigated one by the same.
    vehicle : Change (n_draw, n_number) by one sigma of each draw, by the name of the source.
    curvature : (n_draw, n_number). Second-order change by one sigma of each draw but those of the wind.
    """

    why: str = ""
    reference: Floats = np.zeros(0)
    target: Floats = np.zeros(0)
    navigation: Floats = np.zeros((0, 0, 9))
    knowledge: Floats = np.zeros((0, 0, 9))
    vehicle: tuple[tuple[str, Floats], ...] = ()
    curvature: Floats = np.zeros((0, len(INJECTION)))


class _Piece(NamedTuple):
    """A piece of the reference flight.

    begin : s since lift-off.
    end : s since lift-off.
    y : (n_motion,). State at its begin: 7, or 10 of a body that follows its command with a lag.
    kept : (N_KEPT,). What guidance keeps there.
    longest : s. Longest step of integration.
    engine : What pushes.
    around : What it is flown with.
    steers : Whether explicit guidance steers it, with a pass at its begin.
    """

    begin: float
    end: float
    y: Floats
    kept: Floats
    longest: float
    engine: Propulsion
    around: AscentInputs
    steers: bool


@making_arrays
def _renewed(piece: _Piece, y: Floats, kept: Floats) -> Floats:
    """Return what guidance keeps (N_KEPT,) after its pass at the begin of a piece, at a state y (7,)."""
    law = piece.around.law
    law.kept[:] = kept
    if piece.steers:
        guide(piece.begin, y, piece.engine, piece.around)
    return law.kept.copy()


@making_arrays
def _moved(piece: _Piece, y: Floats, renewed: Floats) -> Floats:
    """Return the state (7,) at the end of a piece that begins at y (7,), with what guidance keeps from there on."""
    piece.around.law.kept[:] = renewed
    span = piece.end - piece.begin
    n = max(1, math.ceil(span / piece.longest - 1e-9))
    for k in range(n):
        y = step(piece.begin + k * span / n, span / n, y, piece.engine, piece.around)
    return y


@making_arrays
def _pass_by_all(piece: _Piece, first: int) -> tuple[Floats, Floats]:
    """Return the derivatives of what guidance keeps after the pass at the begin of a piece: (N_KEPT, n_motion + N_KEPT)
    by state and by what it kept before, (9, N_KEPT) by the navigation error at its time of number `first`.
    """
    n = piece.y.size
    by_state, by_error = np.zeros((N_KEPT, n + N_KEPT)), np.zeros((_ERROR_STEPS.size, N_KEPT))
    y, kept, error = piece.y.copy(), piece.kept.copy(), piece.around.navigation.error
    for k in range(n):
        size, before = _MOTION_STEPS[k] * (y[k] if k == _MASS else 1.0), y[k]
        y[k] = before + size
        high = _renewed(piece, y, kept)
        y[k] = before - size
        by_state[:, k] = (high - _renewed(piece, y, kept)) / (2.0 * size)
        y[k] = before
    for k in range(N_KEPT if kept[STARTED] > 0.0 else 0):
        size, before = _KEPT_STEPS[k], kept[k]
        if size > 0.0:
            kept[k] = before + size
            high = _renewed(piece, y, kept)
            kept[k] = before - size
            by_state[:, n + k] = (high - _renewed(piece, y, kept)) / (2.0 * size)
            kept[k] = before
    for column in range(3, _ERROR_STEPS.size):  # guidance reads velocity and position
        size, before = _ERROR_STEPS[column], error[first, column]
        error[first, column] = before + size
        high = _renewed(piece, y, kept)
        error[first, column] = before - size
        by_error[column] = (high - _renewed(piece, y, kept)) / (2.0 * size)
        error[first, column] = before
    return by_state, by_error


@making_arrays
def _motion_by_state(piece: _Piece, renewed: Floats) -> Floats:
    """Return the derivative (n_motion, n_motion + N_KEPT) of the state at the end of a piece by the state, and by what
    guidance keeps after its pass.
    """
    n = piece.y.size
    found, y, kept = np.zeros((n, n + N_KEPT)), piece.y.copy(), renewed.copy()
    for k in range(n):
        size, before = _MOTION_STEPS[k] * (y[k] if k == _MASS else 1.0), y[k]
        y[k] = before + size
        high = _moved(piece, y, kept)
        y[k] = before - size
        found[:, k] = (high - _moved(piece, y, kept)) / (2.0 * size)
        y[k] = before
    for k in _STEERING if piece.steers else _STEERING[:0]:
        size, before = _KEPT_STEPS[k], kept[k]
        kept[k] = before + size
        high = _moved(piece, y, kept)
        kept[k] = before - size
        found[:, n + k] = (high - _moved(piece, y, kept)) / (2.0 * size)
        kept[k] = before
    return found


@making_arrays
def _motion_by_table(piece: _Piece, renewed: Floats, table: Floats, rows: tuple[int, int], steps: Floats) -> Floats:
    """Return the derivative (n_row, n_column, n_motion) of the state at the end of a piece by a table it is flown with.

    The first columns are changed, one for each of the steps; rows: the first and the last one.
    """
    first, last = rows
    found = np.zeros((last - first + 1, steps.size, piece.y.size))
    for row in range(last - first + 1):
        for column in range(steps.size):
            size, before = steps[column], table[first + row, column]
            table[first + row, column] = before + size
            high = _moved(piece, piece.y, renewed)
            table[first + row, column] = before - size
            found[row, column] = (high - _moved(piece, piece.y, renewed)) / (2.0 * size)
            table[first + row, column] = before
    return found


class _Recorded(GuidedPilot):
    """Flies the reference, and keeps its pieces."""

    def __init__(self, plan: GuidancePlan, sigmas: Sigmas, navigation: NavigationErrors) -> None:
        super().__init__(plan, vehicle_of(plan.card, sigmas), deviations(plan.card, sigmas), navigation)
        self.pieces: list[_Piece] = []

    def leg(self, name: str, duration: float, engine: Propulsion = COASTING) -> None:
        if duration <= 0.0:
            return
        edges = np.linspace(self.t, self.t + duration, max(1, math.ceil(duration / _CHUNK)) + 1).tolist()
        for begin, end in pairwise(edges):
            piece = self._keep(begin, end, engine)
            self.y = _moved(piece, piece.y, piece.kept)
        self.t = edges[-1]

    def burn_until(self, end: float, push: Propulsion, cutoff: Cutoff) -> int:
        why = WHOLE
        while self.t < end - 1e-9 and why == WHOLE:
            until = min(self.t + self.around.law.cycle, end)
            self._keep(self.t, until, push, self.around.law.start < math.inf)
            self.t, self.y, why = fly_last(self.t, until, self.longest, self.y, push, self.around, cutoff)
            self.pieces[-1] = self.pieces[-1]._replace(end=self.t)
        return why

    def _keep(self, begin: float, end: float, push: Propulsion, steers: bool = False) -> _Piece:
        kept = self.around.law.kept.copy()
        piece = _Piece(begin, end, self.y.copy(), kept, self.longest, push, self.around, steers)
        self.pieces.append(piece)
        return piece


class _Ending(NamedTuple):
    """Derivatives of an injection at the nominal time of the cut-off.

    by_state : (n_number, n_motion). By the true state.
    by_error : (n_number, 9). By the navigation error.
    knowledge : (n_orbit, 9). Of the achieved orbit less the navigated one, by the navigation error.
    """

    by_state: Floats
    by_error: Floats
    knowledge: Floats


def sensitivity(plan: GuidancePlan, t: Floats) -> InjectionSensitivity:
    """Return the derivatives of the injection of an ascent.

    Parameters
    ----------
    plan : GuidancePlan
    t : (n_t,) s since lift-off. Times at which navigation errors are known.
    """
    return _remembered((plan.card.model_dump_json(exclude={"named_times"}), t.tobytes()), plan.card)


@remembered(4)
def _remembered(key: tuple[str, bytes], card: VehicleAscent) -> InjectionSensitivity:
    if card.control is not None:
        return InjectionSensitivity("a vehicle under attitude control has draws and limits of its own, ask for runs")
    plan, t = plan_of(card), np.frombuffer(key[1]).copy()
    fixed, target = draw(card, 0, NO_RUN), orbit_of(plan.nominal[None])[0]
    drawn = () if card.dispersion is None else card.dispersion.drawn
    sources = [name for name, sigma in plan.spreads if name in drawn and sigma > 0.0]
    air = {"wind": np.zeros(numbers(card)["wind"])} if "wind" in sources else {}  # in which a gust can be changed
    pilot = _Recorded(plan, air | fixed, NavigationErrors(t, np.zeros((t.size, _ERROR_STEPS.size))))
    outcome = pilot.fly()
    if outcome != INJECTED:
        return InjectionSensitivity(f"the reference flight, without draws and navigation errors, ends as {outcome!r}")
    ending = _ending(pilot, target)
    navigation, gusts = _by_flight(pilot.pieces, ending, t)
    reference = np.append(orbit_of(pilot.y[None])[0], [pilot.t, pilot.y[_MASS] - empty_mass(pilot.card)])
    vehicle, curvature = list[tuple[str, Floats]](), [np.zeros((0, len(INJECTION)))]
    for name in sources:
        if name == "wind":
            vehicle.append((name, _by_gusts(card, gusts)))
            continue
        ends = _by_draws(plan, fixed, name)
        if isinstance(ends, str):
            return InjectionSensitivity(ends)
        high, low = (_changes(side, reference) for side in ends)
        vehicle.append((name, with_apsides(0.5 * (high - low), target)))
        curvature.append(0.5 * (high + low))
    return InjectionSensitivity(
        reference=reference,
        target=target,
        navigation=navigation + _by_nodes(t, pilot.t, ending.by_error),
        knowledge=_by_nodes(t, pilot.t, ending.knowledge),
        vehicle=tuple(vehicle),
        curvature=np.concatenate(curvature),
    )


def _ending(pilot: _Recorded, target: Floats) -> _Ending:
    """Return the derivatives at the cut-off, which is late by as much as the navigated energy is short; the pilot's
    state is then that after the thrust has decayed.
    """
    y, last, plan = pilot.y.copy(), pilot.pieces[-1], pilot.plan
    slope = rates(pilot.t, y, last.engine, last.around)
    delay = np.zeros(6)  # of the cut-off (s) by the navigated state
    if plan.by_energy:
        gradient = np.concatenate([GM / np.linalg.norm(y[:3]) ** 3 * y[:3], y[3:6]])
        delay = -gradient / (gradient @ slope[:6])
    pilot.push(pilot.differs.tail_off)
    orbit = _by_motion(pilot.y, target)
    moved = np.append(orbit @ slope[:6], [1.0, slope[_MASS]])  # of all numbers, by the time of the cut-off
    by_state = np.zeros((len(INJECTION), y.size))
    by_state[: len(ORBIT), :6], by_state[_LEFT, _MASS] = orbit, 1.0
    by_state[:, :6] += np.outer(moved, delay)
    # a navigated state is the true one less the error; velocity stands before position in the errors
    swapped = np.concatenate([np.zeros(3), delay[3:], delay[:3]])
    knowledge = np.concatenate([np.zeros((len(ORBIT), 3)), orbit[:, 3:], orbit[:, :3]], axis=1)
    return _Ending(by_state, -np.outer(moved, swapped), knowledge)


def _by_motion(y: Floats, target: Floats) -> Floats:
    """Return the derivative (n_orbit, 6) of an orbit by position and velocity."""
    moves = np.diag(_MOTION_STEPS[:6])
    high, low = (orbit_of(y[:6] + sign * moves) for sign in (1.0, -1.0))
    change = with_apsides(orbit_difference(high, low), target)
    return np.asarray((change / (2.0 * _MOTION_STEPS[:6, None])).T)


def _by_flight(pieces: list[_Piece], ending: _Ending, t: Floats) -> tuple[Floats, Floats]:
    """Return the derivative (n_t, n_number, 9) of an injection by navigation errors on the way, and that (n_height, 2,
    n_number) by the wind (m/s) where it can be changed.
    """
    n = ending.by_state.shape[1]
    ahead = np.zeros((len(INJECTION), n + N_KEPT))
    ahead[:, :n] = ending.by_state
    navigation = np.zeros((t.size, len(INJECTION), _ERROR_STEPS.size))
    gusts = np.zeros((*pieces[0].around.wind.speed.shape, len(INJECTION)))
    for piece in reversed(pieces):
        by_motion, by_kept, entered = ahead[:, :n], ahead[:, n:], np.zeros_like(ahead)
        renewed = _renewed(piece, piece.y, piece.kept)
        motion = _motion_by_state(piece, renewed)
        first, last = _held(t, piece.begin), _held(t, piece.end + 1e-9)  # a step reads the error at its end too
        # with a lag the body turns to what its navigation says in coasts as well
        if piece.engine.thrust > 0.0 or piece.engine.beside.thrust > 0.0 or piece.around.lag > 0.0:
            tilted = _motion_by_table(piece, renewed, piece.around.navigation.error, (first, last), _ERROR_STEPS[:3])
            navigation[first : last + 1, :, :3] += np.einsum("kes,ns->kne", tilted, by_motion)
        wind, heights = piece.around.wind, [height_above(*y[:3]) for y in (piece.y, _moved(piece, piece.y, renewed))]
        if min(heights) < WIND_TOP and len(wind.speed) > 1:
            rows = _heights(wind, min(heights), max(heights))
            blown = _motion_by_table(piece, renewed, wind.speed, rows, np.full(2, _WIND_STEP))
            gusts[rows[0] : rows[1] + 1] += np.einsum("kes,ns->ken", blown, by_motion)
        entered[:, :n] = by_motion @ motion[:, :n]
        if piece.steers:
            by_renewed = by_kept + by_motion @ motion[:, n:]
            passed, seen = _pass_by_all(piece, first)
            entered += by_renewed @ passed
            navigation[first] += by_renewed @ seen.T
        ahead = entered
    return navigation, gusts


def _heights(wind: Wind, low: float, high: float) -> tuple[int, int]:
    """Return the first and the last entry of the wind that the air between two heights (m) depends on."""
    last = len(wind.speed) - 1
    return min(max(0, math.floor(low / wind.step)), last), min(max(0, math.ceil(high / wind.step)), last)


def _held(t: Floats, time: float) -> int:
    """Return which of the times has the error that is held at a time."""
    return max(0, int(np.searchsorted(t, time, side="right")) - 1)


def _by_nodes(t: Floats, time: float, by_error: Floats) -> Floats:
    """Return a derivative (n, 9) by the navigation error at a time as one (n_t, n, 9) by those at the times t."""
    found, k = np.zeros((t.size, *by_error.shape)), _held(t, time)
    found[k] = by_error
    found[k, :, 3:6] += max(0.0, time - t[k]) * by_error[:, 6:]
    return found


def _by_draws(plan: GuidancePlan, fixed: Sigmas, name: str) -> tuple[list[Injection], list[Injection]] | str:
    """Return whole flights with one sigma more, and one less, of each draw of a source, so that staging is in what
    differs; or why there are none.
    """
    ends: tuple[list[Injection], list[Injection]] = [], []
    for k in range(numbers(plan.card)[name]):
        for side, sign in zip(ends, (1.0, -1.0), strict=True):
            one = fixed.get(name, np.zeros(numbers(plan.card)[name])).copy()
            one[k] += sign
            flown = inject(plan, {**fixed, name: one})
            if flown.outcome != INJECTED:
                return f"with {sign:+.0f} sigma of {name.replace('_', ' ')} the flight ends as {flown.outcome!r}"
            side.append(flown)
    return ends


def _changes(flown: list[Injection], reference: Floats) -> Floats:
    """Return what injections have more than the reference, (n, n_number)."""
    orbit = orbit_difference(orbit_of(np.stack([one.y for one in flown])), reference[: len(ORBIT)])
    return np.column_stack([orbit, np.array([(one.t, one.left) for one in flown]) - reference[len(ORBIT) :]])


def _by_gusts(card: VehicleAscent, gusts: Floats) -> Floats:
    """Return the change (n_draw, n_number) by one sigma of each draw of the wind.

    gusts : (n_height, 2, n_number). Derivative by the wind (m/s).
    """
    draws = np.eye(numbers(card)["wind"])
    winds = np.array([wind_of(one, card.vehicle.dispersions).speed for one in draws])
    return np.einsum("dhe,hen->dn", winds, gusts)
