"""Marks (assumed, second hand) in trees of cards; a mark is removed when an override replaces its number."""

from collections.abc import Iterator, Sequence

from lvnav_trade.campaign.syntax import tree
from lvnav_trade.campaign.syntax.tree import Node, is_index
from lvnav_trade.quantities.marks import MARKS


def with_marks_of(base: Node, result: Node, over: Node) -> Node:
    """Return an overridden card with the marks of `base` whose numbers remain, and the marks of the override."""
    for mark in MARKS:
        marks, of_override = base.value.get(mark), over.value.get(mark)
        if marks is None or not marks.is_map:
            continue
        kept = {path for path in marks.value if _is_kept(base, result, path.split("."))}
        if of_override is not None and of_override.is_map:
            kept |= set(of_override.value)
        result = tree.with_child(result, mark, _chosen(result.value[mark], kept), result.keys[mark])
    return result


def unmarked_at(node: Node, steps: Sequence[str]) -> Node:
    """Return a mapping without its marks on the field at `steps` and on fields below it."""
    for mark in MARKS if node.is_map else ():
        marks = node.value.get(mark)
        if marks is not None and marks.is_map:
            kept = {path for path in marks.value if path.split(".")[: len(steps)] != [*steps]}
            node = tree.with_child(node, mark, _chosen(marks, kept), node.keys[mark])
    return node


def put(node: Node, path: Sequence[str], child: Node) -> Node:
    """Return the tree with `child` at `path`, as `tree.put`, without the marks on replaced values."""
    for depth in range(len(path)):
        above = tree.find(node, path[:depth])
        if above is not None and above.is_map and any(mark in above.value for mark in MARKS):
            node = tree.put(node, [*path[:depth]], unmarked_at(above, path[depth:]))
    return tree.put(node, [*path], child)


def _chosen(marks: Node, kept: set[str]) -> Node:
    """Return the marks of some paths."""
    if not marks.is_map:
        return marks
    return Node({path: marks.value[path] for path in marks.value if path in kept}, marks.place, marks.keys)


def _is_kept(base: Node, result: Node, steps: Sequence[str]) -> bool:
    """Whether a mark remains: one of the values at its path is still that of the base, or neither tree has any."""
    before, after = ({id(word) for word in _words(node, steps)} for node in (base, result))
    return bool(before & after) or not (before or after)


def _words(node: Node, steps: Sequence[str]) -> Iterator[Node]:
    """Yield the scalars at and below a path; a step that is not an index applies to every item of a list."""
    if node.is_list and steps and not is_index(steps[0]):
        for item in node.value:
            yield from _words(item, steps)
    elif steps:
        below = tree.find(node, steps[:1])
        if below is not None:
            yield from _words(below, steps[1:])
    elif node.is_map or node.is_list:
        for item in node.value.values() if node.is_map else node.value:
            yield from _words(item, ())
    else:
        yield node
