"""A program in C99 made of kernels: each is translated for the kinds of arguments that it is called with.

What is known when the code is made (settings, sizes, None for what a case has not) is evaluated then, so that branches
which are never taken do not appear. Numbers that vary, and arrays, are arguments. There is no allocation, no recursion
and no state beside the struct `self`.
"""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from collections import Counter
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.export.translation.expressions import constant_array
from lvnav_trade.export.translation.statements import RESERVED, Body
from lvnav_trade.export.translation.values import (
    DOUBLE,
    INT,
    Array,
    Fields,
    Known,
    Scalar,
    Several,
    TranslationError,
    Value,
    as_scalar,
    known_number,
    literal,
    size_of,
)
from lvnav_trade.kernels.choice import source_of

_WIDTH = 118


class Translated(NamedTuple):
    """A kernel in C: name, declarations of its parameters by the kernel's own names, text, what it returns, and the
    value if that is all it does; acts: whether it does anything.
    """

    name: str
    parameters: dict[str, str]
    text: str
    returns: str
    kinds: tuple[str, ...]
    constant: Known | None
    acts: bool


class Program:
    """Functions and tables of a program, which grow as kernels are added.

    state : what the struct is called whose pointer `self` is
    """

    def __init__(self, state: str) -> None:
        self.state = state
        self.functions: dict[Any, Translated] = {}
        self.tables: dict[str, Array] = {}
        self.tuples: dict[str, tuple[str, ...]] = {}
        self._names: Counter[str] = Counter()

    # ---------------------------------------------------------------------------------------- constants

    def known(self, value: Any, label: str) -> Value:
        """Return a global of a kernel's module: a number, a function, a table."""
        if isinstance(value, np.ndarray):
            return self.table(label, Known(tuple(value.tolist())) if value.ndim == 1 else value)
        if isinstance(value, ModuleType) or callable(value):
            return Known(value)
        return Known(known_number(value))

    def table(self, label: str, content: Any) -> Array:
        """Return a table of known numbers by a name of its own; the same numbers are stored once."""
        found = constant_array(label, content.value if isinstance(content, Known) else content)
        for made in self.tables.values():
            if made.text.startswith(label.strip("_").upper()) and _same(made.value, found.value):
                return made
        name = label.strip("_").upper()  # no local is called so
        while name in self.tables:
            name += "_"
        self.tables[name] = constant_array(name, found.value)
        return self.tables[name]

    # -------------------------------------------------------------------------------------------- calls

    def call(
        self, body: Body | Any, node: ast.Call, function: Any, arguments: list[Value], named: Mapping[str, Value]
    ) -> Value:
        """Return what a kernel returns, called from another one's body."""
        made = self.translated(function, bound(function, arguments, named))
        if made.constant is not None:
            return made.constant
        if not made.acts:
            return Known(None)
        given = bound(function, arguments, named)
        texts = ["self"] if re.search(r"\bself\b", made.text) else []
        for name in made.parameters:
            texts.append(_passed(given, name))
        text = f"{made.name}({', '.join(texts)})"
        if made.returns == "void":
            return Scalar(text, "void")
        if len(made.kinds) == 1 and not made.returns.startswith("struct"):
            return Scalar(text, made.kinds[0])
        name = body.temporary(f"{made.returns} {{}}", "of")
        body.write(f"{name} = {text};")
        return Several(tuple(Scalar(f"{name}.v{i}", kind) for i, kind in enumerate(made.kinds)))

    def translated(self, function: Any, given: dict[str, Value], name: str | None = None) -> Translated:
        """Return a kernel for arguments by name, translated where it is not yet; name: of an entry."""
        python = getattr(function, "py_func", function)
        if not callable(python) or not hasattr(python, "__code__"):
            raise TranslationError(f"{function!r} is no kernel")
        key = (python, tuple((one, _signature(value)) for one, value in given.items()))
        if key not in self.functions:
            self.functions[key] = self._translate(python, given, name)
        return self.functions[key]

    def _translate(self, python: Callable[..., Any], given: dict[str, Value], name: str | None) -> Translated:
        tree = ast.parse(textwrap.dedent(source_of(python))).body[0]
        assert isinstance(tree, ast.FunctionDef)
        names, declared = _parameters(given)
        first = self._pass(python, tree, dict(names), None)
        body = self._pass(python, tree, dict(names), first)
        kinds, returns = self._returns(first.returned)
        constant = body.returned[0] if len(body.lines) == 1 and len(body.returned) == 1 else None
        body.lines = self._live(body)
        text = "\n".join(body.lines)
        kept = {one: text_of for one, text_of in declared.items() if _names(_c_name(text_of), text)}
        if name is None:
            stem = f"{python.__module__.rpartition('.')[2]}_{python.__name__.strip('_')}"
            self._names[stem] += 1
            name = stem if self._names[stem] == 1 else f"{stem}_{self._names[stem]}"
        head = ([f"struct {self.state} *self"] if re.search(r"\bself\b", text) else []) + list(kept.values())
        signature = f"{returns} {name}({', '.join(head) or 'void'})"
        lines = [*_comment(python), *textwrap.wrap(signature, _WIDTH, subsequent_indent="    "), "{"]
        lines += [f"    {one};" for one in _grouped(body.locals.values(), text)] + body.lines + ["}"]
        value = constant if isinstance(constant, Known) else None
        return Translated(name, kept, "\n".join(lines), returns, kinds, value, bool(body.lines))

    def _pass(self, python: Any, tree: ast.FunctionDef, names: dict[str, Value], earlier: Body | None) -> Body:
        body = Body(self, python, names, tree, earlier)
        body.begin()
        try:
            body.block(tree.body)
        except TranslationError as error:
            if "line" in str(error) or type(error) is not TranslationError:
                raise
            raise TranslationError(f"{python.__module__}.{python.__name__}: {error}") from error
        return body

    def _live(self, body: Body) -> list[str]:
        """Return the lines of a body without those that set a local which none reads; a call remains one."""
        own = {made.name for made in self.functions.values()}
        lines, dead = body.lines, True
        while dead:
            dead = False
            for name in map(_c_name, body.locals.values()):
                sets = re.compile(rf"^(\s*){name} = (.*);$")
                if any(_names(name, line) and not sets.match(line) for line in lines):
                    continue
                kept = list[str]()
                for line in lines:
                    found = sets.match(line)
                    if found is None:
                        kept.append(line)
                        continue
                    dead = True
                    if own & set(re.findall(r"(\w+)\(", found.group(2))):
                        kept.append(f"{found.group(1)}{found.group(2)};")
                lines = kept
        return lines

    # ------------------------------------------------------------------------------------------ returns

    def _returns(self, returned: list[Value]) -> tuple[tuple[str, ...], str]:
        """Return the kinds of what a function returns, and its type in C."""
        rows = [one.items if isinstance(one, Several) else (one,) for one in returned]
        rows = [row for row in rows if row != (Known(None),)]
        if not rows:
            return (), "void"
        columns = [{as_scalar(item).kind for item in column} for column in zip(*rows, strict=True)]
        kinds = tuple(DOUBLE if DOUBLE in column else INT for column in columns)
        if len(kinds) == 1 and not any(isinstance(one, Several) for one in returned):
            return kinds, kinds[0]
        label = "_".join(f"{kind[0]}{len(run)}" for kind, run in _runs(kinds))
        self.tuples[f"numbers_{label}"] = kinds
        return kinds, f"struct numbers_{label}"

    def return_line(self, found: Value, returned: list[Value]) -> str:
        """Return the statement that returns a value from a function that returns these."""
        if found == Known(None):
            return "return;"
        _, returns = self._returns(returned)
        if isinstance(found, Several):
            return f"return ({returns}){{{', '.join(as_scalar(item).text for item in found.items)}}};"
        return f"return {as_scalar(found).text};"

    # --------------------------------------------------------------------------------------------- text

    def text(self, entries: list[str]) -> str:
        """Return the C of everything that functions of some names need: types, tables, functions."""
        by_name = {made.name: made for made in self.functions.values()}
        wanted, found = list(entries), set[str]()
        while wanted:
            name = wanted.pop()
            if name not in found:
                found.add(name)
                wanted += [other for other in re.findall(r"\b(\w+)\(", by_name[name].text) if other in by_name]
        functions = [made for made in self.functions.values() if made.name in found]
        code = "\n\n\n".join(
            made.text if made.name in entries else _static(made.text, made.returns) for made in functions
        )
        used = set(re.findall(r"\w+", code))
        types = [_struct(name, kinds) for name, kinds in self.tuples.items() if name in used]
        tables = [_table(name, array) for name, array in self.tables.items() if name in used]
        return "\n\n".join(part for part in ("\n".join(types), "\n\n".join(tables), code) if part) + "\n"


