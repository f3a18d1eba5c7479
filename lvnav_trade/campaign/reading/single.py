"""One case of a campaign as a campaign of its own, for its full analysis."""

from lvnav_trade.campaign.definition.axes import Case, case_label
from lvnav_trade.campaign.definition.published import Published
from lvnav_trade.campaign.definition.schema import ByRule, Campaign
from lvnav_trade.campaign.syntax.tree import Written


def single(campaign: Campaign, case: Case) -> Campaign:
    """Return one case of a campaign as a campaign of its own, with the digest, runs and requirements of the case.

    Published numbers remain if they apply to this case alone. Solve, indices and tune are removed, because they refer
    to the whole campaign.
    """
    runs = campaign.monte_carlo
    if runs is not None:
        number = runs.runs_of(case.axes)
        changed = {"runs": number, "selected": {}, "other_runs": None, "cases": None, "most_cases": None}
        runs = runs.model_copy(update=changed) if number else None
    alone = campaign.model_copy(
        update={
            "name": f"{campaign.name}-{case.id}",
            "description": f"{case.label} of {campaign.name}: {case_label(case.axes)}",
            "base": case.scenario,
            "axes": (),
            "design": "grid",
            "samples": None,
            "store": None,
            "exclude": (),
            "constraints": (),
            "monte_carlo": runs,
            "references": tuple(
                published.model_copy(update={"case": {}})
                for published in campaign.references
                if _applies_to(published, case)
            ),
            "solve": None,
            "indices": None,
            "tune": None,
        }
    )
    alone._by_rule = ByRule()
    alone._written = Written()  # no places: a setting without effect on this case may have one on another
    return alone


def _applies_to(published: Published, case: Case) -> bool:
    """Whether a published number applies to one case and no other."""
    has_levels = all(case.axes.get(axis) == level for axis, level in published.case.items())
    return not published.pool and published.against is None and has_levels
