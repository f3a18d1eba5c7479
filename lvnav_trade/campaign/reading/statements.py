"""Statements that name what a campaign does not have: cases, axes, levels; or a unit that the metric does not have."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from lvnav_trade.campaign.definition.axes import choice, levels
from lvnav_trade.campaign.definition.published import taken_apart
from lvnav_trade.campaign.definition.schema import FRAME_AXES, Campaign
from lvnav_trade.campaign.syntax.tree import Node, hint, is_index, join, mistake, nearest
from lvnav_trade.errors import Mistake, quoted


def named_cases(campaign: Campaign) -> list[dict[str, str]]:
    """Return the level of every axis of every case, by name; the axes of the campaign have labels.

    Where one axis is varied at a time, the base's own value is no case beside the base.
    """
    sizes = [len(axis.values or ()) for axis in campaign.axes]
    base = campaign.base.model_dump(mode="json")
    own = [_value(base, axis.path.split(".")) for axis in campaign.axes]
    return [
        choice(campaign.axes, chosen)
        for chosen in levels(campaign.design, sizes)
        if campaign.design != "one_at_a_time"
        or not any(
            index is not None and (axis.values or ())[index] == value
            for index, axis, value in zip(chosen, campaign.axes, own, strict=True)
        )
    ]


def _value(data: Any, path: Sequence[str]) -> Any:
    """Return what stands at a path of nested mappings and lists; None where nothing does."""
    for key in path:
        if isinstance(data, list) and is_index(key) and int(key) < len(data):
            data = data[int(key)]
        else:
            data = data.get(key) if isinstance(data, dict) else None
    return data


def unknown_case(wanted: Mapping[str, str], cases: Sequence[Mapping[str, str]], single: bool = False) -> str:
    """Say why no case has the levels wanted, by axis; nothing where one has. `single`: where it is not exactly one."""
    for axis, level in wanted.items():
        names = list(cases[0]) if cases else []
        if axis not in names:
            return f"no axis {quoted(axis)}{hint(axis, names) or _known(names)}"
        known = list(dict.fromkeys(case[axis] for case in cases))
        if level not in known:
            return f"no level {quoted(level)} of the axis {axis}{hint(level, known) or _known(known)}"
    count = sum(all(case[axis] == level for axis, level in wanted.items()) for case in cases)
    if not count:
        return "no case has these levels together"
    return f"{count} cases have these levels; name one" if single and count > 1 else ""


def _known(names: Sequence[str]) -> str:
    shown = [quoted(name).strip("'\"") for name in names[:12]]
    return f" (known: {', '.join(shown)}{', ...' if len(names) > len(shown) else ''})" if names else ""


def mistakes(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield what references, orderings and statements on innovations name and the campaign does not have."""
    cases = named_cases(campaign)
    for path, wanted, single in _wanted(campaign):
        message = unknown_case(wanted, cases, single)
        if message:
            yield mistake(nearest(root, path.split(".")), path, message)
    yield from _axes_of_metrics(campaign, root)


def narrowed(campaign: Campaign) -> Campaign:
    """Return a campaign whose axes an assignment has changed, without the statements on levels that are gone."""
    cases = named_cases(campaign)

    def stands(*wanted: Mapping[str, str]) -> bool:
        return not any(unknown_case(one, cases) for one in wanted)

    return campaign.model_copy(
        update={
            "references": tuple(r for r in campaign.references if stands(r.case, r.against or {})),
            "orderings": tuple(order for order in campaign.orderings if stands(*order.cases)),
            "innovations": tuple(one for one in campaign.innovations if stands(one.case)),
        }
    )


def _wanted(campaign: Campaign) -> Iterator[tuple[str, Mapping[str, str], bool]]:
    """Yield path, levels by axis, and whether exactly one case is meant."""
    for index, one in enumerate(campaign.references):
        yield f"references.{index}.case", one.case, False
        if one.against is not None:
            yield f"references.{index}.against", one.against, True
    for index, order in enumerate(campaign.orderings):
        yield from ((f"orderings.{index}.cases.{place}", case, True) for place, case in enumerate(order.cases))
    for index, statement in enumerate(campaign.innovations):
        yield f"innovations.{index}.case", statement.case, False


def _axes_of_metrics(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield the metrics of statements on an axis that no case's frame has."""
    frames = {
        campaign.base.frame,
        *(str(v) for axis in campaign.axes if axis.path == "frame" for v in axis.values or ()),
    }
    known = tuple(dict.fromkeys(name for frame in sorted(frames) for name in FRAME_AXES[frame]))
    for key, statements in (("references", campaign.references), ("orderings", campaign.orderings)):
        for index, one in enumerate(statements):
            quantity, axis = taken_apart(one.metric)
            wanted = ("roll", "pitch", "yaw") if quantity == "attitude" else known
            if quantity in ("attitude", "velocity", "position") and axis not in (*wanted, "3d"):
                message = f"{quoted(one.metric)}: no such axis; {quantity} has {', '.join(wanted)}"
                yield mistake(nearest(root, [key, index, "metric"]), join(join(key, index), "metric"), message)


def of_study(part: Any, campaign: Campaign) -> Iterator[tuple[str, str]]:
    """Yield path within a part of a study and message for the cases and axes that the part names and its campaign does
    not have.
    """
    cases = named_cases(campaign)
    wanted = [(f"figures.{i}.case", figure.case, False) for i, figure in enumerate(part.figures)]
    wanted += [(f"figures.{i}.cases.{k}", one, False) for i, figure in enumerate(part.figures)
               for k, one in enumerate(figure.cases)]  # fmt: skip
    wanted += [(f"flown.{i}.case", one.case, False) for i, one in enumerate(part.flown)]
    wanted += [("kml", part.kml or {}, False)]
    if part.single is not None:
        wanted += [("single.aided", part.single.aided, False), ("single.unaided", part.single.unaided, False)]
    for path, one, single in wanted:
        message = unknown_case(one, cases, single)
        if message:
            yield path, message
    if part.paired and part.paired not in cases[0]:
        yield "paired", f"no axis {quoted(part.paired)}{hint(part.paired, cases[0]) or _known(list(cases[0]))}"
