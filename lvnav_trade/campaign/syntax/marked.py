"""Marks (assumed, second hand) in trees of cards; a mark is removed when an override replaces its number."""

from collections.abc import Iterator, Sequence

from lvnav_trade.campaign.syntax import tree
from lvnav_trade.campaign.syntax.tree import Node, is_index
from lvnav_trade.quantities.marks import MARKS


def with_marks_of(base: Node, result: Node, over: Node) -> Node:
    """Return an overridden card with the marks of `base` whose numbers remain, and the marks of the override."""
    for mark in MARKS:
        marks = base.value.get(mark)
        if marks is None or not marks.is_map:
            continue
        remaining = {path for path in marks.value if _remains(base, result, path.split("."))}
        override_marks = over.value.get(mark)
        if override_marks is not None and override_marks.is_map:
            remaining |= set(override_marks.value)
        remaining_marks = _selected_marks(result.value[mark], remaining)
        result = tree.with_child(result, mark, remaining_marks, result.keys[mark])
    return result


def unmarked_at(node: Node, steps: Sequence[str]) -> Node:
    """Return a mapping without its marks on the field at `steps` and on fields below it."""
    if not node.is_map:
        return node
    for mark in MARKS:
        marks = node.value.get(mark)
        if marks is not None and marks.is_map:
            remaining = {path for path in marks.value if path.split(".")[: len(steps)] != [*steps]}
            remaining_marks = _selected_marks(marks, remaining)
            node = tree.with_child(node, mark, remaining_marks, node.keys[mark])
    return node


def put(node: Node, path: Sequence[str], child: Node) -> Node:
    """Return the tree with `child` at `path`, as `tree.put`, without the marks on replaced values."""
    for depth in range(len(path)):
        path_above = path[:depth]
        above = tree.find(node, path_above)
        if above is not None and above.is_map and any(mark in above.value for mark in MARKS):
            unmarked = unmarked_at(above, path[depth:])
            node = tree.put(node, [*path_above], unmarked)
    return tree.put(node, [*path], child)


def _selected_marks(marks: Node, paths: set[str]) -> Node:
    """Return the marks of some paths."""
    if not marks.is_map:
        return marks
    selected = {path: mark for path, mark in marks.value.items() if path in paths}
    return Node(selected, marks.place, marks.keys)


def _remains(base: Node, result: Node, steps: Sequence[str]) -> bool:
    """Whether a mark remains: one of the values at its path is still that of the base, or neither tree has any."""
    before = {id(value) for value in _values(base, steps)}
    after = {id(value) for value in _values(result, steps)}
    if not before and not after:
        return True
    return bool(before & after)


def _values(node: Node, steps: Sequence[str]) -> Iterator[Node]:
    """Yield the scalars at and below a path; a step that is not an index applies to every item of a list."""
    if node.is_list and steps and not is_index(steps[0]):
        for item in node.value:
            yield from _values(item, steps)
    elif steps:
        below = tree.find(node, steps[:1])
        if below is not None:
            yield from _values(below, steps[1:])
    elif node.is_map:
        for child in node.value.values():
            yield from _values(child, ())
    elif node.is_list:
        for item in node.value:
            yield from _values(item, ())
    else:
        yield node
