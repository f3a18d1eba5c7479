"""Decision 95: how far the commands of guidance in the last burn step because the navigation errs, in campaigns/drdc.

    python docs/design/schuler_commands.py

Each second of the last burn guidance has a new law. Its step is the angle between the commands by the law before and
after that pass, at the time of the pass. Navigation errors are those of the campaign `schuler`, of the vehicle without
draws. A command that is smoothed over a time T asks for an angular acceleration of step / T^2.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.quantities.records import Floats
from lvnav_trade.simulation.guided_runs import inertial_errors_of
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.preparation.prepare import prepare
from lvnav_trade.trajectory.ascent.equations_of_motion import Propulsion
from lvnav_trade.trajectory.guided.draws import deviations, run_vehicle
from lvnav_trade.trajectory.guided.guidance_plan import GuidancePlan, plan_ascent, steering_times
from lvnav_trade.trajectory.guided.guided_dynamics import (
    PERFECT,
    WHOLE,
    Cutoff,
    NavigationErrors,
    commanded_direction,
    fly_last,
)
from lvnav_trade.trajectory.guided.pilots import GuidedPilot

CAMPAIGN = Path(__file__).resolve().parents[2] / "campaigns" / "drdc" / "schuler.yaml"
RUNS = 20
SMOOTHED = (2.0, 1.0, 0.5)  # s, the times of the campaign `guidance`


class Watched(GuidedPilot):
    """Flies the last burn pass by pass, and keeps time to the cut-off's nominal time and step of every pass."""

    def __init__(self, plan: GuidancePlan, navigation: NavigationErrors) -> None:
        super().__init__(plan, run_vehicle(plan.card, {}), deviations(plan.card, {}), navigation)
        self.steps: list[tuple[float, float]] = []

    def burn_until(self, end: float, push: Propulsion, cutoff: Cutoff) -> int:
        """Fly a piece of the last burn; see `GuidedPilot`."""
        why = WHOLE
        while self.t < end - 1e-9 and why == WHOLE:
            begin, before = self.t, np.array(commanded_direction(self.t, self.inputs))
            until = min(begin + self.inputs.law.cycle, end)
            self.t, self.y, why = fly_last(begin, until, self.longest, self.y, push, self.inputs, cutoff)
            after = np.array(commanded_direction(begin, self.inputs))
            self.steps.append((begin, float(np.linalg.norm(np.cross(before, after)))))
        return why


def steps(plan: GuidancePlan, navigation: NavigationErrors) -> Floats:
    """Return times (s) and steps (rad) of the passes of one run, (n, 2)."""
    pilot = Watched(plan, navigation)
    pilot.fly()
    return np.array(pilot.steps)


def main() -> None:
    """Print root mean square and largest step by each law, with the navigation of the campaign and a perfect one."""
    campaign = load(CAMPAIGN)
    for case in cases(campaign)[1:]:
        prepared_case = prepare(case.scenario, history=1.0)
        plan = plan_ascent(case.scenario.trajectory)
        block = run_block(prepared_case, campaign.seed, 0, RUNS)
        part = steering_times(plan, prepared_case.record.t)
        flown = [
            steps(plan, NavigationErrors(prepared_case.record.t[part], error[part]))
            for error in inertial_errors_of(prepared_case, block.err)
        ]
        alone = steps(plan, PERFECT)
        start = prepared_case.trajectory.events["stage3_ignition"] + plan.card.slew
        for name, rows in (("navigated", np.concatenate(flown)), ("perfect", alone)):
            size = rows[rows[:, 0] > start, 1]
            rms, most = np.sqrt(np.mean(size**2)), size.max()
            asked = ", ".join(f"{most / t**2:.2e} over {t:g} s" for t in SMOOTHED)
            print(f"{case.label}, {name}: {np.degrees(rms):.4f} deg RMS, {np.degrees(most):.4f} most; rad/s^2 {asked}")
        rows = np.concatenate(flown)
        for first, last in ((-80, -60), (-60, -40), (-40, -20), (-20, -10)):
            inside = (rows[:, 0] >= plan.cutoff + first) & (rows[:, 0] < plan.cutoff + last)
            print(
                f"  {first} to {last} s from cut-off: {np.degrees(np.sqrt(np.mean(rows[inside, 1] ** 2))):.4f} deg RMS"
            )


if __name__ == "__main__":
    main()
