"""Guided ascents, run by run: from draws and navigation errors to the state at cut-off."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.records import Floats
from lvnav_trade.world.ascent.dynamics import Engine
from lvnav_trade.world.ascent.legs import COASTING, STEP, Pilot, cuts, engine, mass_above
from lvnav_trade.world.ascent.vehicle import VehicleAscent
from lvnav_trade.world.guided.draws import Deviations, Sigmas, deviations, vehicle_of
from lvnav_trade.world.guided.dynamics import (
    CUT_OFF,
    DIVERGED,
    EMPTY,
    Cutoff,
    Law,
    Navigation,
    Surroundings,
    commanded,
    error_at,
    fly_last,
    fly_piece,
)
from lvnav_trade.world.guided.explicit import N_KEPT
from lvnav_trade.world.guided.reference import Plan

INJECTED, DEPLETED, LOST, ADRIFT = "injected", "depleted", "guidance diverged", "navigation failed"
_OUTCOMES = {CUT_OFF: INJECTED, EMPTY: DEPLETED, DIVERGED: LOST}
_CYCLE = 1.0  # s between two passes of explicit guidance
_FREEZE = 10.0  # s to go, below which it keeps its law: what it divides by vanishes with them
_LONGEST = 3.0  # whole burns, by which any propellant is gone
PERFECT = Navigation(np.array([0.0, 1.0]), np.zeros((2, 9)))


class Injection(NamedTuple):
    """How a run ends.

    outcome : One of `records.OUTCOMES`.
    t : s since lift-off. Time of the cut-off, or of what ended the flight before it.
    y : (7,). True position (m), velocity (m/s), frame i, and mass (kg) at that time.
    left : kg. Propellant left in the last stage.
    error : (9,). Navigation errors at that time, as in `Navigation`.
    """

    outcome: str
    t: float
    y: Floats
    left: float
    error: Floats


class GuidedPilot(Pilot):
    """Flies a dispersed vehicle by a plan.

    plan : What guidance knows before lift-off.
    differs : What differs beside the numbers of the vehicle.
    around : What the present piece is flown with.
    """

    def __init__(self, plan: Plan, flown: VehicleAscent, differs: Deviations, navigation: Navigation) -> None:
        super().__init__(flown, plan.aim, None)
        self.plan, self.differs = plan, differs
        last = plan.card.vehicle.stages[-1]
        law = Law(math.inf, plan.card.slew, _CYCLE, _FREEZE, last.exhaust_speed, plan.target, np.zeros(N_KEPT))
        self.around = Surroundings(
            plan.programme, navigation, self.drag, differs.wind, differs.misalignment[0].copy(), law
        )

    def leg(self, name: str, duration: float, engine: Engine = COASTING) -> None:
        """Fly a stretch without a jump for a duration (s)."""
        if duration > 0.0:
            self.y = fly_piece(self.t, self.t + duration, STEP, self.y, engine, self.around)
            self.t += duration

    def ignite_after(self, number: int) -> None:
        """Coast to the ignition of a stage, whose thrust is misaligned in its own way."""
        super().ignite_after(number)
        self.around = self.around._replace(misalignment=self.differs.misalignment[number - 1].copy())

    def separate(self, number: int) -> None:
        """Coast to the separation of a stage, which pushes."""
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

    def burn_until(self, end: float, push: Engine, cutoff: Cutoff) -> int:
        """Fly a piece of the last burn that ends at `end` (s) at the latest; return how it ends, as `fly_last` does."""
        self.t, self.y, why = fly_last(self.t, end, STEP, self.y, push, self.around, cutoff)
        return why

    def fly(self) -> str:
        """Fly from lift-off to the end of the last burn; return the outcome."""
        for number in range(1, self.card.inserting):
            self.stage(number)
        return self.last_burn()


def empty_mass(flown: VehicleAscent) -> float:
    """Return the mass (kg) of the last stage without propellant, with what it carries."""
    return flown.vehicle.stages[-1].dry + mass_above(flown, len(flown.vehicle.stages))


def inject(plan: Plan, sigmas: Sigmas, navigation: Navigation = PERFECT) -> Injection:
    """Fly one run.

    Parameters
    ----------
    plan : Plan
    sigmas : Draws in sigmas of the sources of the vehicle card, see `draws`.
    navigation : Navigation errors over the flight, as the filter has them on the nominal flight.
    """
    if not np.all(np.isfinite(navigation.error)):
        return Injection(ADRIFT, np.nan, np.full(7, np.nan), np.nan, np.full(9, np.nan))
    flown = vehicle_of(plan.card, sigmas)
    pilot = GuidedPilot(plan, flown, deviations(plan.card, sigmas), navigation)
    outcome = pilot.fly()
    left = float(pilot.y[6]) - empty_mass(flown)
    if outcome == INJECTED:
        pilot.push(pilot.differs.tail_off)
    return Injection(outcome, pilot.t, pilot.y, max(0.0, left), error_at(pilot.t, navigation))
