"""A program in C99 made of kernels, each translated for the types of arguments with which it is called.

Settings, sizes and absent options (None) are known at translation. They are evaluated then, so that branches never
taken do not appear in the C code. Numbers that vary, and arrays, become arguments. The code has no allocation, no
recursion and no state outside the struct `self`.
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
    Constant,
    RecordValue,
    Scalar,
    TranslationError,
    TupleValue,
    Value,
    as_scalar,
    known_number,
    literal,
    size_of,
)
from lvnav_trade.kernels.choice import source_of

_WIDTH = 118


class TranslatedKernel(NamedTuple):
    """A kernel in C.

    name : Name of the C function.
    parameters : Declarations of the parameters by their name in the kernel.
    text : Text of the function.
    returns : Return type.
    kinds : C types of the returned numbers.
    constant : Returned value, if the function does nothing else; otherwise None.
    acts : Whether the function has an effect.
    """

    name: str
    parameters: dict[str, str]
    text: str
    returns: str
    kinds: tuple[str, ...]
    constant: Constant | None
    acts: bool


class Program:
    """Functions and tables of a program, which grows as kernels are added.

    state : name of the struct to which `self` points
    """

    def __init__(self, state: str) -> None:
        self.state = state
        self.functions: dict[Any, TranslatedKernel] = {}
        self.tables: dict[str, Array] = {}
        self.tuples: dict[str, tuple[str, ...]] = {}
        self._names: Counter[str] = Counter()

    # ---------------------------------------------------------------------------------------- constants

    def known(self, value: Any, label: str) -> Value:
        """Return a global of a kernel's module: a number, a function, or a table."""
        if isinstance(value, np.ndarray):
            return self.table(label, Constant(tuple(value.tolist())) if value.ndim == 1 else value)
        if isinstance(value, ModuleType) or callable(value):
            return Constant(value)
        return Constant(known_number(value))

    def table(self, label: str, content: Any) -> Array:
        """Return a table of known numbers with a unique name; equal tables are stored once."""
        array = constant_array(label, content.value if isinstance(content, Constant) else content)
        for existing in self.tables.values():
            if existing.text.startswith(label.strip("_").upper()) and _same(existing.value, array.value):
                return existing
        name = label.strip("_").upper()  # local variables are never in capitals
        while name in self.tables:
            name += "_"
        self.tables[name] = constant_array(name, array.value)
        return self.tables[name]

    # -------------------------------------------------------------------------------------------- calls

    def call(
        self, body: Body | Any, node: ast.Call, function: Any, arguments: list[Value], named: Mapping[str, Value]
    ) -> Value:
        """Return the result of a kernel called from the body of another."""
        made = self.translated(function, bound(function, arguments, named))
        if made.constant is not None:
            return made.constant
        if not made.acts:
            return Constant(None)
        bound_arguments = bound(function, arguments, named)
        texts = ["self"] if re.search(r"\bself\b", made.text) else []
        for name in made.parameters:
            texts.append(_passed(bound_arguments, name))
        text = f"{made.name}({', '.join(texts)})"
        if made.returns == "void":
            return Scalar(text, "void")
        if len(made.kinds) == 1 and not made.returns.startswith("struct"):
            return Scalar(text, made.kinds[0])
        name = body.temporary(f"{made.returns} {{}}", "of")
        body.write(f"{name} = {text};")
        return TupleValue(tuple(Scalar(f"{name}.v{i}", number_type) for i, number_type in enumerate(made.kinds)))

    def translated(self, function: Any, given: dict[str, Value], name: str | None = None) -> TranslatedKernel:
        """Return a kernel for named arguments; it is translated at the first call with arguments of these types.

        name : name of an entry function
        """
        python = getattr(function, "py_func", function)
        if not callable(python) or not hasattr(python, "__code__"):
            raise TranslationError(f"{function!r} is no kernel")
        key = (python, tuple((argument, _signature(value)) for argument, value in given.items()))
        if key not in self.functions:
            self.functions[key] = self._translate(python, given, name)
        return self.functions[key]

    def _translate(self, python: Callable[..., Any], given: dict[str, Value], name: str | None) -> TranslatedKernel:
        tree = ast.parse(textwrap.dedent(source_of(python))).body[0]
        assert isinstance(tree, ast.FunctionDef)
        names, declared = _parameters(given)
        first = self._pass(python, tree, dict(names), None)
        body = self._pass(python, tree, dict(names), first)
        kinds, returns = self._returns(first.returned)
        constant = body.returned[0] if len(body.lines) == 1 and len(body.returned) == 1 else None
        body.lines = self._live(body)
        text = "\n".join(body.lines)
        used_locals = {local: text_of for local, text_of in declared.items() if _names(_c_name(text_of), text)}
        if name is None:
            stem = f"{python.__module__.rpartition('.')[2]}_{python.__name__.strip('_')}"
            self._names[stem] += 1
            name = stem if self._names[stem] == 1 else f"{stem}_{self._names[stem]}"
        head = ([f"struct {self.state} *self"] if re.search(r"\bself\b", text) else []) + list(used_locals.values())
        signature = f"{returns} {name}({', '.join(head) or 'void'})"
        lines = [*_comment(python), *textwrap.wrap(signature, _WIDTH, subsequent_indent="    "), "{"]
        lines += [f"    {local};" for local in _grouped(body.locals.values(), text)] + body.lines + ["}"]
        value = constant if isinstance(constant, Constant) else None
        return TranslatedKernel(name, used_locals, "\n".join(lines), returns, kinds, value, bool(body.lines))

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
        """Return the lines of a body without assignments to local variables that are never read; calls remain."""
        function_names = {function.name for function in self.functions.values()}
        lines, dead = body.lines, True
        while dead:
            dead = False
            for name in map(_c_name, body.locals.values()):
                sets = re.compile(rf"^(\s*){name} = (.*);$")
                if any(_names(name, line) and not sets.match(line) for line in lines):
                    continue
                live_lines = list[str]()
                for line in lines:
                    assignment = sets.match(line)
                    if assignment is None:
                        live_lines.append(line)
                        continue
                    dead = True
                    if function_names & set(re.findall(r"(\w+)\(", assignment.group(2))):
                        live_lines.append(f"{assignment.group(1)}{assignment.group(2)};")
                lines = live_lines
        return lines

    # ------------------------------------------------------------------------------------------ returns

    def _returns(self, returned: list[Value]) -> tuple[tuple[str, ...], str]:
        """Return the C types of the returned numbers, and the return type in C."""
        rows = [value.items if isinstance(value, TupleValue) else (value,) for value in returned]
        rows = [row for row in rows if row != (Constant(None),)]
        if not rows:
            return (), "void"
        columns = [{as_scalar(item).kind for item in column} for column in zip(*rows, strict=True)]
        kinds = tuple(DOUBLE if DOUBLE in column else INT for column in columns)
        if len(kinds) == 1 and not any(isinstance(value, TupleValue) for value in returned):
            return kinds, kinds[0]
        label = "_".join(f"{number_type[0]}{len(run)}" for number_type, run in _runs(kinds))
        self.tuples[f"numbers_{label}"] = kinds
        return kinds, f"struct numbers_{label}"

    def return_line(self, found: Value, returned: list[Value]) -> str:
        """Return the statement that returns a value from a function with the given return values."""
        if found == Constant(None):
            return "return;"
        _, returns = self._returns(returned)
        if isinstance(found, TupleValue):
            return f"return ({returns}){{{', '.join(as_scalar(item).text for item in found.items)}}};"
        return f"return {as_scalar(found).text};"

    # --------------------------------------------------------------------------------------------- text

    def text(self, entries: list[str]) -> str:
        """Return the C code of everything that the named functions need: types, tables, functions."""
        by_name = {function.name: function for function in self.functions.values()}
        pending, found = list(entries), set[str]()
        while pending:
            name = pending.pop()
            if name not in found:
                found.add(name)
                pending += [callee for callee in re.findall(r"\b(\w+)\(", by_name[name].text) if callee in by_name]
        functions = [function for function in self.functions.values() if function.name in found]
        code = "\n\n\n".join(
            function.text if function.name in entries else _static(function.text, function.returns)
            for function in functions
        )
        used = set(re.findall(r"\w+", code))
        types = [_struct(name, kinds) for name, kinds in self.tuples.items() if name in used]
        tables = [_table(name, array) for name, array in self.tables.items() if name in used]
        return "\n\n".join(section for section in ("\n".join(types), "\n\n".join(tables), code) if section) + "\n"


