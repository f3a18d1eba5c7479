"""Reading of YAML with positions: every value has its file, line and column."""

import difflib
import io
import os
import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedSeq
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, ScalarNode, SequenceNode

from lvnav_trade.campaign.syntax.composer import BoundedComposer, syntax_message
from lvnav_trade.campaign.syntax.meaning import MEANINGS, find_synonym
from lvnav_trade.quantities import input_limits
from lvnav_trade.quantities.errors import HIDDEN, InputError, Mistake, quoted, refuse_all
from lvnav_trade.quantities.input_files import is_plain, read_bytes

HERE = "--set"
"""File name in the place of values from the command line."""


class Place(NamedTuple):
    """Position of a value."""

    file: str  # file, or ``--set``
    line: int  # from 1
    column: int  # from 1
    folder: Path  # where relative paths start


@dataclass(frozen=True)
class Node:
    """A value of a YAML tree with its position. Nodes are never changed; functions return changed copies."""

    value: Any  # dict of str to Node, list of Node, or a scalar
    place: Place
    keys: dict[str, Place] = field(default_factory=dict)  # places of the keys of a mapping

    @property
    def is_map(self) -> bool:
        """Whether the node is a mapping."""
        return isinstance(self.value, dict)

    @property
    def is_list(self) -> bool:
        """Whether the node is a list."""
        return isinstance(self.value, list)


class SourceTree:
    """Tree from which settings were read. All instances compare as equal: settings are compared by their content."""

    def __init__(
        self,
        root: Node | None = None,
        levels: Sequence[Sequence[tuple[Node, Place]]] = (),
        filled_paths: Collection[str] = (),
    ) -> None:
        """Store a tree with its levels and filled paths.

        levels : expanded levels of each axis, with their places.
        filled_paths : paths that are not given in the base, where the first level of an axis was put in.
        """
        self.root = root
        self.levels = levels
        self.filled_paths = frozenset(filled_paths)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SourceTree)

    __hash__ = None  # type: ignore[assignment]

    def mistake(self, path: str, message: str, steps: Iterable[str | int] | None = None) -> Mistake:
        """Return an input error with the place where `path` is written; `steps` if the tree has it at another path.

        A group of settings has the place of its key, because its content may come from a card. A field that is not
        written has the place of the settings above it. Without a tree the error has no place.
        """
        if self.root is None:
            return Mistake(message, path)
        tree_path = [str(step) for step in (path.split(".") if steps is None else steps)]
        node = find(self.root, tree_path)
        parent = find(self.root, tree_path[:-1])
        is_group = node is not None and node.is_map
        if is_group and parent is not None and tree_path[-1] in parent.keys:
            key_place = parent.keys[tree_path[-1]]
            return mistake(key_place, path, message)
        place = nearest_place(self.root, tree_path)
        return mistake(place, path, message)


def nearest_place(node: Node, steps: Iterable[str | int]) -> Place:
    """Return the place of the node at a path, or of the nearest existing node above it; a key may contain dots."""
    remaining_steps = [str(step) for step in steps]
    while remaining_steps:
        dotted_key = find(node, [".".join(remaining_steps)])
        if dotted_key is not None:
            return dotted_key.place
        child = find(node, remaining_steps[:1])
        if child is None:
            break
        node = child
        remaining_steps = remaining_steps[1:]
    return node.place


def mistake(place: Place, path: str, message: str) -> Mistake:
    """Return an input error at `place`."""
    return Mistake(message, path, place.file, place.line, place.column)


def mistake_at(root: Node, path: str, message: str, parent_path: str = "") -> Mistake:
    """Return an input error at a dotted path of a tree, or at the nearest place above it.

    `parent_path` is the dotted path of the tree itself.
    """
    return mistake(nearest_place(root, path.split(".")), join(parent_path, path), message)


def refuse(place: Place, path: str, message: str) -> InputError:
    """Return the exception for one input error at `place`."""
    return InputError(records=[mistake(place, path, message)])


def hint(word: str, known_names: Iterable[str]) -> str:
    """Return `` (did you mean 'this'?)``, by meaning or by spelling; empty if no known name is similar."""
    if len(word) > input_limits.QUOTED_LENGTH:
        return ""
    lower = word.lower()
    spellings = {str(name).lower(): str(name) for name in known_names}
    if lower in MEANINGS:
        synonym = find_synonym(word, spellings.values())
        return f" (did you mean {synonym!r}?)" if synonym else ""
    similar_names = difflib.get_close_matches(lower, list(spellings), n=1, cutoff=0.6)
    if not similar_names and len(word) > 2:
        similar_names = [name for name in spellings if name.startswith(f"{lower}_")]
    return f" (did you mean {spellings[similar_names[0]]!r}?)" if similar_names else ""


