"""One case of a campaign as a campaign of its own, for its full analysis."""

from lvnav_trade.campaign.definition.axes import Case, case_label
from lvnav_trade.campaign.definition.published import Published
from lvnav_trade.campaign.definition.schema import ByRule, Campaign
from lvnav_trade.campaign.syntax.tree import Written


def single(campaign: Campaign, case: Case) -> Campaign:
    """Return a campaign whose base is a case of another one, with its digest, runs and requirements.

    Published numbers stay where they are of this case alone. Solve, indices and tune are left out: they are questions
    about the whole campaign.
    """
    runs = campaign.monte_carlo
    if runs is not None:
        number = runs.runs_of(case.axes)
        changed = {"runs": number, "selected": {}, "other_runs": None, "cases": None, "most_cases": None}
        runs = runs.model_copy(update=changed) if number else None
    found = campaign.model_copy(
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
                one.model_copy(update={"case": {}}) for one in campaign.references if _is_of(one, case)
            ),
            "solve": None,
            "indices": None,
            "tune": None,
        }
    )
    found._by_rule = ByRule()
    found._written = Written()  # what is without effect on this case may have one on another
    return found


def _is_of(one: Published, case: Case) -> bool:
    """Whether a published number is of one case and of no other."""
    return (
        not one.pool and one.against is None and all(case.axes.get(axis) == level for axis, level in one.case.items())
    )