def _same(a: np.ndarray, b: np.ndarray) -> bool:
    return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")


def bound(function: Any, arguments: list[Value], named: Mapping[str, Value]) -> dict[str, Value]:
    """Return the arguments of a call by name, including defaults."""
    python = getattr(function, "py_func", function)
    binding = inspect.signature(python).bind(*arguments, **named)
    binding.apply_defaults()
    return {
        name: value if isinstance(value, Constant | Scalar | Array | TupleValue | RecordValue) else Constant(value)
        for name, value in binding.arguments.items()
    }


def _signature(value: Value) -> Any:
    """Return the properties of an argument that require a separate translation: all known values except doubles."""
    if isinstance(value, Constant):
        return (type(value.value), None if isinstance(value.value, float) else value.value)
    if isinstance(value, Scalar):
        return value.kind
    if isinstance(value, Array):
        shape = tuple(None if isinstance(size, Scalar) else size for size in value.shape)
        return (shape, value.kind, value.constant, value.rings)
    if isinstance(value, TupleValue):
        return tuple(_signature(item) for item in value.items)
    return value.name


def _parameters(given: dict[str, Value]) -> tuple[dict[str, Value], dict[str, str]]:
    """Return the values of a kernel's names, and the C parameters for them."""
    names, declared = dict[str, Value](), dict[str, str]()
    for name, value in given.items():
        label = _safe(name)
        if isinstance(value, Scalar) or (isinstance(value, Constant) and isinstance(value.value, float)):
            number_type = value.kind if isinstance(value, Scalar) else DOUBLE
            names[name], declared[name] = Scalar(label, number_type), f"{number_type} {label}"
        elif isinstance(value, Array):
            shape = tuple(Scalar(f"n_{label}", INT) if isinstance(size, Scalar) else size for size in value.shape)
            names[name] = Array(label, shape, value.kind, value.constant, value.rings)
            declared[name] = value.declared(label)
            if any(isinstance(size, Scalar) for size in shape):
                declared[f"{name}.n"] = f"int n_{label}"
        elif isinstance(value, TupleValue):
            items = []
            for at, item in enumerate(value.items):
                number = as_scalar(item)
                items.append(Scalar(f"{label}_{at}", number.kind))
                declared[f"{name}.{at}"] = f"{number.kind} {label}_{at}"
            names[name] = TupleValue(tuple(items))
        else:
            names[name] = value
    return names, declared


