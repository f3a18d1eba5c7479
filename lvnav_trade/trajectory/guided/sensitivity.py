"""Derivatives of an injection along the reference flight: by navigation errors, and by the sources of the vehicle.

The reference flight is that of the vehicle without draws and with a perfect navigation. Its pieces are simulated again
with one number changed at a time, and their derivatives are multiplied from the cut-off back to lift-off. No second
model of the flight is needed. The time of the cut-off is free: the flight ends when the navigated energy reaches that
of the target.
"""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from lvnav_trade.kernels.earth import GM
from lvnav_trade.quantities.reads import result_cache
from lvnav_trade.quantities.records import INJECTION, ORBIT, Floats
from lvnav_trade.trajectory.ascent.equations_of_motion import Propulsion
from lvnav_trade.trajectory.ascent.legs import COASTING
from lvnav_trade.trajectory.ascent.vehicle_cards import VehicleAscent
from lvnav_trade.trajectory.guided.ascent_runs import Injection, empty_mass, inject
from lvnav_trade.trajectory.guided.draws import NO_RUN, Sigmas, deviations, draw, numbers, run_vehicle, run_wind
from lvnav_trade.trajectory.guided.explicit import N_LAW_STATE
from lvnav_trade.trajectory.guided.guidance_plan import GuidancePlan, plan_ascent
from lvnav_trade.trajectory.guided.guided_dynamics import (
    WHOLE,
    Cutoff,
    NavigationErrors,
    fly_last,
    rates,
)
from lvnav_trade.trajectory.guided.orbit_numbers import (
    append_apsides,
    orbit_derivative,
    orbit_difference,
    osculating_orbit,
)
from lvnav_trade.trajectory.guided.piece_derivatives import (
    ERROR_STEPS,
    MASS,
    Piece,
    final_state,
    guidance_pass,
    has_attitude_effect,
    pass_derivatives,
    state_derivatives,
    table_derivatives,
    wind_rows,
)
from lvnav_trade.trajectory.guided.pilots import INJECTED, GuidedPilot

_CHUNK = 1.0  # s, length of the pieces
_PROPELLANT_LEFT = INJECTION.index("propellant_left")
_WIND_STEP = 1.0  # m/s, of the central differences


class InjectionSensitivity(NamedTuple):
    """First-order change of an injection.

    reason : Reason why there is none; empty otherwise.
    reference : (n_number,). Numbers of `INJECTION` of the reference flight, SI.
    target : (n_orbit,). The target orbit, SI.
    navigation : (n_t, n_number, 9). Change by a navigation error at each of the times: attitude (rad), velocity (m/s)
        and position (m), frame i, truth less estimate, see `NavigationErrors`.
    knowledge : (n_t, n_orbit, 9). Change of the achieved orbit less the navigated one by the same.
    vehicle : Change (n_draw, n_number) by one sigma of each draw, by the name of the source.
    curvature : (n_draw, n_number). Second-order change by one sigma of each draw but those of the wind.
    """

    reason: str = ""
    reference: Floats = np.zeros(0)
    target: Floats = np.zeros(0)
    navigation: Floats = np.zeros((0, 0, 9))
    knowledge: Floats = np.zeros((0, 0, 9))
    vehicle: tuple[tuple[str, Floats], ...] = ()
    curvature: Floats = np.zeros((0, len(INJECTION)))


