"""Which designs share passes: too few do not, nor those for which the trial fails."""

from __future__ import annotations

from lvnav_trade.campaign.search.point import frozen_filter
from lvnav_trade.campaign.space.numbered_designs import DesignSpace, make_designs
from lvnav_trade.campaign.space.passes import HISTORY, CovariancePasses, group_passes


def designs_of(campaign):
    base = campaign.base.model_copy(update={"filter": frozen_filter(campaign.base)})
    return DesignSpace(campaign.model_copy(update={"base": base, "axes": campaign.axes[:2]}))


def test_few_designs_have_passes_of_their_own(campaign) -> None:
    part = designs_of(campaign).batch(range(4))
    passes = CovariancePasses()
    assert group_passes(part, list(make_designs(part)), (0, 1), HISTORY, passes) is None
    assert passes.count == 0


def test_passes_are_counted_and_shared(campaign) -> None:
    part = designs_of(campaign).batch(range(8))
    passes, designs = CovariancePasses(), list(make_designs(part))
    together = group_passes(part, designs, (0, 1), HISTORY, passes)
    assert together is not None
    assert (passes.count, together.axes) == (4, (0, 1))
    assert passes.seconds > 0.0
    assert together.sigmas(designs[3])[1] == designs[3].case.scenario.initial.heading  # type: ignore[union-attr]


def test_an_axis_that_is_no_true_sigma_is_found_out_by_the_trial(campaign) -> None:
    """Time constants do not enter by their square."""
    base = campaign.base.model_copy(update={"filter": frozen_filter(campaign.base)})
    axis = campaign.axes[1].model_copy(
        update={
            "path": "imu.gyro.instability_time",
            "values": tuple(f"{10.0 + 20.0 * k} s" for k in range(40)),
            "labels": tuple(f"{10.0 + 20.0 * k} s" for k in range(40)),
        }
    )
    part = DesignSpace(campaign.model_copy(update={"base": base, "axes": (axis,)})).batch(range(40))
    passes = CovariancePasses()
    assert group_passes(part, list(make_designs(part)), (0,), HISTORY, passes) is None
    assert passes.count == 3
