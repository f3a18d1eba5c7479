"""Pilots of guided ascents, leg by leg: attitude as commanded or with a lag, and attitude under control."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.ascent.equations_of_motion import Propulsion
from lvnav_trade.trajectory.ascent.legs import COASTING, STEP, Pilot, cuts, engine
from lvnav_trade.trajectory.ascent.vehicle_cards import VehicleAscent
from lvnav_trade.trajectory.guided.autopilot import STACK
from lvnav_trade.trajectory.guided.draws import Deviations
from lvnav_trade.trajectory.guided.explicit import N_KEPT
from lvnav_trade.trajectory.guided.guidance_plan import GuidancePlan
from lvnav_trade.trajectory.guided.guided_dynamics import (
    CUT_OFF,
    DIVERGED,
    EMPTY,
    AscentInputs,
    Cutoff,
    GuidanceLaw,
    NavigationErrors,
    commanded,
    fly_last,
    fly_piece,
)
from lvnav_trade.trajectory.guided.turning import NEVER, AttitudeControl, acceleration, turn_piece

INJECTED, DEPLETED, LOST, ADRIFT = "injected", "depleted", "guidance diverged", "navigation failed"
_OUTCOMES = {CUT_OFF: INJECTED, EMPTY: DEPLETED, DIVERGED: LOST}
_CYCLE = 1.0  # s between two passes of explicit guidance
_FREEZE = 10.0  # s to go, below which the steering law is frozen: its equations divide by the time to go
_LONGEST = 3.0  # full burn times, after which any propellant is used up
_OF_A_LAG = 0.5  # longest step of integration, in time constants of the attitude lag


class GuidedPilot(Pilot):
    """Flies a dispersed vehicle by a plan.

    plan : Guidance data stored before lift-off.
    differs : Deviations other than those of the vehicle's card.
    around : Surroundings of the present piece.
    longest : s. Longest step of integration.
    """

    def __init__(
        self, plan: GuidancePlan, flown: VehicleAscent, differs: Deviations, navigation: NavigationErrors
    ) -> None:
        super().__init__(flown, plan.aim, None)
        self.plan, self.differs = plan, differs
        last = plan.card.vehicle.stages[-1]
        law = GuidanceLaw(
            math.inf, plan.card.slew, _CYCLE, _FREEZE, last.exhaust_speed, plan.target, np.zeros(N_KEPT), plan.schuler
        )
        self.around = AscentInputs(
            plan.programme, navigation, self.drag, differs.wind, differs.misalignment[0].copy(), law, plan.lag
        )
        self.longest = STEP
        if plan.lag > 0.0:
            self.y = np.append(self.y, commanded(0.0, self.around))
            self.longest = min(STEP, _OF_A_LAG * plan.lag)

    def leg(self, name: str, duration: float, engine: Propulsion = COASTING) -> None:
        """Fly a stretch without a jump for a duration (s)."""
        if duration > 0.0:
            self.y = fly_piece(self.t, self.t + duration, self.longest, self.y, engine, self.around)
            self.t += duration

    def ignite_after(self, number: int) -> None:
        """Coast to the ignition of a stage; each stage has its own thrust misalignment."""
        super().ignite_after(number)
        self.around = self.around._replace(misalignment=self.differs.misalignment[number - 1].copy())

    def separate(self, number: int) -> None:
        """Coast to the separation of a stage, and add its separation impulse."""
        super().separate(number)
        self.push(float(self.differs.separation[number - 1]))

    def push(self, speed: float) -> None:
        """Add a speed (m/s) along the thrust."""
        if speed != 0.0:
            self.y[3:6] += speed * np.array(commanded(self.t, self.around))

    def last_burn(self) -> str:
        """Fly the last stage to its cut-off; return the outcome."""
        card, plan = self.card, self.plan
        number, vehicle = card.inserting, card.vehicle
        self.ignite_after(number)
        if plan.explicit:
            self.around = self.around._replace(law=self.around.law._replace(start=self.t))
        stage, begin = vehicle.stages[number - 1], self.t
        cutoff = Cutoff(plan.by_energy, plan.energy, plan.cutoff, self.y[6] - stage.propellant)
        for cut in [*cuts(vehicle, number), None]:
            end = begin + (cut.after if cut is not None else _LONGEST * stage.full_burn)
            push = engine(vehicle, number, begin, self.t, end)
            why = self.burn_until(end, push, cutoff)
            if why in _OUTCOMES:
                return _OUTCOMES[why]
            if cut is not None:
                self.y[6] -= cut.drop
                cutoff = cutoff._replace(empty=cutoff.empty - cut.drop)
        return DEPLETED

    def burn_until(self, end: float, push: Propulsion, cutoff: Cutoff) -> int:
        """Fly a piece of the last burn that ends at `end` (s) at the latest; return how it ends, as `fly_last` does."""
        self.t, self.y, why = fly_last(self.t, end, self.longest, self.y, push, self.around, cutoff)
        return why

    def fly(self) -> str:
        """Fly from lift-off to the end of the last burn; return the outcome."""
        for number in range(1, self.card.inserting):
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
    """Flies a vehicle under attitude control, by a plan or with the burn times of the nominal flight.

    turning : Attitude control, body and gusts.
    stretches : Stretches of the path so far, if the path is recorded.
    """

    def __init__(
        self,
        plan: GuidancePlan,
        flown: VehicleAscent,
        differs: Deviations,
        navigation: NavigationErrors,
        turning: AttitudeControl,
    ) -> None:
        super().__init__(plan, flown, differs, navigation)
        self.turning = turning
        self.stretches: list[PathSegment] = []

    def leg(self, name: str, duration: float, engine: Propulsion = COASTING) -> None:
        """Fly a stretch without a jump for a duration (s), tick by tick."""
        if duration <= 0.0:
            return
        begin, first, end, start = self.t, self.y, self.t + duration, np.zeros(0)
        if self.turning.path.size:
            self._turn(begin, engine)  # the next nozzle must be active before the first acceleration is evaluated
            start = acceleration(begin, first, engine, self.around, self.turning)
        self._turn(end, engine)
        self.t = end
        if self.turning.path.size:
            a = np.stack([start, acceleration(end, self.y, engine, self.around, self.turning)])
            self.stretches.append(PathSegment(name, np.array([begin, end]), np.stack([first, self.y]), a))

    def _turn(self, end: float, engine: Propulsion, cutoff: Cutoff = NEVER) -> int:
        self.t, self.y, why = turn_piece(self.t, end, self.y, engine, self.around, self.turning, cutoff)
        return why

    def ignite_after(self, number: int) -> None:
        """Coast to the ignition of a stage, which is now the lowest."""
        self.turning.control.counts[STACK] = number
        super().ignite_after(number)

    def burn(self, number: int, duration: float | None, again: bool = False) -> None:
        """Burn a stage, which is the lowest."""
        self.turning.control.counts[STACK] = number
        super().burn(number, duration, again)

    def burn_until(self, end: float, push: Propulsion, cutoff: Cutoff) -> int:
        """Fly a piece of the last burn, tick by tick."""
        return self._turn(end, push, cutoff)

    def fly_nominal(self) -> None:
        """Fly from lift-off to the end of the final coast, with the burn times of the nominal flight."""
        for number in range(1, self.card.inserting):
            self.stage(number)
        self.into_orbit()
        self.events["injection"] = self.t
        self.events.pop("stage1_ignition")  # it is the lift-off
        self.leg("final coast", self.card.coast_after_injection)
