"""Checks of the settings that select cases: when, exclude, constraints, selected runs."""

from collections.abc import Iterator, Mapping, Sequence

from lvnav_trade.campaign.definition.axes import BASE_LABEL, axis_names, combinations, level_label
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.checks import meant, named_cases, unknown_case
from lvnav_trade.campaign.syntax.tree import Node, mistake_at
from lvnav_trade.quantities.errors import Mistake, quoted


def narrowing(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield the input errors of `when`, `exclude` and `constraints`.

    Unknown axes and levels, invalid expressions, and selections that exclude no case or all cases.
    """
    known = {
        name: [level_label(axis, index) for index in range(len(axis.values or ()))]
        for name, axis in zip(axis_names(campaign.axes), campaign.axes, strict=True)
    }
    wanted = [(f"axes.{k}.when", axis.when) for k, axis in enumerate(campaign.axes)]
    wanted += [(f"exclude.{k}", levels) for k, levels in enumerate(campaign.exclude)]
    errors = [mistake_at(root, path, message) for path, levels in wanted for message in _unknown_levels(levels, known)]
    errors += [
        mistake_at(root, f"exclude.{k}", "names no axis") for k, levels in enumerate(campaign.exclude) if not levels
    ]
    if errors:
        yield from errors
        return
    base = campaign.base.model_dump(mode="json")
    whole = combinations(campaign.design, campaign.axes, (), (), base)
    for key in ("exclude", "constraints"):
        for k, selection in enumerate(getattr(campaign, key)):
            alone = {"exclude": (), "constraints": ()} | {key: (selection,)}
            try:
                remaining = combinations(campaign.design, campaign.axes, alone["exclude"], alone["constraints"], base)
            except ValueError as error:
                yield mistake_at(root, f"{key}.{k}", str(error))
                continue
            if len(remaining) in (0, len(whole)):
                yield mistake_at(root, f"{key}.{k}", f"leaves {'nothing' if remaining else 'everything'} out")
    unlimited = combinations(campaign.design, [axis.model_copy(update={"when": {}}) for axis in campaign.axes])
    for k, axis in enumerate(campaign.axes):
        if axis.when and len(unlimited) == len(
            combinations(
                campaign.design,
                [other if other is axis else other.model_copy(update={"when": {}}) for other in campaign.axes],
            )
        ):
            yield mistake_at(root, f"axes.{k}.when", "no effect: every case has these levels")


def _unknown_levels(wanted: Mapping[str, str | Sequence[str]], known: Mapping[str, Sequence[str]]) -> Iterator[str]:
    for name, levels in wanted.items():
        if name not in known:
            yield f"no axis {quoted(name)}{meant(name, known)}"
            continue
        for level in [levels] if isinstance(levels, str) else levels:
            if level not in (*known[name], BASE_LABEL):
                yield f"no level {quoted(level)} of the axis {name}{meant(level, known[name])}"


def selection(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield an input error if the cases selected for all runs are no case or all cases."""
    chosen = campaign.monte_carlo.selected if campaign.monte_carlo is not None else {}
    if not chosen:
        return
    cases = named_cases(campaign)
    if message := unknown_case(chosen, cases):
        yield mistake_at(root, "monte_carlo.selected", message)
    elif all(case[axis] == level for case in cases for axis, level in chosen.items()):
        yield mistake_at(root, "monte_carlo.selected", "no effect: every case has these levels")
