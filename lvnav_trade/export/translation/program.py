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
from itertools import groupby
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.export.translation.c_text import (
    WIDTH,
    comment_lines,
    declaration_lines,
    declared_name,
    refers_to,
    static_text,
    struct_line,
    table_text,
    uses_self,
)
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
)
from lvnav_trade.kernels.choice import source_of


class TranslatedKernel(NamedTuple):
    """A kernel in C.

    name : Name of the C function.
    parameters : Declarations of the parameters by their name in the kernel.
    text : Text of the function.
    returns : Return type.
    c_types : C types of the returned numbers.
    constant : Returned value, if the function does nothing else; otherwise None.
    has_statements : Whether the function has statements; without any, calls are omitted.
    """

    name: str
    parameters: dict[str, str]
    text: str
    returns: str
    c_types: tuple[str, ...]
    constant: Constant | None
    has_statements: bool


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

    def global_value(self, value: Any, label: str) -> Value:
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
            if existing.text.startswith(label.strip("_").upper()) and _is_equal_array(existing.value, array.value):
                return existing
        name = label.strip("_").upper()  # local variables are never in capitals
        while name in self.tables:
            name += "_"
        self.tables[name] = constant_array(name, array.value)
        return self.tables[name]

    # -------------------------------------------------------------------------------------------- calls

    def call(
        self, body: Body | Any, node: ast.Call, function: Any, arguments: list[Value], keywords: Mapping[str, Value]
    ) -> Value:
        """Return the result of a kernel called from the body of another.

        Parameters
        ----------
        body : Body
            Body of the calling kernel, to which statements are added.
        node : ast.Call
            The call.
        function : callable
            The kernel.
        arguments, keywords
            Positional and keyword arguments.

        Returns
        -------
        Value
            Constant if the result is known, otherwise a C expression or the numbers of a returned struct.
        """
        bound_arguments = bind_arguments(function, arguments, keywords)
        kernel = self.translated_kernel(function, bound_arguments)
        if kernel.constant is not None:
            return kernel.constant
        if not kernel.has_statements:
            return Constant(None)
        texts = ["self"] if uses_self(kernel.text) else []
        for name in kernel.parameters:
            texts.append(_argument_text(bound_arguments, name))
        text = f"{kernel.name}({', '.join(texts)})"
        if kernel.returns == "void":
            return Scalar(text, "void")
        if len(kernel.c_types) == 1 and not kernel.returns.startswith("struct"):
            return Scalar(text, kernel.c_types[0])
        name = body.temporary(f"{kernel.returns} {{}}", "of")
        body.write(f"{name} = {text};")
        numbers = [Scalar(f"{name}.v{i}", number_type) for i, number_type in enumerate(kernel.c_types)]
        return TupleValue(tuple(numbers))

    def translated_kernel(
        self, function: Any, arguments: dict[str, Value], name: str | None = None
    ) -> TranslatedKernel:
        """Return a kernel for named arguments; it is translated at the first call with arguments of these types.

        Parameters
        ----------
        function : callable
            The kernel, compiled or not.
        arguments : dict
            Arguments by name.
        name : str, optional
            C name of an entry function; by default a new name is derived from that of the kernel.

        Raises
        ------
        TranslationError
            The function is not a kernel, or has an expression without translation.
        """
        python = getattr(function, "py_func", function)
        if not callable(python) or not hasattr(python, "__code__"):
            raise TranslationError(f"{function!r} is no kernel")
        key = (python, tuple((argument, _signature(value)) for argument, value in arguments.items()))
        if key not in self.functions:
            self.functions[key] = self._translate(python, arguments, name)
        return self.functions[key]

    def _translate(self, python: Callable[..., Any], arguments: dict[str, Value], name: str | None) -> TranslatedKernel:
        """Translate a kernel for arguments of given types.

        name : name of an entry function; None for a new name after the kernel
        """
        tree = ast.parse(textwrap.dedent(source_of(python))).body[0]
        assert isinstance(tree, ast.FunctionDef)
        names, declarations = _parameters(arguments)
        first_pass = self._pass(python, tree, dict(names), None)
        body = self._pass(python, tree, dict(names), first_pass)
        c_types, returns = self._returns(first_pass.return_values)
        constant = None
        if len(body.lines) == 1 and len(body.return_values) == 1 and isinstance(body.return_values[0], Constant):
            constant = body.return_values[0]
        body.lines = self._live_lines(body)
        text = "\n".join(body.lines)
        parameters = {
            parameter: declaration
            for parameter, declaration in declarations.items()
            if refers_to(declared_name(declaration), text)
        }
        name = name or self._new_name(python)
        signature_parts = list(parameters.values())
        if uses_self(text):
            signature_parts.insert(0, f"struct {self.state} *self")
        signature = f"{returns} {name}({', '.join(signature_parts) or 'void'})"
        lines = [*comment_lines(python), *textwrap.wrap(signature, WIDTH, subsequent_indent="    "), "{"]
        lines += [f"    {local};" for local in declaration_lines(body.locals.values(), text)]
        lines += [*body.lines, "}"]
        return TranslatedKernel(
            name=name,
            parameters=parameters,
            text="\n".join(lines),
            returns=returns,
            c_types=c_types,
            constant=constant,
            has_statements=bool(body.lines),
        )

    def _new_name(self, python: Callable[..., Any]) -> str:
        """Return a new name for a C function: module and name of the kernel, with a number from the second on."""
        stem = f"{python.__module__.rpartition('.')[2]}_{python.__name__.strip('_')}"
        self._names[stem] += 1
        return stem if self._names[stem] == 1 else f"{stem}_{self._names[stem]}"

    def _pass(self, python: Any, tree: ast.FunctionDef, names: dict[str, Value], first_pass: Body | None) -> Body:
        body = Body(self, python, names, tree, first_pass)
        body.begin()
        try:
            body.block(tree.body)
        except TranslationError as error:
            if "line" in str(error) or type(error) is not TranslationError:
                raise
            raise TranslationError(f"{python.__module__}.{python.__name__}: {error}") from error
        return body

    def _live_lines(self, body: Body) -> list[str]:
        """Return the lines of a body without assignments to local variables that are never read; calls remain.

        An assignment may be the only reader of another variable, so this repeats until nothing changes.
        """
        lines = body.lines
        previous_lines: list[str] = []
        while lines != previous_lines:
            previous_lines = lines
            for name in map(declared_name, body.locals.values()):
                lines = self._without_assignments(lines, name)
        return lines

    def _without_assignments(self, lines: list[str], name: str) -> list[str]:
        """Return lines without the assignments to a variable if no line reads it; of calls the call remains."""
        assignment = re.compile(rf"^(\s*){name} = (.*);$")
        if any(refers_to(name, line) and not assignment.match(line) for line in lines):
            return lines
        function_names = {function.name for function in self.functions.values()}
        live_lines = []
        for line in lines:
            match = assignment.match(line)
            if match is None:
                live_lines.append(line)
                continue
            indent, expression = match.groups()
            if function_names & set(re.findall(r"(\w+)\(", expression)):
                live_lines.append(f"{indent}{expression};")
        return live_lines

    # ------------------------------------------------------------------------------------------ returns

    def _returns(self, return_values: list[Value]) -> tuple[tuple[str, ...], str]:
        """Return the C types of the returned numbers, and the return type in C."""
        rows = [value.items if isinstance(value, TupleValue) else (value,) for value in return_values]
        rows = [row for row in rows if row != (Constant(None),)]
        if not rows:
            return (), "void"
        c_types = []
        for column in zip(*rows, strict=True):
            number_types = {as_scalar(item).c_type for item in column}
            c_types.append(DOUBLE if DOUBLE in number_types else INT)
        if len(c_types) == 1 and not any(isinstance(value, TupleValue) for value in return_values):
            return tuple(c_types), c_types[0]
        label = "_".join(f"{number_type[0]}{len(list(run))}" for number_type, run in groupby(c_types))
        self.tuples[f"numbers_{label}"] = tuple(c_types)
        return tuple(c_types), f"struct numbers_{label}"

    def return_line(self, value: Value, return_values: list[Value]) -> str:
        """Return the statement that returns a value from a function with the given return values."""
        if value == Constant(None):
            return "return;"
        if not isinstance(value, TupleValue):
            return f"return {as_scalar(value).text};"
        _, returns = self._returns(return_values)
        items = ", ".join(as_scalar(item).text for item in value.items)
        return f"return ({returns}){{{items}}};"

    # --------------------------------------------------------------------------------------------- text

    def text(self, entries: list[str]) -> str:
        """Return the C code of everything that the named functions need: types, tables, functions."""
        required_names = self._required_names(entries)
        functions = []
        for function in self.functions.values():
            if function.name in entries:
                functions.append(function.text)
            elif function.name in required_names:
                functions.append(static_text(function.text))
        code = "\n\n\n".join(functions)
        words = set(re.findall(r"\w+", code))
        types = [struct_line(name, c_types) for name, c_types in self.tuples.items() if name in words]
        tables = [table_text(name, array) for name, array in self.tables.items() if name in words]
        sections = ["\n".join(types), "\n\n".join(tables), code]
        return "\n\n".join(section for section in sections if section) + "\n"

    def _required_names(self, entries: list[str]) -> set[str]:
        """Return the names of functions and of all that they call, directly or through others."""
        by_name = {function.name: function for function in self.functions.values()}
        pending = list(entries)
        required_names: set[str] = set()
        while pending:
            name = pending.pop()
            if name not in required_names:
                required_names.add(name)
                callees = re.findall(r"\b(\w+)\(", by_name[name].text)
                pending += [callee for callee in callees if callee in by_name]
        return required_names


