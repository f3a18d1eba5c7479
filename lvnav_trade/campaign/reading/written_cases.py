"""Cases of a campaign as YAML trees, and the scenarios that result from them."""

from collections.abc import Sequence

from lvnav_trade.campaign.definition import axes as design
from lvnav_trade.campaign.reading.checks import Varied
from lvnav_trade.campaign.syntax import marked, tree
from lvnav_trade.scenario.scenario import Scenario


class WrittenCases:
    """Cases of a campaign as YAML trees, and the scenarios that result from them.

    Parameters
    ----------
    base : Node
        Tree of the base with all cards expanded.
    axes : sequence of Varied
        The axes.
    levels : sequence of sequence of Node
        For each axis the trees of its levels, with all cards expanded.
    valid : Scenario or None
        Scenario of the base; None if the base has input errors.
    """

    def __init__(
        self, base: tree.Node, axes: Sequence[Varied], levels: Sequence[Sequence[tree.Node]], valid: Scenario | None
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
        return self.scenarios.known(chosen) or self.scenarios.validated(chosen, self.node(chosen).value)


def first_cases(kind: str, axes: Sequence[Varied], sizes: Sequence[int]) -> dict[tuple[int, int], design.Chosen]:
    """Return the first case with each level, by axis and level; axes that a later axis changes are omitted."""
    first: dict[tuple[int, int], design.Chosen] = {}
    paths = [varied.axis.steps for varied in axes]
    changed = [any(later[: len(path)] == path for later in paths[k + 1 :]) for k, path in enumerate(paths)]
    crossed = [place for place, varied in enumerate(axes) if varied.axis.crossed]
    is_whole = all(sizes) and (kind != "zip" or len(set(sizes)) == 1)
    for chosen in design.levels(kind, sizes, crossed) if is_whole else ():
        for place, index in enumerate(chosen):
            if index is not None and not changed[place]:
                first.setdefault((place, index), chosen)
    return first
