"""Expansion of written settings: cards and sets are read, overrides applied, kinds inferred, paths made absolute."""

import os

from pydantic import Field, ValidationError

from lvnav_trade.campaign.definition.schema import Requirement
from lvnav_trade.campaign.reading.explain import explain
from lvnav_trade.campaign.syntax import fields, tree
from lvnav_trade.campaign.syntax.card_lookup import Shelf
from lvnav_trade.campaign.syntax.fields import Annotation
from lvnav_trade.campaign.syntax.marked import with_remaining_marks
from lvnav_trade.campaign.syntax.tree import Node, join, mistake
from lvnav_trade.quantities.errors import InputError, Mistake, quoted, refuse_all
from lvnav_trade.quantities.input_limits import MESSAGES
from lvnav_trade.quantities.units import Card

_MAX_DEPTH = 16


class _Expander:
    """Expands trees according to the settings models, and collects input errors."""

    def __init__(self, shelf: Shelf) -> None:
        self.shelf = shelf
        self.mistakes: list[Mistake] = []

    def expand(self, node: Node, annotation: Annotation, path: str, depth: int = 0) -> Node:
        """Return the tree with all cards expanded; on an input error, collect it and return the tree unchanged.

        Parameters
        ----------
        node : Node
            Tree of settings.
        annotation : Annotation
            Annotation of the settings.
        path : str
            Dotted path of the settings, for messages.
        depth : int
            Number of cards that lead to this tree.
        """
        if fields.models(annotation):
            return self._settings(node, annotation, path, depth)
        if node.is_list and fields.item(annotation, 0) is not None:
            items = []
            for index, child in enumerate(node.value):
                items.append(self.expand(child, fields.item(annotation, index), join(path, index), depth))
            return Node(items, node.place)
        return self._entries(node, annotation, path, depth, None) if node.is_map else node

    def _entries(self, node: Node, annotation: Annotation, path: str, depth: int, overridden_card: Node | None) -> Node:
        """Expand each entry of a mapping with free keys.

        Parameters
        ----------
        node : Node
            The mapping.
        annotation : Annotation
            Annotation of the mapping.
        path : str
            Dotted path of the mapping, for messages.
        depth : int
            Number of cards that lead to this tree.
        overridden_card : Node or None
            Card that the mapping overrides.
        """
        entry_annotation = fields.entries(annotation)
        if entry_annotation is None:
            return node
        for key, child in list(node.value.items()):
            overridden_entry = tree.find(overridden_card, [key]) if overridden_card is not None else None
            changes_fields = overridden_entry is not None and overridden_entry.is_map and child.is_map
            if changes_fields and "card" not in child.value:
                entry = self._mapping(child, entry_annotation, join(path, key), depth, overridden_entry)
            else:
                entry = self.expand(child, entry_annotation, join(path, key), depth)
            node = tree.with_child(node, key, entry, node.keys[key])
        return node

    def _settings(self, node: Node, annotation: Annotation, path: str, depth: int) -> Node:
        if not node.is_map:
            if node.value in fields.literals(annotation) or not isinstance(node.value, str):
                return node
            return self._card(node, node, annotation, path, depth)
        if "card" in node.value and "card" not in fields.names(annotation):
            return self._card(node, node.value["card"], annotation, path, depth)
        return self._mapping(node, annotation, path, depth)

    def _card(self, node: Node, reference: Node, annotation: Annotation, path: str, depth: int) -> Node:
        """Read the card named by `reference`, and apply the override of its fields.

        Parameters
        ----------
        node : Node
            The reference itself, or a mapping that overrides fields of the card.
        reference : Node
            Name of the card.
        annotation : Annotation
            Annotation of the settings.
        path : str
            Dotted path of the settings, for messages.
        depth : int
            Number of cards that lead to this card.
        """
        if len(self.mistakes) > MESSAGES:
            return node  # suggestions for a thousand unknown names would take too long
        if depth > _MAX_DEPTH:
            message = f"the card {quoted(reference.value)} leads back to itself"
            self.mistakes.append(mistake(reference.place, path, message))
            return node
        try:
            if not isinstance(reference.value, str):
                raise tree.refuse(reference.place, path, "a card is named by a word such as imu/tactical_fog")
            name = reference.value
            if name in fields.tags(annotation) and self.shelf.find(name, reference.place.folder) is None:
                raise tree.refuse(reference.place, path, f"no card {quoted(name)} (did you mean {{kind: {name}}}?)")
            card = self.shelf.read(reference, path, fields.literals(annotation))
        except InputError as error:
            self.mistakes.extend(error.records)
            return node
        settings = self._settings(card, annotation, path, depth + 1)
        if not node.is_map:
            return settings
        # An override may itself name a card one level down, and the overridden settings may be named by a card.
        override = tree.without_key(node, "card")
        if _is_other_kind(settings, override, annotation):
            self.mistakes.append(_other_kind_mistake(name, settings, override, annotation, path))
            return settings
        expanded_override = self._mapping(override, annotation, path, depth, settings)
        return _with_override(settings, expanded_override, override, annotation)

    def _mapping(
        self, node: Node, annotation: Annotation, path: str, depth: int, overridden_card: Node | None = None
    ) -> Node:
        """Return settings with the cards in their fields expanded.

        Parameters
        ----------
        node : Node
            Mapping of settings.
        annotation : Annotation
            Annotation of the settings.
        path : str
            Dotted path of the settings, for messages.
        depth : int
            Number of cards that lead to this tree.
        overridden_card : Node, optional
            Card that the settings override.
        """
        if fields.entries(annotation) is not None:
            return self._entries(node, annotation, path, depth, overridden_card)
        model = fields.member(annotation, overridden_card or node)
        if model is None:
            return node
        tag = fields.model_tag(model)
        if tag and overridden_card is None and "kind" not in node.value and len(fields.models(annotation)) > 1:
            node = tree.with_child(node, "kind", Node(tag, node.place))
        for key, child in list(node.value.items()):
            child_annotation = fields.child(model, key, child)
            if child_annotation is None:
                continue
            child_path = join(path, key)
            overridden_child = tree.find(overridden_card, [key]) if overridden_card is not None else None
            if fields.is_path(model, key):
                expanded_child = self._file(child, child_path)
            elif overridden_card is not None and _changes_fields(overridden_child, child, child_annotation):
                expanded_child = self._mapping(child, child_annotation, child_path, depth, overridden_child or child)
            else:
                expanded_child = self.expand(child, child_annotation, child_path, depth)
            node = tree.with_child(node, key, expanded_child, node.keys[key])
        return node

    def _file(self, node: Node, path: str) -> Node:
        """Return the absolute path of one or several existing files, given relative to the file that names them."""
        if node.is_list:
            files = [self._file(child, join(path, index)) for index, child in enumerate(node.value)]
            return Node(files, node.place)
        if not isinstance(node.value, str):
            return node
        file = node.place.folder / node.value
        if not os.path.isfile(file):
            problem = "is a folder, not a file" if os.path.isdir(file) else "no such file"
            self.mistakes.append(mistake(node.place, path, f"{problem}: {quoted(node.value)}"))
            return node
        return Node(str(file.resolve()), node.place)


