"""Sets of requirements on cards: what a campaign names by a word becomes the requirements of that card."""

from pydantic import Field, ValidationError

from lvnav_trade.campaign.definition.schema import Requirement
from lvnav_trade.campaign.reading.explain import explain
from lvnav_trade.campaign.syntax import tree
from lvnav_trade.campaign.syntax.cards import Shelf
from lvnav_trade.campaign.syntax.tree import Node
from lvnav_trade.errors import InputError, Mistake
from lvnav_trade.units import Card


class RequirementSet(Card):
    """Requirements that belong together, such as those of one mission, and where they are from."""

    name: str
    source: str
    requirements: tuple[Requirement, ...] = Field(min_length=1)


def splice(root: Node, shelf: Shelf) -> tuple[Node, list[Mistake]]:
    """Return the campaign's tree with every named set replaced by its requirements, and the mistakes met.

    ``requirements: [requirements/ariane5_hybrid, {card: requirements/ariane5_hybrid, at: stage1_cutoff}, {...}]``: a
    set by its name, one of which every requirement is changed in some fields, and a requirement written out. Whatever
    comes from a card keeps its place there, so that a mistake is reported where it can be mended.
    """
    node = tree.find(root, ["requirements"])
    if node is None or not node.is_list:
        return root, []
    items: list[Node] = []
    mistakes: list[Mistake] = []
    for index, item in enumerate(node.value):
        if item.is_map and "card" not in item.value:
            items.append(item)
            continue
        try:
            items += _members(item, f"requirements.{index}", shelf)
        except InputError as error:
            mistakes += error.records
    return tree.with_child(root, "requirements", Node(items, node.place), root.keys["requirements"]), mistakes


def _members(item: Node, path: str, shelf: Shelf) -> list[Node]:
    """Return the requirements of a set, those fields changed that stand beside its name."""
    reference = item.value["card"] if item.is_map else item
    if not isinstance(reference.value, str):
        raise tree.refuse(reference.place, path, "should be a requirement, or the name of a set of them")
    card = shelf.read(reference, path)
    over = tree.without(item, "card") if item.is_map else Node({}, item.place)
    for key in over.value:
        if key == "name" or key not in Requirement.model_fields:
            known = [name for name in Requirement.model_fields if name != "name"]
            message = f"cannot be changed for a whole set{tree.hint(key, known)}"
            raise tree.refuse(over.keys[key], f"{path}.{key}", message)
    if "requirements" not in card.value:
        raise tree.refuse(reference.place, path, f"{reference.value!r} is no set of requirements")
    try:
        RequirementSet.model_validate(tree.plain(card))
    except ValidationError as error:
        raise InputError(records=explain(error, card, RequirementSet, path)) from None
    members: list[Node] = tree.find(card, ["requirements"]).value  # type: ignore[union-attr]
    return [_changed(member, over) for member in members]


def _changed(member: Node, over: Node) -> Node:
    """Return a requirement with fields laid on top; an event takes the place of a phase, and the other way round."""
    for key, other in (("at", "during"), ("during", "at")):
        if key in over.value and other in member.value and other not in over.value:
            member = tree.without(member, other)
    for key, child in over.value.items():
        member = tree.with_child(member, key, child, over.keys[key])
    return member