def _same(a: np.ndarray, b: np.ndarray) -> bool:
    return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")


def bound(function: Any, arguments: list[Value], named: Mapping[str, Value]) -> dict[str, Value]:
    """Return the arguments of a call by name, defaults among them."""
    python = getattr(function, "py_func", function)
    found = inspect.signature(python).bind(*arguments, **named)
    found.apply_defaults()
    return {
        name: value if isinstance(value, Known | Scalar | Array | Several | Fields) else Known(value)
        for name, value in found.arguments.items()
    }


def _signature(value: Value) -> Any:
    """Return what of an argument makes another function of a kernel: all that is known but real numbers."""
    if isinstance(value, Known):
        return (type(value.value), None if isinstance(value.value, float) else value.value)
    if isinstance(value, Scalar):
        return value.kind
    if isinstance(value, Array):
        shape = tuple(None if isinstance(size, Scalar) else size for size in value.shape)
        return (shape, value.kind, value.constant, value.rings)
    if isinstance(value, Several):
        return tuple(_signature(item) for item in value.items)
    return value.name


def _parameters(given: dict[str, Value]) -> tuple[dict[str, Value], dict[str, str]]:
    """Return what the names of a kernel stand for, and the parameters that C needs for them."""
    names, declared = dict[str, Value](), dict[str, str]()
    for name, value in given.items():
        label = _safe(name)
        if isinstance(value, Scalar) or (isinstance(value, Known) and isinstance(value.value, float)):
            kind = value.kind if isinstance(value, Scalar) else DOUBLE
            names[name], declared[name] = Scalar(label, kind), f"{kind} {label}"
        elif isinstance(value, Array):
            shape = tuple(Scalar(f"n_{label}", INT) if isinstance(size, Scalar) else size for size in value.shape)
            names[name] = Array(label, shape, value.kind, value.constant, value.rings)
            declared[name] = value.declared(label)
            if any(isinstance(size, Scalar) for size in shape):
                declared[f"{name}.n"] = f"int n_{label}"
        elif isinstance(value, Several):
            items = []
            for at, item in enumerate(value.items):
                number = as_scalar(item)
                items.append(Scalar(f"{label}_{at}", number.kind))
                declared[f"{name}.{at}"] = f"{number.kind} {label}_{at}"
            names[name] = Several(tuple(items))
        else:
            names[name] = value
    return names, declared