def _changes_fields(base: Node | None, override: Node, annotation: Annotation) -> bool:
    """Whether an override changes fields of the base, and does not replace the base as a whole."""
    return override.is_map and not _replaces(base, override, annotation)


def _replaces(base: Node | None, override: Node, annotation: Annotation) -> bool:
    """Whether an override replaces the base as a whole: it names a card, or is of another kind than the base."""
    return "card" in override.value or (base is not None and _is_other_kind(base, override, annotation))


def _is_other_kind(base: Node, override: Node, annotation: Annotation) -> bool:
    """Whether both are settings, and `override` is of another kind."""
    if not (base.is_map and override.is_map) or len(fields.models(annotation)) < 2:
        return False
    override_model = fields.member(annotation, override)
    return override_model is not None and override_model is not fields.member(annotation, base)


def _other_kind_mistake(name: str, card: Node, override: Node, annotation: Annotation, path: str) -> Mistake:
    """Return the input error of settings that override a card of another kind, at the first key that the card lacks."""
    card_tag, override_tag = _tag(card, annotation), _tag(override, annotation)
    if "kind" not in override.value and card_tag and override_tag:
        card_keys = fields.names(annotation, card)
        key = next(key for key in override.value if key not in card_keys)
        message = (
            f"the card {quoted(name)} is of kind {card_tag}, which has no {key}; name a card of kind {override_tag}"
        )
    else:
        key = "kind" if "kind" in override.value else next(iter(override.value))
        message = f"the card {quoted(name)} is of another kind; leave it out, or name one of this kind"
    return mistake(override.keys[key], join(path, key), message)


def _tag(node: Node, annotation: Annotation) -> str | None:
    """Return the value of `kind` of settings; None if they have none or it is open."""
    model = fields.member(annotation, node)
    return None if model is None else fields.model_tag(model)


