"""``--set path=value``: one field of the campaign or of its base changed from the command line."""

from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.expand import expanded
from lvnav_trade.campaign.syntax import fields, tree
from lvnav_trade.campaign.syntax.cards import Shelf, nowhere
from lvnav_trade.errors import InputError, quoted
from lvnav_trade.scenario import Scenario

_HERE = "--set"


def apply(root: tree.Node, assignment: str, shelf: Shelf) -> tree.Node:
    """Return the campaign's tree with one assignment laid on top; InputError where it has no sense."""
    text, equals, value = assignment.partition("=")
    if not equals or not text.strip():
        raise InputError(f"{_HERE} {quoted(assignment)}: should be path=value, such as monte_carlo.runs=500")
    path = full_path(text.strip(), _HERE)
    _refuse_varied(root, path)
    return _set(root, path, _value(value, path), Campaign, shelf, "")


def full_path(text: str, where: str) -> list[str]:
    """Return the steps of a dotted path from the top of the campaign; `base.` may be left out."""
    path = text.split(".")
    if path[0] in Campaign.model_fields:
        return path
    if path[0] in Scenario.model_fields:
        return ["base", *path]
    known, old = (*Campaign.model_fields, *Scenario.model_fields), fields.old_key(Scenario, path[0])
    raise InputError(f"{where}: {text}: {old or f'unknown path{tree.hint(path[0], known)}'}")


def _value(text: str, path: list[str]) -> tree.Node:
    """Return the YAML value of an assignment, standing nowhere in a file."""
    where = nowhere(_HERE)
    if not text.strip():
        raise tree.refuse(where, ".".join(path), "has no value after '='")
    try:
        return tree.from_plain(tree.plain(tree.parse(text, _HERE, where.folder)), where)
    except InputError as error:
        raise tree.refuse(where, ".".join(path), f"{quoted(text)}: {error.records[0].message}") from None


def _refuse_varied(root: tree.Node, path: list[str]) -> None:
    """Refuse to set what an axis varies: the axis would win, and the assignment be lost without a word."""
    axes = tree.find(root, ["axes"])
    if path[0] != "base" or axes is None or not axes.is_list:
        return
    for index, axis in enumerate(axes.value):
        varied = tree.find(axis, ["path"])
        steps = str(varied.value).removeprefix("base.").split(".") if varied else []
        if steps and steps == path[1 : 1 + len(steps)]:
            message = f"is varied by axis {index} ({varied.value if varied else ''}); set axes.{index} instead"
            raise tree.refuse(nowhere(_HERE), ".".join(path), message)


def _set(node: tree.Node, path: list[str], value: tree.Node, kind: fields.Kind, shelf: Shelf, at: str) -> tree.Node:
    """Return `node` with `value` at `path`; a card on the way is opened first."""
    if not path:
        return value
    key, rest = path[0], path[1:]
    if fields.models(kind) and (isinstance(node.value, str) or tree.find(node, ["card"])):
        node = expanded(node, kind, shelf, at)
    if fields.item(kind, 0) is not None:
        items = node if node.is_list else tree.Node([], node.place)
        index = tree.index_of(key, items.value, value.place, at)
        item = _set(items.value[index], rest, value, fields.item(kind, index), shelf, tree.join(at, key))
        return tree.with_item(items, index, item)
    now = fields.member(kind, node) if len(fields.models(kind)) > 1 else None
    if now is not None and key in fields.names(kind) and key not in fields.by_key(now):  # it makes it another kind
        return tree.put(tree.Node({}, value.place), path, value)
    if key not in fields.names(kind) and fields.entries(kind) is None:
        near = fields.old_key(kind, key) or f"unknown path{tree.hint(key, fields.names(kind, node))}"
        raise tree.refuse(value.place, tree.join(at, key), near)
    start = node if node.is_map else tree.Node({}, value.place)
    old = start.value.get(key, tree.Node(None, value.place))
    below = fields.child(kind, key, start)
    return tree.with_child(start, key, _set(old, rest, value, below, shelf, tree.join(at, key)), start.keys.get(key))