def _passed(given: dict[str, Value], parameter: str) -> str:
    """Return what a call passes for a parameter."""
    name, _, part = parameter.partition(".")
    value = given[name]
    if isinstance(value, Array):
        return value.text if part == "" else next(as_scalar(s).text for s in value.shape if isinstance(s, Scalar))
    if isinstance(value, Several):
        return as_scalar(value.items[int(part)]).text
    return literal(value.value).text if isinstance(value, Known) else as_scalar(value).text


def _safe(name: str) -> str:
    return f"{name}_" if name in RESERVED else name


def _names(name: str, text: str) -> bool:
    """Return whether a text names a local or a parameter: fields of structs are not meant."""
    return re.search(rf"(?<![.>\w]){name}\b", text) is not None


def _c_name(declaration: str) -> str:
    """Return the name in a declaration."""
    found = re.search(r"(\w+)\)?(\[\d+\])*$", declaration)
    assert found is not None
    return found.group(1)


def _comment(python: Any) -> list[str]:
    """Return a comment of the first paragraph of a kernel's docstring."""
    words = inspect.cleandoc(python.__doc__ or "").split("\n\n")[0].replace("\n", " ").replace("*/", "* /")
    if not words:
        return []
    lines = textwrap.wrap(words, _WIDTH - 6)
    lines = [f"/* {lines[0]}", *(f"   {line}" for line in lines[1:])]
    return [*lines[:-1], f"{lines[-1]} */"]


def _grouped(declarations: Any, text: str) -> list[str]:
    """Return declarations of locals that the text names, numbers of a kind on one line."""
    simple: dict[str, list[str]] = {}
    others = list[str]()
    for one in declarations:
        if not _names(_c_name(one), text):
            continue
        kind, _, name = one.partition(" ")
        if name.isidentifier():
            simple.setdefault(kind, []).append(name)
        else:
            others.append(one)
    found = list[str]()
    for kind, names in simple.items():
        found += textwrap.wrap(f"{kind} {', '.join(names)}", _WIDTH - 4, subsequent_indent="        ")
    joined = list[str]()
    for line in found:  # a declaration that was wrapped is one
        if line.startswith("        ") and joined:
            joined[-1] += f"\n    {line}"
        else:
            joined.append(line)
    return joined + others


def _runs(kinds: tuple[str, ...]) -> list[tuple[str, list[str]]]:
    found: list[tuple[str, list[str]]] = []
    for kind in kinds:
        if found and found[-1][0] == kind:
            found[-1][1].append(kind)
        else:
            found.append((kind, [kind]))
    return found


def _static(text: str, returns: str) -> str:
    """Return a function that no other file calls."""
    at = text.index("*/") + 3 if text.startswith("/*") else 0
    return f"{text[:at]}static {text[at:]}"


def _struct(name: str, kinds: tuple[str, ...]) -> str:
    return f"struct {name} {{ {' '.join(f'{kind} v{i};' for i, kind in enumerate(kinds))} }};"


def _table(name: str, array: Array) -> str:
    sizes = "".join(f"[{size_of(size)}]" for size in array.sizes)
    return f"static const {array.kind} {name}{sizes} = {_content(array.value)};"


def _content(content: np.ndarray) -> str:
    """Return the content of a table, as C writes it."""
    if content.ndim == 1:
        row = ", ".join(literal(value).text for value in content) or "0"
        return "{" + "\n    ".join(textwrap.wrap(row, _WIDTH - 4)) + "}"
    return "{\n" + ",\n".join(_content(part) for part in content) + "\n}" if len(content) else "{{0}}"
