"""What a design of many takes beside its linear covariance, in processor time, alone and with shared passes; the plan's
estimate over what is measured.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from benchmarks.common import HERE
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.search.point import frozen_filter
from lvnav_trade.campaign.space.design_plan import estimate_designs
from lvnav_trade.campaign.space.evaluate_designs import EvaluatedDesigns, EvaluationRequest, evaluate
from lvnav_trade.campaign.space.numbered_designs import DesignSpace
from lvnav_trade.campaign.space.passes import HISTORY, shared_axes
from lvnav_trade.simulation.preparation.cache import trajectory_of

COUNT = 60


def measure() -> dict[str, float]:
    """Return processor time (ms) of a design beside its covariance, that of one that shares passes, and the time that
    `plan` estimates over the measured one.
    """
    campaign = load(HERE.parent / "campaigns/trade/space.yaml", [f"samples={COUNT}", "store=metrics"])
    asked = tuple(one.model_dump(mode="json") for one in campaign.requirements)
    alone = _warm(EvaluationRequest(asked, HISTORY), DesignSpace(campaign))
    base = campaign.base.model_copy(update={"filter": frozen_filter(campaign.base)})
    axes = tuple(axis for axis in campaign.axes if axis.path not in ("filter", "receiver"))
    together = DesignSpace(campaign.model_copy(update={"base": base, "axes": axes}))
    shared = _warm(EvaluationRequest(asked, HISTORY, shared_axes(together, HISTORY)), together)
    flight = trajectory_of(campaign.base)
    with tempfile.TemporaryDirectory() as folder:
        single = campaign.model_copy(update={"monte_carlo": None})
        whole = estimate_designs(single, Path(folder), {"": {"start": flight.start, "end": flight.end}})
    designs = whole.seconds_of_designs / len(DesignSpace(campaign))
    return {
        "design_beside_covariance_cpu_ms": 1e3 * (alone.seconds - alone.covariance_s) / COUNT,
        "design_over_covariance": alone.seconds / alone.covariance_s,
        "shared_design_cpu_ms": 1e3 * shared.seconds / COUNT,
        "shared_design_passes": shared.passes,
        "plan_over_measured": designs / (alone.seconds / COUNT),
    }


def _warm(question: EvaluationRequest, designs: DesignSpace) -> EvaluatedDesigns:
    """Return the rows of all designs, after kernels were loaded by a few."""
    evaluate(question, designs.batch(range(6)))
    return evaluate(question, designs.batch(range(COUNT)))


if __name__ == "__main__":
    print(measure())