def _is_equal_array(a: np.ndarray, b: np.ndarray) -> bool:
    return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")


def bind_arguments(function: Any, arguments: list[Value], keywords: Mapping[str, Value]) -> dict[str, Value]:
    """Return the arguments of a call by parameter name, including defaults.

    arguments, keywords : positional and keyword arguments
    """
    python = getattr(function, "py_func", function)
    binding = inspect.signature(python).bind(*arguments, **keywords)
    binding.apply_defaults()
    values = {}
    for name, value in binding.arguments.items():
        is_value = isinstance(value, Constant | Scalar | Array | TupleValue | RecordValue)
        values[name] = value if is_value else Constant(value)
    return values


def _signature(value: Value) -> Any:
    """Return the properties of an argument that require a separate translation: all known values except doubles."""
    if isinstance(value, Constant):
        return (type(value.value), None if isinstance(value.value, float) else value.value)
    if isinstance(value, Scalar):
        return value.c_type
    if isinstance(value, Array):
        shape = tuple(None if isinstance(size, Scalar) else size for size in value.shape)
        return (shape, value.c_type, value.constant, value.rings)
    if isinstance(value, TupleValue):
        return tuple(_signature(item) for item in value.items)
    return value.name


def _parameters(arguments: dict[str, Value]) -> tuple[dict[str, Value], dict[str, str]]:
    """Return the values of a kernel's names, and the C parameters for them."""
    names: dict[str, Value] = {}
    declarations: dict[str, str] = {}
    for name, value in arguments.items():
        label = _safe_name(name)
        if isinstance(value, Scalar) or (isinstance(value, Constant) and isinstance(value.value, float)):
            number_type = value.c_type if isinstance(value, Scalar) else DOUBLE
            names[name] = Scalar(label, number_type)
            declarations[name] = f"{number_type} {label}"
        elif isinstance(value, Array):
            shape = tuple(Scalar(f"n_{label}", INT) if isinstance(size, Scalar) else size for size in value.shape)
            names[name] = Array(label, shape, value.c_type, value.constant, value.rings)
            declarations[name] = value.declaration(label)
            if any(isinstance(size, Scalar) for size in shape):
                declarations[f"{name}.n"] = f"int n_{label}"
        elif isinstance(value, TupleValue):
            items = []
            for k, item in enumerate(value.items):
                number = Scalar(f"{label}_{k}", as_scalar(item).c_type)
                items.append(number)
                declarations[f"{name}.{k}"] = f"{number.c_type} {number.text}"
            names[name] = TupleValue(tuple(items))
        else:
            names[name] = value
    return names, declarations


def _argument_text(arguments: dict[str, Value], parameter: str) -> str:
    """Return the C expression that a call passes for a parameter."""
    name, _, field = parameter.partition(".")
    value = arguments[name]
    if isinstance(value, Array):
        if not field:
            return value.text
        unknown_sizes = [size for size in value.shape if isinstance(size, Scalar)]
        return unknown_sizes[0].text
    if isinstance(value, TupleValue):
        return as_scalar(value.items[int(field)]).text
    return literal(value.value).text if isinstance(value, Constant) else as_scalar(value).text


def _safe_name(name: str) -> str:
    return f"{name}_" if name in RESERVED else name
