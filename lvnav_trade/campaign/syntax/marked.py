"""Marks (assumed, second hand) in trees of cards; a mark is removed when an override replaces its number."""

from collections.abc import Iterator, Sequence

from lvnav_trade.campaign.syntax import tree
from lvnav_trade.campaign.syntax.tree import Node, is_index
from lvnav_trade.quantities.marks import MARKS


def with_remaining_marks(base: Node, result: Node, override: Node) -> Node:
    """Return an overridden card with the marks of `base` whose numbers remain, and the marks of the override."""
    for mark in MARKS:
        marks = base.value.get(mark)
        if marks is None or not marks.is_map:
            continue
        remaining_paths = {path for path in marks.value if _is_remaining_mark(base, result, path.split("."))}
        override_marks = override.value.get(mark)
        if override_marks is not None and override_marks.is_map:
            remaining_paths |= set(override_marks.value)
        remaining_marks = _selected_marks(result.value[mark], remaining_paths)
        result = tree.with_child(result, mark, remaining_marks, result.keys[mark])
    return result


def without_marks(node: Node, steps: Sequence[str]) -> Node:
    """Return a mapping without its marks on the field at `steps` and on fields below it."""
    if not node.is_map:
        return node
    for mark in MARKS:
        marks = node.value.get(mark)
        if marks is not None and marks.is_map:
            remaining_paths = {path for path in marks.value if path.split(".")[: len(steps)] != [*steps]}
            remaining_marks = _selected_marks(marks, remaining_paths)
            node = tree.with_child(node, mark, remaining_marks, node.keys[mark])
    return node


def with_node(node: Node, path: Sequence[str], child: Node) -> Node:
    """Return the tree with `child` at `path`, as `tree.with_node`, without the marks on replaced values."""
    for depth in range(len(path)):
        ancestor_path = path[:depth]
        ancestor = tree.find(node, ancestor_path)
        if ancestor is not None and ancestor.is_map and any(mark in ancestor.value for mark in MARKS):
            unmarked_ancestor = without_marks(ancestor, path[depth:])
            node = tree.with_node(node, [*ancestor_path], unmarked_ancestor)
    return tree.with_node(node, [*path], child)


def _selected_marks(marks: Node, paths: set[str]) -> Node:
    """Return the marks of some paths."""
    if not marks.is_map:
        return marks
    selected_marks = {path: mark for path, mark in marks.value.items() if path in paths}
    return Node(selected_marks, marks.place, marks.keys)


def _is_remaining_mark(base: Node, result: Node, steps: Sequence[str]) -> bool:
    """Whether a mark remains: one of the values at its path is still that of the base, or neither tree has any."""
    base_ids = {id(value) for value in _values(base, steps)}
    result_ids = {id(value) for value in _values(result, steps)}
    if not base_ids and not result_ids:
        return True
    return bool(base_ids & result_ids)


def _values(node: Node, steps: Sequence[str]) -> Iterator[Node]:
    """Yield the scalars at and below a path; a step that is not an index applies to every item of a list."""
    if node.is_list and steps and not is_index(steps[0]):
        for item in node.value:
            yield from _values(item, steps)
    elif steps:
        child_node = tree.find(node, steps[:1])
        if child_node is not None:
            yield from _values(child_node, steps[1:])
    elif node.is_map:
        for child in node.value.values():
            yield from _values(child, ())
    elif node.is_list:
        for item in node.value:
            yield from _values(item, ())
    else:
        yield node