class _ReferencePilot(GuidedPilot):
    """Pilot of the reference flight, which records its pieces."""

    def __init__(self, plan: GuidancePlan, sigmas: Sigmas, navigation: NavigationErrors) -> None:
        vehicle = run_vehicle(plan.card, sigmas)
        super().__init__(plan, vehicle, deviations(plan.card, sigmas), navigation)
        self.pieces: list[Piece] = []

    def leg(self, name: str, duration: float, engine: Propulsion = COASTING) -> None:
        if duration <= 0.0:
            return
        n_piece = max(1, math.ceil(duration / _CHUNK))
        leg_end = self.t + duration
        edges = np.linspace(self.t, leg_end, n_piece + 1).tolist()
        for begin, end in pairwise(edges):
            piece = self._record(begin, end, engine)
            self.y = final_state(piece, piece.y, piece.law_state)
        self.t = edges[-1]

    def burn_until(self, end: float, push: Propulsion, cutoff: Cutoff) -> int:
        law = self.inputs.law
        outcome = WHOLE
        while self.t < end - 1e-9 and outcome == WHOLE:
            piece_end = min(self.t + law.cycle, end)
            self._record(self.t, piece_end, push, law.start < math.inf)
            self.t, self.y, outcome = fly_last(self.t, piece_end, self.longest, self.y, push, self.inputs, cutoff)
            self.pieces[-1] = self.pieces[-1]._replace(end=self.t)
        return outcome

    def _record(self, begin: float, end: float, push: Propulsion, is_guided: bool = False) -> Piece:
        """Append the piece that begins at the present state, and return it.

        begin, end : s since lift-off
        push : propulsion of the piece
        is_guided : whether explicit guidance steers it
        """
        piece = Piece(
            begin=begin,
            end=end,
            y=self.y.copy(),
            law_state=self.inputs.law.state.copy(),
            longest=self.longest,
            engine=push,
            inputs=self.inputs,
            is_guided=is_guided,
        )
        self.pieces.append(piece)
        return piece


class _CutoffDerivatives(NamedTuple):
    """Derivatives of an injection at the nominal time of the cut-off.

    state_derivative : (n_number, n_motion). Derivative by the true state.
    error_derivative : (n_number, 9). Derivative by the navigation error.
    knowledge : (n_orbit, 9). Of the achieved orbit less the navigated one, by the navigation error.
    """

    state_derivative: Floats
    error_derivative: Floats
    knowledge: Floats


def sensitivity(plan: GuidancePlan, t: Floats) -> InjectionSensitivity:
    """Return the derivatives of the injection of an ascent.

    Parameters
    ----------
    plan : GuidancePlan
    t : (n_t,) s since lift-off. Times at which navigation errors are known.
    """
    content = plan.card.model_dump_json(exclude={"named_times"})
    return _cached_sensitivity((content, t.tobytes()), plan.card)


@result_cache(4)
def _cached_sensitivity(key: tuple[str, bytes], card: VehicleAscent) -> InjectionSensitivity:
    """Return the derivatives of the injection; `key`: the card, and the times (s) as bytes."""
    if card.control is not None:
        return InjectionSensitivity("a vehicle under attitude control has draws and limits of its own, ask for runs")
    plan, t = plan_ascent(card), np.frombuffer(key[1]).copy()
    fixed_draws = draw(card, 0, NO_RUN)
    target = osculating_orbit(plan.nominal[None])[0]
    sources = _dispersed_sources(plan)
    # with draws of the wind, its table is one in which a gust can be changed
    still_air = {"wind": np.zeros(numbers(card)["wind"])} if "wind" in sources else {}
    no_errors = NavigationErrors(t, np.zeros((t.size, ERROR_STEPS.size)))
    pilot = _ReferencePilot(plan, still_air | fixed_draws, no_errors)
    outcome = pilot.fly()
    if outcome != INJECTED:
        return InjectionSensitivity(f"the reference flight, without draws and navigation errors, ends as {outcome!r}")
    # the state at cut-off, before the thrust decays
    cutoff_state = pilot.y.copy()
    cutoff_derivatives = _cutoff_derivatives(pilot, cutoff_state, target)
    navigation, gusts = _propagate_back(pilot.pieces, cutoff_derivatives, t)
    propellant = pilot.y[MASS] - empty_mass(pilot.card)
    reference = np.append(osculating_orbit(pilot.y[None])[0], [pilot.t, propellant])
    vehicle = list[tuple[str, Floats]]()
    curvature = [np.zeros((0, len(INJECTION)))]
    for name in sources:
        if name == "wind":
            vehicle.append((name, _wind_changes(card, gusts)))
            continue
        ends = _inject_both_sides(plan, fixed_draws, name)
        if isinstance(ends, str):
            return InjectionSensitivity(ends)
        high = _changes(ends[0], reference)
        low = _changes(ends[1], reference)
        vehicle.append((name, append_apsides(0.5 * (high - low), target)))
        curvature.append(0.5 * (high + low))
    return InjectionSensitivity(
        reference=reference,
        target=target,
        navigation=navigation + _spread_over_times(t, pilot.t, cutoff_derivatives.error_derivative),
        knowledge=_spread_over_times(t, pilot.t, cutoff_derivatives.knowledge),
        vehicle=tuple(vehicle),
        curvature=np.concatenate(curvature),
    )


