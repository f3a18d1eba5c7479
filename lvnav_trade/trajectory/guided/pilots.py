"""Pilots of guided ascents, leg by leg: attitude as commanded or with a lag, and attitude under control."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.ascent.equations_of_motion import Propulsion
from lvnav_trade.trajectory.ascent.legs import COASTING, STEP, Pilot
from lvnav_trade.trajectory.ascent.motors import cuts, engine
from lvnav_trade.trajectory.ascent.vehicle_cards import VehicleAscent
from lvnav_trade.trajectory.guided.autopilot import STACK
from lvnav_trade.trajectory.guided.draws import Deviations
from lvnav_trade.trajectory.guided.explicit import N_LAW_STATE
from lvnav_trade.trajectory.guided.guidance_plan import GuidancePlan
from lvnav_trade.trajectory.guided.guided_dynamics import (
    CUT_OFF,
    DIVERGED,
    EMPTY,
    AscentInputs,
    Cutoff,
    GuidanceLaw,
    NavigationErrors,
    commanded_direction,
    fly_last,
    fly_piece,
)
from lvnav_trade.trajectory.guided.turning import NEVER, AttitudeControl, acceleration, turn_piece

INJECTED, DEPLETED, LOST, ADRIFT = "injected", "depleted", "guidance diverged", "navigation failed"
_OUTCOMES = {CUT_OFF: INJECTED, EMPTY: DEPLETED, DIVERGED: LOST}
_CYCLE = 1.0  # s between two passes of explicit guidance
_FREEZE = 10.0  # s to go, below which the steering law is frozen: its equations divide by the time to go
_LONGEST = 3.0  # full burn times, after which any propellant is used up
_LAG_STEP = 0.5  # longest step of integration, in time constants of the attitude lag


class GuidedPilot(Pilot):
    """Simulates a dispersed vehicle by a plan.

    plan : Guidance data stored before lift-off.
    deviations : Deviations other than those of the vehicle's card.
    inputs : Inputs of the present piece.
    longest : s. Longest step of integration.
    """

    def __init__(
        self, plan: GuidancePlan, vehicle: VehicleAscent, deviations: Deviations, navigation: NavigationErrors
    ) -> None:
        super().__init__(vehicle, plan.aim, None)
        self.plan = plan
        self.deviations = deviations
        law = GuidanceLaw(
            start=math.inf,
            slew=plan.card.slew,
            cycle=_CYCLE,
            freeze_time=_FREEZE,
            exhaust_speed=plan.card.vehicle.stages[-1].exhaust_speed,
            target=plan.target,
            state=np.zeros(N_LAW_STATE),
            schuler=plan.schuler,
        )
        self.inputs = AscentInputs(
            programme=plan.programme,
            navigation=navigation,
            drag=self.drag,
            wind=deviations.wind,
            misalignment=deviations.misalignment[0].copy(),
            law=law,
            lag=plan.lag,
        )
        self.longest = STEP
        if plan.lag > 0.0:
            self.y = np.append(self.y, commanded_direction(0.0, self.inputs))
            self.longest = min(STEP, _LAG_STEP * plan.lag)

    def leg(self, name: str, duration: float, engine: Propulsion = COASTING) -> None:
        """Simulate a stretch without a jump for a duration (s)."""
        if duration > 0.0:
            end = self.t + duration
            self.y = fly_piece(self.t, end, self.longest, self.y, engine, self.inputs)
            self.t += duration

    def ignite_after(self, number: int) -> None:
        """Coast to the ignition of a stage; each stage has its own thrust misalignment."""
        super().ignite_after(number)
        misalignment = self.deviations.misalignment[number - 1].copy()
        self.inputs = self.inputs._replace(misalignment=misalignment)

    def separate(self, number: int) -> None:
        """Coast to the separation of a stage, and add its separation impulse."""
        super().separate(number)
        self.push(float(self.deviations.separation[number - 1]))

    def push(self, speed: float) -> None:
        """Add a speed (m/s) along the thrust."""
        if speed != 0.0:
            direction = np.array(commanded_direction(self.t, self.inputs))
            self.y[3:6] += speed * direction

    def last_burn(self) -> str:
        """Simulate the last stage to its cut-off; return the outcome."""
        card, plan = self.card, self.plan
        number, vehicle = card.insertion_stage, card.vehicle
        self.ignite_after(number)
        if plan.explicit:
            law = self.inputs.law._replace(start=self.t)
            self.inputs = self.inputs._replace(law=law)
        stage = vehicle.stages[number - 1]
        ignition = self.t
        cutoff = Cutoff(
            is_at_energy=plan.has_energy_cutoff,
            energy=plan.energy,
            time=plan.cutoff,
            empty_mass=self.y[6] - stage.propellant,
        )
        for cut in [*cuts(vehicle, number), None]:
            burn_time = cut.time_from_ignition if cut is not None else _LONGEST * stage.full_burn
            end = ignition + burn_time
            push = engine(vehicle, number, ignition, self.t, end)
            reason = self.burn_until(end, push, cutoff)
            if reason in _OUTCOMES:
                return _OUTCOMES[reason]
            if cut is not None:
                self.y[6] -= cut.dropped_mass
                cutoff = cutoff._replace(empty_mass=cutoff.empty_mass - cut.dropped_mass)
        return DEPLETED

    def burn_until(self, end: float, push: Propulsion, cutoff: Cutoff) -> int:
        """Simulate a piece of the last burn; return the reason for its end, as `fly_last` does.

        end : s since lift-off. Latest end.
        push : propulsion of the piece
        """
        self.t, self.y, reason = fly_last(self.t, end, self.longest, self.y, push, self.inputs, cutoff)
        return reason

    def fly(self) -> str:
        """Simulate the ascent from lift-off to the end of the last burn; return the outcome."""
        for number in range(1, self.card.insertion_stage):
            self.stage(number)
        return self.last_burn()


class PathSegment(NamedTuple):
    """Both ends of a stretch of a path without a jump.

    name : Name of its leg.
    t : (2,) s since lift-off.
    y : (2, 7). States.
    a : (2, 3) m/s^2. Accelerations, frame i.
    """

    name: str
    t: Floats
    y: Floats
    a: Floats


class TurningPilot(GuidedPilot):
    """Simulation of a vehicle under attitude control, by a plan or with the burn times of the nominal ascent.

    turning : Attitude control, body and gusts.
    stretches : Stretches of the path so far, if the path is recorded.
    """

    def __init__(
        self,
        plan: GuidancePlan,
        vehicle: VehicleAscent,
        deviations: Deviations,
        navigation: NavigationErrors,
        turning: AttitudeControl,
    ) -> None:
        super().__init__(plan, vehicle, deviations, navigation)
        self.turning = turning
        self.stretches: list[PathSegment] = []

    def leg(self, name: str, duration: float, engine: Propulsion = COASTING) -> None:
        """Simulate a stretch without a jump for a duration (s), tick by tick."""
        if duration <= 0.0:
            return
        begin, end = self.t, self.t + duration
        first_state = self.y
        first_acceleration = np.zeros(0)
        is_recorded = self.turning.path.size > 0
        if is_recorded:
            self._turn(begin, engine)  # the next nozzle must be active before the first acceleration is evaluated
            first_acceleration = acceleration(begin, first_state, engine, self.inputs, self.turning)
        self._turn(end, engine)
        self.t = end
        if is_recorded:
            last_acceleration = acceleration(end, self.y, engine, self.inputs, self.turning)
            segment = PathSegment(
                name=name,
                t=np.array([begin, end]),
                y=np.stack([first_state, self.y]),
                a=np.stack([first_acceleration, last_acceleration]),
            )
            self.stretches.append(segment)

    def _turn(self, end: float, engine: Propulsion, cutoff: Cutoff = NEVER) -> int:
        """Simulate a piece to `end` (s) at most; return the reason for its end."""
        self.t, self.y, reason = turn_piece(self.t, end, self.y, engine, self.inputs, self.turning, cutoff)
        return reason

    def ignite_after(self, number: int) -> None:
        """Coast to the ignition of a stage, which is now the lowest."""
        self.turning.control.counts[STACK] = number
        super().ignite_after(number)

    def burn(self, number: int, duration: float | None, is_second: bool = False) -> None:
        """Burn a stage, which is then the lowest; the arguments are those of `Pilot.burn` of `ascent.legs`."""
        self.turning.control.counts[STACK] = number
        super().burn(number, duration, is_second)

    def burn_until(self, end: float, push: Propulsion, cutoff: Cutoff) -> int:
        """Simulate a piece of the last burn, tick by tick; see `GuidedPilot.burn_until`."""
        return self._turn(end, push, cutoff)

    def fly_nominal(self) -> None:
        """Simulate the ascent to the end of the final coast, with the burn times of the nominal ascent."""
        for number in range(1, self.card.insertion_stage):
            self.stage(number)
        self.simulate_insertion()
        self.events["injection"] = self.t
        self.events.pop("stage1_ignition")  # it is the lift-off
        self.leg("final coast", self.card.coast_after_injection)