def _with_override(base: Node, override: Node, written_override: Node, annotation: Annotation) -> Node:
    """Return `base` with an expanded override applied, mapping by mapping.

    A value, settings of another kind, and a card replace the base as a whole.

    Parameters
    ----------
    base : Node
        Overridden settings.
    override : Node
        Override with its cards expanded.
    written_override : Node
        Override as written, which shows where it names a card.
    annotation : Annotation
        Annotation of the settings.
    """
    are_mappings = base.is_map and override.is_map and written_override.is_map
    if not are_mappings or _replaces(base, written_override, annotation):
        return override
    result = base
    for key, child in override.value.items():
        base_child = base.value.get(key)
        child_annotation = fields.child(annotation, key, base)
        if base_child is not None and child_annotation is not None:
            child = _with_override(base_child, child, written_override.value[key], child_annotation)
        result = tree.with_child(result, key, child, override.keys[key])
    return with_remaining_marks(base, Node(result.value, base.place, result.keys), override)


def expand(node: Node, annotation: Annotation, shelf: Shelf, path: str = "") -> tuple[Node, list[Mistake]]:
    """Return the tree of settings at `path` with all cards expanded, and the input errors.

    Parameters
    ----------
    node : Node
        Tree of settings.
    annotation : Annotation
        Annotation of the settings.
    shelf : Shelf
        Cards that the settings can name.
    path : str
        Dotted path of the settings, for messages.
    """
    expander = _Expander(shelf)
    return expander.expand(node, annotation, path), expander.mistakes


def expanded_tree(node: Node, annotation: Annotation, shelf: Shelf, path: str) -> Node:
    """Return the tree of settings at `path` with all cards expanded; InputError if there are input errors."""
    result, mistakes = expand(node, annotation, shelf, path)
    refuse_all(mistakes)
    return result


_INDIVIDUAL_FIELDS = ("name", "id")  # fields that must differ between requirements


class RequirementSet(Card):
    """Requirements that belong together, such as those of one mission."""

    name: str
    source: str  # document that defines them
    requirements: tuple[Requirement, ...] = Field(min_length=1)


def splice(root: Node, shelf: Shelf) -> tuple[Node, list[Mistake]]:
    """Return the campaign's tree with every named set replaced by its requirements, and the input errors.

    ``requirements: [requirements/ariane5_hybrid, {card: requirements/ariane5_hybrid, at: stage1_cutoff}, {...}]`` has
    a set by its name, a set in which a field of every requirement is changed, and a single requirement. Settings from a
    card keep their place in the card, so that an error is reported where the user can correct it.
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
            items += _requirements(item, f"requirements.{index}", shelf)
        except InputError as error:
            mistakes += error.records
    return tree.with_child(root, "requirements", Node(items, node.place), root.keys["requirements"]), mistakes


def _requirements(item: Node, path: str, shelf: Shelf) -> list[Node]:
    """Return the requirements of a set, with the fields changed that are given together with its name."""
    reference = item.value["card"] if item.is_map else item
    if not isinstance(reference.value, str):
        raise tree.refuse(reference.place, path, "should be a requirement, or the name of a set of them")
    card = shelf.read(reference, path)
    changes = tree.without_key(item, "card") if item.is_map else Node({}, item.place)
    common_fields = [name for name in Requirement.model_fields if name not in _INDIVIDUAL_FIELDS]
    for key in changes.value:
        if key not in common_fields:
            message = f"cannot be changed for a whole set{tree.hint(key, common_fields)}"
            raise tree.refuse(changes.keys[key], f"{path}.{key}", message)
    if "requirements" not in card.value:
        raise tree.refuse(reference.place, path, f"{reference.value!r} is no set of requirements")
    try:
        RequirementSet.model_validate(tree.plain_data(card))
    except ValidationError as error:
        raise InputError(records=explain(error, card, RequirementSet, path)) from None
    source = card.value["source"]
    requirements = []
    for requirement in card.value["requirements"].value:
        requirements.append(_with_changes(_with_source(requirement, source), changes))
    return requirements


def _with_source(requirement: Node, source: Node) -> Node:
    """Return a requirement of a set, with the source of the set if it has no source of its own."""
    if "source" in requirement.value:
        return requirement
    return tree.with_child(requirement, "source", source, source.place)


def _with_changes(requirement: Node, changes: Node) -> Node:
    """Return a requirement with fields changed; an event replaces a phase, and a phase an event."""
    for key, alternative in (("at", "during"), ("during", "at")):
        if key in changes.value and alternative in requirement.value and alternative not in changes.value:
            requirement = tree.without_key(requirement, alternative)
    return Node(requirement.value | changes.value, requirement.place, requirement.keys | changes.keys)
