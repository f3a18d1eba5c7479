"""The cases of a campaign as they are written in its files, and the scenarios that they make."""

from collections.abc import Sequence

from lvnav_trade.campaign.definition import axes as design
from lvnav_trade.campaign.reading.checks import Varied
from lvnav_trade.campaign.syntax import marked, tree
from lvnav_trade.scenario import Scenario


class WrittenCases:
    """The cases of a campaign as they are written, and the scenarios that they make.

    Parameters
    ----------
    base
        The base with all cards in place.
    axes, levels
        The axes, and the tree of each of their levels with its cards in place.
    valid
        The base's scenario; None where it has mistakes.
    """

    def __init__(
        self, base: tree.Node, axes: Sequence[Varied], levels: Sequence[Sequence[tree.Node]], valid: Scenario | None
    ) -> None:
        self.base, self.axes, self.levels = base, axes, levels
        self.is_whole = valid is not None
        self.scenarios = design.Scenarios([varied.axis.steps[0] for varied in axes], valid, tree.plain)

    def node(self, chosen: design.Chosen) -> tree.Node:
        """Return the tree of the case with these levels; InputError where the base with the others has no such item."""
        node = self.base
        for varied, values, index in zip(self.axes, self.levels, chosen, strict=True):
            if index is not None:
                node = marked.put(node, varied.axis.steps, values[index])
        return node

    def scenario(self, chosen: design.Chosen) -> Scenario:
        """Return the scenario of the case with these levels; ValidationError as pydantic's, InputError as of `node`."""
        return self.scenarios.known(chosen) or self.scenarios.validated(chosen, self.node(chosen).value)


def first_cases(kind: str, axes: Sequence[Varied], sizes: Sequence[int]) -> dict[tuple[int, int], design.Chosen]:
    """Return the first case of a design that has a level, by axis and level; none where a later axis changes it."""
    found: dict[tuple[int, int], design.Chosen] = {}
    steps = [varied.axis.steps for varied in axes]
    changed = [any(one[: len(mine)] == mine for one in steps[k + 1 :]) for k, mine in enumerate(steps)]
    crossed = [place for place, varied in enumerate(axes) if varied.axis.crossed]
    is_whole = all(sizes) and (kind != "zip" or len(set(sizes)) == 1)
    for chosen in design.levels(kind, sizes, crossed) if is_whole else ():
        for place, index in enumerate(chosen):
            if index is not None and not changed[place]:
                found.setdefault((place, index), chosen)
    return found
