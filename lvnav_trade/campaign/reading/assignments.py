"""Assignments to the settings of a campaign, such as ``monte_carlo.runs=500`` on the command line."""

from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.expand import expanded_tree
from lvnav_trade.campaign.syntax import fields, marked, tree
from lvnav_trade.campaign.syntax.card_lookup import Shelf, command_line_place
from lvnav_trade.quantities.errors import InputError, quoted
from lvnav_trade.scenario.scenario import Scenario


def apply(root: tree.Node, assignment: str, shelf: Shelf) -> tree.Node:
    """Return the campaign's tree with one assignment applied; InputError if the assignment is invalid.

    Parameters
    ----------
    root : tree.Node
        Tree of the campaign.
    assignment : str
        ``path=value``, with the value in YAML.
    shelf : Shelf
        Cards that the assignment can name.
    """
    text, equals, value = assignment.partition("=")
    if not equals or not text.strip():
        raise InputError(f"{tree.HERE} {quoted(assignment)}: should be path=value, such as monte_carlo.runs=500")
    path = full_path(text.strip(), tree.HERE)
    _refuse_varied_field(root, path)
    return _put_value(root, path, _parsed_value(value, path), Campaign, shelf, "")


def full_path(text: str, message_prefix: str) -> list[str]:
    """Return the steps of a dotted path from the top of the campaign.

    Parameters
    ----------
    text : str
        Dotted path; `base.` may be omitted.
    message_prefix : str
        Beginning of an error message.

    Raises
    ------
    InputError
        There is no field with the first step as its name.
    """
    path = text.split(".")
    if path[0] in Campaign.model_fields:
        return path
    if path[0] in Scenario.model_fields:
        return ["base", *path]
    replacement = fields.old_key_message(Scenario, path[0])
    if replacement:
        raise InputError(f"{message_prefix}: {text}: {replacement}")
    names = (*Campaign.model_fields, *Scenario.model_fields)
    suggestion = tree.hint(path[0], names) or f" (known: {', '.join(names)})"
    raise InputError(f"{message_prefix}: {text}: unknown path{suggestion}")


def _parsed_value(text: str, path: list[str]) -> tree.Node:
    """Return the YAML value of an assignment, which has no place in a file."""
    place = command_line_place(tree.HERE)
    if not text.strip():
        raise tree.refuse(place, ".".join(path), "has no value after '='")
    try:
        value_node = tree.parse(text, tree.HERE, place.folder)
        return tree.node_from_data(tree.plain_data(value_node), place)
    except InputError as error:
        message = error.records[0].message
        raise tree.refuse(place, ".".join(path), f"{quoted(text)}: {message}") from None


def _refuse_varied_field(root: tree.Node, path: list[str]) -> None:
    """Refuse to set a field that an axis varies: the axis would silently override the assignment."""
    axes = tree.find(root, ["axes"])
    if path[0] != "base" or axes is None or not axes.is_list:
        return
    for index, axis in enumerate(axes.value):
        varied_path = tree.find(axis, ["path"])
        if varied_path is None:
            continue
        steps = str(varied_path.value).removeprefix("base.").split(".")
        leading_steps = path[1 : 1 + len(steps)]
        if steps == leading_steps:
            message = f"is varied by axis {index} ({varied_path.value}); set axes.{index} instead"
            raise tree.refuse(command_line_place(tree.HERE), ".".join(path), message)


def _put_value(
    node: tree.Node, steps: list[str], value: tree.Node, annotation: fields.Annotation, shelf: Shelf, path: str
) -> tree.Node:
    """Return settings with a new value; a card on the way is expanded first.

    Parameters
    ----------
    node : tree.Node
        Settings at `path`.
    steps : list of str
        Keys from these settings to the value.
    value : tree.Node
        New value.
    annotation : fields.Annotation
        Annotation of the settings.
    shelf : Shelf
        Cards that the settings can name.
    path : str
        Dotted path of the settings, for messages.

    Raises
    ------
    InputError
        There is no such path.
    """
    if not steps:
        return value
    key = steps[0]
    remaining_steps = steps[1:]
    child_path = tree.join(path, key)
    is_card = isinstance(node.value, str) or tree.find(node, ["card"]) is not None
    if is_card and fields.models(annotation):
        node = expanded_tree(node, annotation, shelf, path)
    if fields.item(annotation, 0) is not None:
        items = node if node.is_list else tree.Node([], node.place)
        index = tree.index_of(key, items.value, value.place, path)
        item_annotation = fields.item(annotation, index)
        item = _put_value(items.value[index], remaining_steps, value, item_annotation, shelf, child_path)
        return tree.with_item(items, index, item)
    if _changes_kind(node, key, annotation):
        no_settings = tree.Node({}, value.place)
        return tree.with_node(no_settings, steps, value)
    if key not in fields.names(annotation) and fields.entries(annotation) is None:
        suggestion = tree.hint(key, fields.names(annotation, node))
        message = fields.old_key_message(annotation, key) or f"unknown path{suggestion}"
        raise tree.refuse(value.place, child_path, message)
    settings = node if node.is_map else tree.Node({}, value.place)
    child = settings.value.get(key, tree.Node(None, value.place))
    child_annotation = fields.child(annotation, key, settings)
    changed_child = _put_value(child, remaining_steps, value, child_annotation, shelf, child_path)
    place = settings.keys.get(key)
    return tree.with_child(marked.without_marks(settings, steps), key, changed_child, place)


def _changes_kind(node: tree.Node, key: str, annotation: fields.Annotation) -> bool:
    """Whether a key belongs to another alternative of an annotation than the present settings."""
    if len(fields.models(annotation)) < 2:
        return False
    present_model = fields.member(annotation, node)
    if present_model is None:
        return False
    return key in fields.names(annotation) and key not in fields.fields_by_key(present_model)