def _dispersed_sources(plan: GuidancePlan) -> list[str]:
    """Return the names of the sources that runs draw."""
    dispersion = plan.card.dispersion
    if dispersion is None:
        return []
    return [name for name, sigma in plan.spreads if name in dispersion.drawn_sources and sigma > 0.0]


def _cutoff_derivatives(pilot: _ReferencePilot, y: Floats, target: Floats) -> _CutoffDerivatives:
    """Return the derivatives at the cut-off, which is late by as much as the navigated energy is short.

    pilot : pilot at the cut-off; its state is then the state after the thrust has decayed
    y : (n_motion,). True state at the cut-off.
    target : (n_orbit,). Target orbit, SI.
    """
    last = pilot.pieces[-1]
    slope = rates(pilot.t, y, last.engine, last.inputs)
    # Delay of the cut-off (s) by the navigated position and velocity: -(dE/dx) / (dE/dt), with E = v^2 / 2 - GM / r
    delay = np.zeros(6)
    if pilot.plan.has_energy_cutoff:
        r, v = y[:3], y[3:6]
        energy_gradient = np.concatenate([GM / np.linalg.norm(r) ** 3 * r, v])
        energy_rate = energy_gradient @ slope[:6]
        delay = -energy_gradient / energy_rate
    pilot.push(pilot.deviations.tail_off)
    orbit = orbit_derivative(pilot.y, target)
    orbit_by_delay = orbit @ slope[:6]
    by_delay = np.append(orbit_by_delay, [1.0, slope[MASS]])
    by_state = np.zeros((len(INJECTION), y.size))
    by_state[: len(ORBIT), :6] = orbit
    by_state[_PROPELLANT_LEFT, MASS] = 1.0
    by_state[:, :6] += np.outer(by_delay, delay)
    # A navigated state is the true state less the error. Errors are in the order attitude, velocity, position.
    delay_by_r, delay_by_v = delay[:3], delay[3:]
    delay_by_error = np.concatenate([np.zeros(3), delay_by_v, delay_by_r])
    orbit_by_r, orbit_by_v = orbit[:, :3], orbit[:, 3:]
    no_attitude = np.zeros((len(ORBIT), 3))
    knowledge = np.concatenate([no_attitude, orbit_by_v, orbit_by_r], axis=1)
    return _CutoffDerivatives(
        state_derivative=by_state,
        error_derivative=-np.outer(by_delay, delay_by_error),
        knowledge=knowledge,
    )


def _propagate_back(pieces: list[Piece], cutoff_derivatives: _CutoffDerivatives, t: Floats) -> tuple[Floats, Floats]:
    """Return the derivatives of an injection by navigation errors before the cut-off and by the wind.

    The chain rule is applied from the last piece to the first: the derivative by the state at the end of a piece, times
    that of the piece, is the derivative by the state at its start.

    Parameters
    ----------
    pieces : list of Piece
        Pieces of the reference flight, in order.
    cutoff_derivatives : _CutoffDerivatives
        Derivatives at the cut-off.
    t : (n_t,) s
        Times of the navigation errors, since lift-off.

    Returns
    -------
    (n_t, n_number, 9)
        By navigation errors.
    (n_height, 2, n_number)
        By the wind (m/s) at the heights of its table; zero at heights that the flight does not pass.
    """
    n_number = len(INJECTION)
    n_motion = cutoff_derivatives.state_derivative.shape[1]
    by_end = np.zeros((n_number, n_motion + N_LAW_STATE))  # by motion and state of guidance
    by_end[:, :n_motion] = cutoff_derivatives.state_derivative
    navigation = np.zeros((t.size, n_number, ERROR_STEPS.size))
    wind_shape = pieces[0].inputs.wind.speed.shape
    gusts = np.zeros((*wind_shape, n_number))
    for piece in reversed(pieces):
        by_motion = by_end[:, :n_motion]
        by_law = by_end[:, n_motion:]
        law_state = guidance_pass(piece, piece.y, piece.law_state)
        derivatives = state_derivatives(piece, law_state)
        end_by_motion = derivatives[:, :n_motion]
        end_by_law = derivatives[:, n_motion:]
        entry = _entry_index(t, piece.begin)
        if has_attitude_effect(piece):
            last_entry = _entry_index(t, piece.end + 1e-9)  # a step reads the error at its end too
            error = piece.inputs.navigation.error
            by_tilt = table_derivatives(piece, law_state, error, (entry, last_entry), ERROR_STEPS[:3])
            navigation[entry : last_entry + 1, :, :3] += np.einsum("kes,ns->kne", by_tilt, by_motion)
        rows = wind_rows(piece, law_state)
        if rows is not None:
            first, last = rows
            wind_steps = np.full(2, _WIND_STEP)
            wind = piece.inputs.wind.speed
            by_wind = table_derivatives(piece, law_state, wind, rows, wind_steps)
            gusts[first : last + 1] += np.einsum("kes,ns->ken", by_wind, by_motion)
        by_begin = np.zeros_like(by_end)
        by_begin[:, :n_motion] = by_motion @ end_by_motion
        if piece.is_guided:
            by_pass = by_law + by_motion @ end_by_law
            pass_by_state, pass_by_error = pass_derivatives(piece, entry)
            by_begin += by_pass @ pass_by_state
            navigation[entry] += by_pass @ pass_by_error.T
        by_end = by_begin
    return navigation, gusts


