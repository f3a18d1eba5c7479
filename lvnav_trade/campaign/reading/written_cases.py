"""Cases of a campaign as they are written in its files, and a single case as a campaign."""

from collections.abc import Sequence

from lvnav_trade.campaign.definition import axes as design
from lvnav_trade.campaign.definition.axes import Case, case_label
from lvnav_trade.campaign.definition.published_cards import PublishedNumber
from lvnav_trade.campaign.definition.schema import ByRule, Campaign
from lvnav_trade.campaign.reading.axis_checks import WrittenAxis
from lvnav_trade.campaign.syntax import marked, tree
from lvnav_trade.campaign.syntax.tree import SourceTree
from lvnav_trade.scenario.scenario import Scenario


class WrittenCases:
    """Cases of a campaign as YAML trees, and the scenarios that result from them.

    Parameters
    ----------
    base : Node
        Tree of the base with all cards expanded.
    axes : sequence of WrittenAxis
        The axes.
    levels : sequence of sequence of Node
        For each axis the trees of its levels, with all cards expanded.
    valid : Scenario or None
        Scenario of the base; None if the base has input errors.
    """

    def __init__(
        self,
        base: tree.Node,
        axes: Sequence[WrittenAxis],
        levels: Sequence[Sequence[tree.Node]],
        valid: Scenario | None,
    ) -> None:
        self.base, self.axes, self.levels = base, axes, levels
        self.is_whole = valid is not None
        self.scenarios = design.Scenarios([varied.axis.steps[0] for varied in axes], valid, tree.plain)

    def node(self, chosen: design.Chosen) -> tree.Node:
        """Return the tree of the case with these levels; InputError if a level refers to a missing item of a list."""
        node = self.base
        for varied, values, index in zip(self.axes, self.levels, chosen, strict=True):
            if index is not None:
                node = marked.put(node, varied.axis.steps, values[index])
        return node

    def scenario(self, chosen: design.Chosen) -> Scenario:
        """Return the scenario of the case with these levels; raises pydantic's ValidationError, and as `node`."""
        known_scenario = self.scenarios.known(chosen)
        if known_scenario:
            return known_scenario
        node = self.node(chosen)
        return self.scenarios.validated(chosen, node.value)


def first_cases(kind: str, axes: Sequence[WrittenAxis], sizes: Sequence[int]) -> dict[tuple[int, int], design.Chosen]:
    """Return the first case with each level, by axis and level; axes that a later axis changes are omitted.

    Parameters
    ----------
    kind : str
        Design of the campaign.
    axes : sequence of WrittenAxis
        The axes.
    sizes : sequence of int
        Number of levels of each axis.
    """
    has_cases = all(sizes) and (kind != "zip" or len(set(sizes)) == 1)
    if not has_cases:
        return {}
    paths = [varied.axis.steps for varied in axes]
    unchanged = []
    for number, path in enumerate(paths):
        later_paths = paths[number + 1 :]
        if not any(later[: len(path)] == path for later in later_paths):
            unchanged.append(number)
    crossed = [number for number, varied in enumerate(axes) if varied.axis.crossed]
    first: dict[tuple[int, int], design.Chosen] = {}
    for chosen in design.levels(kind, sizes, crossed):
        for number in unchanged:
            level = chosen[number]
            if level is not None:
                first.setdefault((number, level), chosen)
    return first


def single(campaign: Campaign, case: Case) -> Campaign:
    """Return one case of a campaign as a campaign of its own, with the digest, runs and requirements of the case.

    Published numbers remain if they apply to this case alone. Solve, indices and tune are removed, because they refer
    to the whole campaign.
    """
    monte_carlo = campaign.monte_carlo
    if monte_carlo is not None:
        runs = monte_carlo.runs_of(case.axes)
        update = {"runs": runs, "selected": {}, "other_runs": None, "cases": None, "most_cases": None}
        monte_carlo = monte_carlo.model_copy(update=update) if runs else None
    references = [number for number in campaign.references if _applies_to(number, case)]
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
            "monte_carlo": monte_carlo,
            "references": tuple(number.model_copy(update={"case": {}}) for number in references),
            "solve": None,
            "indices": None,
            "tune": None,
        }
    )
    alone._by_rule = ByRule()
    alone._written = SourceTree()  # no places: a setting without effect on this case may have one on another
    return alone


def _applies_to(published: PublishedNumber, case: Case) -> bool:
    """Whether a published number applies to one case and no other."""
    has_levels = all(case.axes.get(axis) == level for axis, level in published.case.items())
    return not published.pool and published.against is None and has_levels