def _passed(given: dict[str, Value], parameter: str) -> str:
    """Return the C expression that a call passes for a parameter."""
    name, _, field = parameter.partition(".")
    value = given[name]
    if isinstance(value, Array):
        return value.text if field == "" else next(as_scalar(s).text for s in value.shape if isinstance(s, Scalar))
    if isinstance(value, TupleValue):
        return as_scalar(value.items[int(field)]).text
    return literal(value.value).text if isinstance(value, Constant) else as_scalar(value).text


def _safe(name: str) -> str:
    return f"{name}_" if name in RESERVED else name


def _names(name: str, text: str) -> bool:
    """Return whether a text refers to a local variable or parameter; fields of structs do not count."""
    return re.search(rf"(?<![.>\w]){name}\b", text) is not None


def _c_name(declaration: str) -> str:
    """Return the name in a declaration."""
    match = re.search(r"(\w+)\)?(\[\d+\])*$", declaration)
    assert match is not None
    return match.group(1)


def _comment(python: Any) -> list[str]:
    """Return the first paragraph of a kernel's docstring as a C comment."""
    words = inspect.cleandoc(python.__doc__ or "").split("\n\n")[0].replace("\n", " ").replace("*/", "* /")
    if not words:
        return []
    lines = textwrap.wrap(words, _WIDTH - 6)
    lines = [f"/* {lines[0]}", *(f"   {line}" for line in lines[1:])]
    return [*lines[:-1], f"{lines[-1]} */"]


def _grouped(declarations: Any, text: str) -> list[str]:
    """Return the declarations of local variables that the text uses; numbers of one type share a line."""
    simple: dict[str, list[str]] = {}
    further = list[str]()
    for declaration in declarations:
        if not _names(_c_name(declaration), text):
            continue
        number_type, _, name = declaration.partition(" ")
        if name.isidentifier():
            simple.setdefault(number_type, []).append(name)
        else:
            further.append(declaration)
    found = list[str]()
    for number_type, names in simple.items():
        found += textwrap.wrap(f"{number_type} {', '.join(names)}", _WIDTH - 4, subsequent_indent="        ")
    joined = list[str]()
    for line in found:  # a wrapped declaration counts as one line
        if line.startswith("        ") and joined:
            joined[-1] += f"\n    {line}"
        else:
            joined.append(line)
    return joined + further


def _runs(kinds: tuple[str, ...]) -> list[tuple[str, list[str]]]:
    groups: list[tuple[str, list[str]]] = []
    for number_type in kinds:
        if groups and groups[-1][0] == number_type:
            groups[-1][1].append(number_type)
        else:
            groups.append((number_type, [number_type]))
    return groups


def _static(text: str, returns: str) -> str:
    """Return a function as static, because no other file calls it."""
    at = text.index("*/") + 3 if text.startswith("/*") else 0
    return f"{text[:at]}static {text[at:]}"


def _struct(name: str, kinds: tuple[str, ...]) -> str:
    return f"struct {name} {{ {' '.join(f'{number_type} v{i};' for i, number_type in enumerate(kinds))} }};"


def _table(name: str, array: Array) -> str:
    sizes = "".join(f"[{size_of(size)}]" for size in array.sizes)
    return f"static const {array.kind} {name}{sizes} = {_content(array.value)};"


def _content(content: np.ndarray) -> str:
    """Return the content of a table as a C initialiser."""
    if content.ndim == 1:
        row = ", ".join(literal(value).text for value in content) or "0"
        return "{" + "\n    ".join(textwrap.wrap(row, _WIDTH - 4)) + "}"
    return "{\n" + ",\n".join(_content(part) for part in content) + "\n}" if len(content) else "{{0}}"