def _entry_index(t: Floats, time: float) -> int:
    """Return the index of the times whose error applies at a time."""
    count = int(np.searchsorted(t, time, side="right"))
    return max(0, count - 1)


def _spread_over_times(t: Floats, time: float, by_error: Floats) -> Floats:
    """Return a derivative by the navigation error at one time as a derivative by the errors at given times.

    t : (n_t,) s. Given times.
    time : s. Time of the error.
    by_error : (n, 9). Derivative by attitude (rad), velocity (m/s) and position (m) error at `time`.

    Returns
    -------
    (n_t, n, 9)
        Zero except at the last given time that is not after `time`. The velocity error there also contributes by the
        position error into which it grows.
    """
    derivative = np.zeros((t.size, *by_error.shape))
    k = _entry_index(t, time)
    derivative[k] = by_error
    # the position error grows by the velocity error
    span = max(0.0, time - t[k])
    derivative[k, :, 3:6] += span * by_error[:, 6:]
    return derivative


def _inject_both_sides(
    plan: GuidancePlan, fixed_draws: Sigmas, name: str
) -> tuple[list[Injection], list[Injection]] | str:
    """Return injections with one sigma more, and one sigma less, of each draw of a source.

    The whole ascent is simulated, so that the effect on staging is included.

    Parameters
    ----------
    plan : GuidancePlan
        Guidance data stored before lift-off.
    fixed_draws : Sigmas
        Draws that are equal in all runs.
    name : str
        Name of the source.

    Returns
    -------
    (list of Injection, list of Injection) or str
        Injections by draw on either side, or the reason why there are none.
    """
    n_draw = numbers(plan.card)[name]
    ends: tuple[list[Injection], list[Injection]] = [], []
    for k in range(n_draw):
        for side, sign in zip(ends, (1.0, -1.0), strict=True):
            sigmas = fixed_draws.get(name, np.zeros(n_draw)).copy()
            sigmas[k] += sign
            draws = {**fixed_draws, name: sigmas}
            injection = inject(plan, draws)
            if injection.outcome != INJECTED:
                source = name.replace("_", " ")
                return f"with {sign:+.0f} sigma of {source} the flight ends as {injection.outcome!r}"
            side.append(injection)
    return ends


def _changes(injections: list[Injection], reference: Floats) -> Floats:
    """Return the differences (n, n_number) of injections from the reference."""
    states = np.stack([injection.y for injection in injections])
    reference_orbit, reference_end = np.split(reference, [len(ORBIT)])
    orbit = orbit_difference(osculating_orbit(states), reference_orbit)
    time_and_propellant = np.array([(injection.t, injection.propellant_left) for injection in injections])
    return np.column_stack([orbit, time_and_propellant - reference_end])


def _wind_changes(card: VehicleAscent, gusts: Floats) -> Floats:
    """Return the change (n_draw, n_number) by one sigma of each draw of the wind.

    gusts : (n_height, 2, n_number). Derivative by the wind (m/s).
    """
    unit_draws = np.eye(numbers(card)["wind"])
    spreads = card.vehicle.dispersions
    winds = np.array([run_wind(draws, spreads).speed for draws in unit_draws])
    return np.einsum("dhe,hen->dn", winds, gusts)
