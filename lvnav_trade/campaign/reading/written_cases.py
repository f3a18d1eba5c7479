"""Cases of a campaign as they are written in its files, and a single case as a campaign."""

from collections.abc import Sequence

from lvnav_trade.campaign.definition import axes as design
from lvnav_trade.campaign.definition.axes import Case, case_label
from lvnav_trade.campaign.definition.published_cards import PublishedNumber
from lvnav_trade.campaign.definition.schema import Campaign, SpaceDefinition
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
    base_scenario : Scenario or None
        Scenario of the base; None if the base has input errors.
    """

    def __init__(
        self,
        base: tree.Node,
        axes: Sequence[WrittenAxis],
        levels: Sequence[Sequence[tree.Node]],
        base_scenario: Scenario | None,
    ) -> None:
        self.base, self.axes, self.levels = base, axes, levels
        self.has_valid_base = base_scenario is not None
        varied_sections = [written_axis.axis.steps[0] for written_axis in axes]
        self.scenarios = design.Scenarios(varied_sections, base_scenario, tree.plain_data)

    def node(self, level_indices: design.LevelIndices) -> tree.Node:
        """Return the tree of the case with these levels; InputError if a level refers to a missing item of a list."""
        node = self.base
        for written_axis, values, index in zip(self.axes, self.levels, level_indices, strict=True):
            if index is not None:
                node = marked.with_node(node, written_axis.axis.steps, values[index])
        return node

    def scenario(self, level_indices: design.LevelIndices) -> Scenario:
        """Return the scenario of the case with these levels; raises pydantic's ValidationError, and as `node`."""
        known_scenario = self.scenarios.find(level_indices)
        if known_scenario:
            return known_scenario
        node = self.node(level_indices)
        return self.scenarios.validate(level_indices, node.value)


def first_cases(
    design_name: str, axes: Sequence[WrittenAxis], sizes: Sequence[int]
) -> dict[tuple[int, int], design.LevelIndices]:
    """Return the first case with each level, by axis and level; axes that a later axis changes are omitted.

    Parameters
    ----------
    design_name : str
        Design of the campaign.
    axes : sequence of WrittenAxis
        The axes.
    sizes : sequence of int
        Number of levels of each axis.
    """
    has_cases = all(sizes) and (design_name != "zip" or len(set(sizes)) == 1)
    if not has_cases:
        return {}
    paths = [written_axis.axis.steps for written_axis in axes]
    unchanged_axes = []
    for number, path in enumerate(paths):
        later_paths = paths[number + 1 :]
        if not any(later_path[: len(path)] == path for later_path in later_paths):
            unchanged_axes.append(number)
    crossed_axes = [number for number, written_axis in enumerate(axes) if written_axis.axis.crossed]
    cases_by_level: dict[tuple[int, int], design.LevelIndices] = {}
    for level_indices in design.levels(design_name, sizes, crossed_axes):
        for number in unchanged_axes:
            level = level_indices[number]
            if level is not None:
                cases_by_level.setdefault((number, level), level_indices)
    return cases_by_level


def single_case(campaign: Campaign, case: Case) -> Campaign:
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
    single_campaign = campaign.model_copy(
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
    single_campaign._space_definition = SpaceDefinition()
    # no places: a setting without effect on this case may have one on another
    single_campaign._source_tree = SourceTree()
    return single_campaign


def _applies_to(published_number: PublishedNumber, case: Case) -> bool:
    """Whether a published number applies to one case and no other."""
    has_levels = all(case.axes.get(axis) == level for axis, level in published_number.case.items())
    return not published_number.pool and published_number.against is None and has_levels
