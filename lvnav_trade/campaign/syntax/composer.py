"""Composition of YAML within limits, and messages for text that is not YAML."""

from typing import Any

from ruamel.yaml.composer import Composer
from ruamel.yaml.error import MarkedYAMLError
from ruamel.yaml.events import AliasEvent

from lvnav_trade.quantities import input_limits

_SCALAR = "'<scalar>'"  # name of a word in messages of the parser


class _RefusedError(MarkedYAMLError):
    """Valid YAML that is refused: an anchor that is defined twice, or a file that exceeds a limit."""


class BoundedComposer(Composer):
    """Composes nodes and stops at the first that exceeds a limit of number, depth or length, or repeats an anchor."""

    nodes = nesting = aliases = 0  # `depth` is an attribute of the base class

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Return the next node; _RefusedError if it exceeds a limit."""
        event = self.parser.peek_event()
        is_alias = isinstance(event, AliasEvent)
        self.nodes += 1
        self.nesting += 1
        self.aliases += is_alias
        n_items = index + 1 if isinstance(index, int) else 0
        n_characters = len(getattr(event, "value", None) or "")
        for count, limit, name in (
            (self.nodes, input_limits.YAML_NODES, "words, lists and mappings"),
            (self.nesting, input_limits.YAML_DEPTH, "lists and mappings within each other"),
            (self.aliases, input_limits.YAML_ALIASES, "aliases"),
            (n_items, input_limits.LIST_LENGTH, "items in a list"),
            (n_characters, input_limits.WORD_LENGTH, "characters in a text"),
        ):
            if count > limit:
                raise _RefusedError(problem=f"more than {limit} {name}", problem_mark=event.start_mark)
        if not is_alias and event.anchor in self.anchors:
            raise _RefusedError(problem="an anchor of this name is defined above", problem_mark=event.start_mark)
        node = super().compose_node(parent, index)
        self.nesting -= 1
        return node


def syntax_message(error: MarkedYAMLError, text: str, line: int) -> str:
    """Return the message for text that is not YAML, or that is refused.

    Parameters
    ----------
    error : MarkedYAMLError
        Error of the YAML parser.
    text : str
        Text of the file.
    line : int
        Number of the line, from 1.
    """
    if isinstance(error, _RefusedError):
        return str(error.problem)
    indent = ""
    lines = text.splitlines()
    if line <= len(lines):
        content = lines[line - 1]
        indent = content[: len(content) - len(content.lstrip())]
    if "\t" in indent or "'\\t'" in str(error.problem):
        return "a tab; YAML is indented with spaces"
    problem = str(error.problem or error.context or "is not YAML").splitlines()[0]
    message = f"is not YAML: {problem.replace(_SCALAR, 'a word')}"
    if error.context_mark and error.problem_mark:
        first_line = error.context_mark.line + 1
        if first_line != line:
            message += f" (in the block that begins on line {first_line})"
    return message