def read(path: Path) -> Node:
    """Read a YAML file into a tree; InputError if it cannot be read."""
    shown_path = show(path)
    try:
        if path.is_dir():
            raise InputError(f"{shown_path}: is a folder, not a YAML file")
        if not path.exists():
            neighbours = (file.name for file in path.parent.glob("*"))
            raise InputError(f"{shown_path}: no such file{hint(path.name, neighbours)}")
    except (OSError, ValueError) as error:  # a name that no file can have
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{quoted(shown_path)}: cannot be read: {reason}") from None
    try:
        text = read_bytes(path, input_limits.YAML_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{shown_path}: is not a text file in UTF-8") from None
    return parse(text, shown_path, path.resolve().parent)


def parse(text: str, file: str, folder: Path) -> Node:
    """Parse YAML text.

    Parameters
    ----------
    text : str
        The text.
    file : str
        Name of its file, for messages.
    folder : Path
        Folder from which relative paths in the text start.

    Raises
    ------
    InputError
        The text is empty or not YAML, or has content that is not permitted, such as duplicate keys.
    """
    is_short = len(text) <= _CACHED_LENGTH
    return _cached_tree(text, file, folder) if is_short else _parsed_tree(text, file, folder)


_CACHED_LENGTH = 2**17  # characters; the tree of a longer text takes more than 20 MB


@lru_cache(maxsize=256)
def _cached_tree(text: str, file: str, folder: Path) -> Node:
    """Return the tree of a text from the cache. Cases, campaigns and axes name the same cards many times."""
    return _parsed_tree(text, file, folder)


def _parsed_tree(text: str, file: str, folder: Path) -> Node:
    """Return the tree of a text; arguments and errors as in `parse`."""
    reader = YAML(typ="rt", pure=True)
    reader.Composer = BoundedComposer
    try:
        root = reader.compose(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
        raise InputError(records=[Mistake(syntax_message(error, text, line), "", file, line, column)]) from None
    except (YAMLError, ValueError) as error:
        raise InputError(f"{file}: is not YAML: {str(error).splitlines()[0]}") from None
    if root is None:
        raise InputError(f"{file}: is empty")
    conversion = _Conversion(file, folder)
    tree = conversion.node(root, "", ())
    refuse_all(conversion.mistakes)
    return tree


def read_mapping(path: Path) -> Node:
    """Read a file whose top level must be a mapping of keys to values; InputError if it is not."""
    node = read(path)
    if not node.is_map:
        raise refuse(node.place, "", "should be a mapping of keys to values ('key: value' lines)")
    return node


def show(path: Path) -> str:
    """Return a path for messages: relative to the working folder if it is below it, otherwise absolute."""
    relative_path = os.path.relpath(path)
    return str(path) if relative_path.startswith("..") else relative_path


# Tags that YAML itself gives to plain words; all but the first five remain text
_TAGS = ("str", "int", "float", "bool", "null", "timestamp", "merge", "value")


class _Conversion:
    """Converts composed nodes into tree nodes; collects duplicate keys and other content that is not permitted."""

    def __init__(self, file: str, folder: Path) -> None:
        self.file = file
        self.folder = folder
        self.mistakes: list[Mistake] = []
        self.nodes = 0

    def place(self, raw: Any) -> Place:
        return Place(self.file, raw.start_mark.line + 1, raw.start_mark.column + 1, self.folder)

    def node(self, raw: Any, path: str, container_ids: tuple[int, ...]) -> Node:
        """Return the tree node of a composed node; `container_ids` are the identities of the nodes that contain it."""
        place = self.place(raw)
        self.nodes += 1  # an alias counts with all its content, which is repeated
        if self.nodes > input_limits.YAML_NODES:
            raise refuse(place, path, f"with its aliases more than {input_limits.YAML_NODES} words, lists and mappings")
        if id(raw) in container_ids:
            self.mistakes.append(mistake(place, path, "an alias that contains itself"))
            return Node(None, place)
        child_container_ids = (*container_ids, id(raw))
        if isinstance(raw, MappingNode):
            return self._mapping(raw, place, path, child_container_ids)
        if isinstance(raw, SequenceNode):
            items = []
            for index, item in enumerate(raw.value):
                items.append(self.node(item, join(path, index), child_container_ids))
            return Node(items, place)
        if _short_tag(raw) not in _TAGS:
            self.mistakes.append(mistake(place, path, f"the tag {quoted(str(raw.tag))} has no meaning here"))
        text = _text(raw)
        hidden_character = HIDDEN.search(text)
        if hidden_character:  # it would change the text in a terminal or a report
            code = f"U+{ord(hidden_character[0]):04X}"
            message = f"{quoted(text)} has the hidden character {code}; remove it"
            self.mistakes.append(mistake(place, path, message))
        return Node(_scalar(raw), place)

    def _mapping(self, raw: MappingNode, place: Place, path: str, container_ids: tuple[int, ...]) -> Node:
        values: dict[str, Node] = {}
        keys: dict[str, Place] = {}
        for key_node, value_node in raw.value:
            key_place = self.place(key_node)
            if not isinstance(key_node, ScalarNode):
                self.mistakes.append(mistake(key_place, path, "a key should be a word"))
                continue
            key = str(key_node.value)
            if key in values:
                first_line = keys[key].line
                message = f"the key {quoted(key)} is given twice (first on line {first_line})"
                self.mistakes.append(mistake(key_place, join(path, key), message))
                continue
            keys[key] = key_place
            value = self.node(value_node, join(path, key), container_ids)
            # The parser gives an empty value the place of the next word; the place of its key is better.
            values[key] = value if value.value is not None else Node(None, key_place)
        return Node(values, place, keys)


def _short_tag(raw: ScalarNode) -> str:
    """Return the tag of a word without its namespace, such as ``int``."""
    return str(raw.tag).rpartition(":")[2]


def _text(raw: ScalarNode) -> str:
    return str(raw.value.replace("\a", "") if raw.style == ">" else raw.value)  # the parser marks folded lines by \a


def _scalar(raw: ScalarNode) -> Any:
    """Return the value of a plain word by YAML 1.2: dates, ``no`` and ``12:30`` remain text."""
    tag = _short_tag(raw)
    text = _text(raw)
    lower = text.lower()
    if tag in ("int", "float") and not is_plain(text):  # 1_000: a number of YAML 1.1
        return text
    try:
        if tag == "int":
            has_base = lower.lstrip("+-")[:2] in ("0x", "0o")
            return int(text, 0) if has_base else int(text)
        if tag == "float":
            return float(re.sub(r"^([+-]?)\.(inf|nan)$", r"\1\2", lower))
    except ValueError:
        return text
    if tag == "bool" and lower in ("true", "false"):
        return lower == "true"
    return None if tag == "null" else text


def join(path: str, key: str | int) -> str:
    """Return the dotted path one step down."""
    return f"{path}.{key}" if path else str(key)


def plain_data(node: Node) -> Any:
    """Return the tree as dictionaries, lists and scalars."""
    if node.is_map:
        return {key: plain_data(child) for key, child in node.value.items()}
    if node.is_list:
        return [plain_data(child) for child in node.value]
    return node.value


def node_from_data(data: Any, place: Place) -> Node:
    """Return a tree of `data` (dictionaries, lists, scalars), all nodes with the same place."""
    if isinstance(data, dict):
        values = {str(key): node_from_data(child, place) for key, child in data.items()}
        return Node(values, place, dict.fromkeys(values, place))
    if isinstance(data, list | tuple):
        return Node([node_from_data(child, place) for child in data], place)
    return Node(data, place)


def with_child(node: Node, key: str, child: Node, key_place: Place | None = None) -> Node:
    """Return a copy of a mapping in which `key` has the value `child`."""
    return Node({**node.value, key: child}, node.place, {**node.keys, key: key_place or child.place})


def without_key(node: Node, key: str) -> Node:
    """Return a copy of a mapping without `key`."""
    values = {name: child for name, child in node.value.items() if name != key}
    keys = {name: node.keys[name] for name in values}
    return Node(values, node.place, keys)


def with_node(node: Node, path: list[str], child: Node) -> Node:
    """Return the tree with `child` at `path`; missing mappings on the way are created."""
    if not path:
        return child
    key, child_path = path[0], path[1:]
    if node.is_list:
        index = index_of(key, node.value, node.place)
        return with_item(node, index, with_node(node.value[index], child_path, child))
    mapping = node if node.is_map else Node({}, child.place)
    present_child = mapping.value.get(key, Node({}, child.place))
    return with_child(mapping, key, with_node(present_child, child_path, child), mapping.keys.get(key))


def with_item(node: Node, index: int, child: Node) -> Node:
    """Return a copy of a list in which item `index` is `child`."""
    return Node([*node.value[:index], child, *node.value[index + 1 :]], node.place)


def index_of(key: str, items: Sequence[object], place: Place, path: str = "") -> int:
    """Return the index of a list item named by a step of a path; InputError at `place` if there is no such item."""
    if not is_index(key) or int(key) >= len(items):
        raise refuse(place, path, f"{quoted(key)} is not an item of a list of {len(items)} (0 is the first)")
    return int(key)


def is_index(word: str) -> bool:
    """Whether a step of a path is the index of a list item, without leading zeros."""
    return re.fullmatch(r"0|[1-9][0-9]{0,5}", word) is not None


def find(node: Node, path: Iterable[str | int]) -> Node | None:
    """Return the node at `path`, or None."""
    for step in path:
        key = str(step)
        if node.is_map and key in node.value:
            node = node.value[key]
        elif node.is_list and is_index(key) and int(key) < len(node.value):
            node = node.value[int(key)]
        else:
            return None
    return node


def dump(data: Any) -> str:
    """Return `data` (dictionaries, lists, scalars) as YAML that `parse` reads back; lists of scalars take one line."""
    writer = YAML(typ="rt", pure=True)
    writer.default_flow_style = False
    writer.width = 4096
    stream = io.StringIO()
    writer.dump(_lines(data), stream)
    return stream.getvalue()


def _lines(data: Any) -> Any:
    """Return the data with lists of scalars marked to be written on one line."""
    if isinstance(data, dict):
        return {key: _lines(value) for key, value in data.items()}
    if not isinstance(data, list | tuple):
        return data
    sequence = CommentedSeq(_lines(value) for value in data)
    if not any(isinstance(value, dict | list | tuple) for value in data):
        sequence.fa.set_flow_style()
    return sequence
