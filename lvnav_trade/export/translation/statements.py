"""Statements of a kernel's body: assignments, loops, choices, what it returns."""

from __future__ import annotations

import ast
from collections import Counter
from typing import Any

from lvnav_trade.export.translation import operators
from lvnav_trade.export.translation.expressions import Expressions, Owner
from lvnav_trade.export.translation.values import (
    DOUBLE,
    INT,
    SUM,
    Array,
    Fields,
    Known,
    Scalar,
    Several,
    TranslationError,
    Value,
    as_scalar,
    held,
)

# What C means by a name, or its library: a local of that name gets a line behind it.
RESERVED = frozenset({
    "auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else", "enum", "extern", "float",
    "for", "gamma", "goto", "if", "inline", "int", "j0", "j1", "jn", "long", "main", "register", "restrict", "return",
    "self", "short", "signed", "sizeof", "static", "struct", "switch", "typedef", "union", "unsigned", "void",
    "volatile", "while", "y0", "y1", "yn", "INFINITY", "NAN",
})  # fmt: skip


class Body(Expressions):
    """The statements of one kernel. A first pass finds which names are assigned more than once, read, and of what kind
    they are; the second one writes them.
    """

    def __init__(
        self, program: Owner, function: Any, names: dict[str, Value], tree: ast.FunctionDef, earlier: Body | None
    ) -> None:
        super().__init__(program, function, names)
        self.parameters = dict(names)
        self.written = Counter(
            one.id for one in ast.walk(tree) if isinstance(one, ast.Name) and isinstance(one.ctx, ast.Store)
        )
        self.assigned: Counter[str] = Counter()
        self.kinds: dict[str, set[str]] = {}
        self.returned: list[Value] = []
        self.earlier = earlier

    # ------------------------------------------------------------------------------------------- blocks

    def block(self, nodes: list[ast.stmt]) -> bool:
        """Translate statements; return whether none behind them is reached."""
        for node in nodes:
            found = getattr(self, f"_{type(node).__name__.lower()}_statement", None)
            if found is None:
                raise self.fail(node, f"{type(node).__name__} is not translated")
            if found(node):
                return True
        return False

    def _expr_statement(self, node: ast.Expr) -> bool:
        if not isinstance(node.value, ast.Constant):  # a docstring
            found = self.value(node.value)
            if isinstance(found, Scalar):
                self.write(f"{found.text};")
        return False

    def _pass_statement(self, node: ast.Pass) -> bool:
        return False

    def _continue_statement(self, node: ast.Continue) -> bool:
        self.write("continue;")
        return True

    def _break_statement(self, node: ast.Break) -> bool:
        self.write("break;")
        return True

    def _return_statement(self, node: ast.Return) -> bool:
        found: Value = self.value(node.value) if node.value is not None else Known(None)
        if isinstance(found, Known) and isinstance(found.value, tuple):
            found = Several(tuple(Known(one) for one in found.value))
        self.returned.append(found)
        self.write(self.program.return_line(found, self.earlier.returned if self.earlier else self.returned))
        return True

    def _if_statement(self, node: ast.If) -> bool:
        condition = self.value(node.test)
        if isinstance(condition, Known):
            return self.block(node.body if condition.value else node.orelse)
        self.write(f"if ({as_scalar(condition).text}) {{")
        begin = len(self.lines)
        ends = self._inner(node.body)
        nothing = len(self.lines) == begin
        other = bool(node.orelse) and self._otherwise(node.orelse)
        if nothing and len(self.lines) == begin:
            self.lines.pop()  # nothing depends on it
        else:
            self.write("}")
        return ends and other

    def _otherwise(self, nodes: list[ast.stmt]) -> bool:
        """Write what is done where a condition does not hold; return whether nothing behind it is reached."""
        before = len(self.lines)
        self.write("} else {")
        ends = self._inner(nodes)
        inner = self.lines[before + 1 :]
        if not inner:
            self.lines.pop()
        elif inner[0].lstrip().startswith("if (") and _is_one(inner):
            head = f"{'    ' * self.indent}}} else {inner[0].lstrip()}"
            self.lines[before:] = [head, *(one[4:] for one in inner[1:-1])]
        return ends

    def _inner(self, nodes: list[ast.stmt]) -> bool:
        self.indent += 1
        ends = self.block(nodes)
        self.indent -= 1
        return ends

    def _while_statement(self, node: ast.While) -> bool:
        count = len(self.lines)
        condition = self.value(node.test)
        if len(self.lines) > count or node.orelse:
            raise self.fail(node, "a condition that needs statements of its own")
        self.write(f"while ({as_scalar(condition).text}) {{")
        self._inner(node.body)
        self.write("}")
        return False

    # -------------------------------------------------------------------------------------------- loops

    def _for_statement(self, node: ast.For) -> bool:
        if not isinstance(node.target, ast.Name) or node.orelse:
            raise self.fail(node, "loops run over one name, without else")
        name = node.target.id
        if isinstance(node.iter, ast.Call) and isinstance(node.iter.func, ast.Name) and node.iter.func.id == "range":
            bounds = [self.value(one) for one in node.iter.args]
            first, last, step = (Known(0), *bounds, Known(1)) if len(bounds) == 1 else (*bounds, Known(1))[:3]
            self._count(node, name, first, last, step)
        else:
            over = self.value(node.iter)
            if not (isinstance(over, Known) and isinstance(over.value, tuple)):
                raise self.fail(node, "loops run over a range, or over known numbers")
            for one in over.value:
                self.names[name] = Known(one)
                self.block(node.body)
        return False

    def _count(self, node: ast.For, name: str, first: Value, last: Value, step: Value) -> None:
        if not isinstance(step, Known):
            raise self.fail(node, "a step that is not known")
        if isinstance(first, Known) and isinstance(last, Known):
            passes = range(first.value, last.value, step.value)
            if len(passes) == 0:
                return
            if len(passes) == 1 and not _leaves(node.body):
                self.names[name] = first
                self.block(node.body)
                return
        label = self._label(name)
        self.names[name] = Scalar(label, INT)
        begin, end = as_scalar(first).text, held(as_scalar(last), SUM)
        moves = f"{label}++" if step.value == 1 else f"{label}--" if step.value == -1 else f"{label} += {step.value}"
        mark = len(self.lines)
        self.write(f"for (int {label} = {begin}; {label} {'<' if step.value > 0 else '>'} {end}; {moves}) {{")
        self._inner(node.body)
        if len(self.lines) == mark + 1:
            self.lines.pop()  # nothing is left of it
        else:
            self.write("}")

    # -------------------------------------------------------------------------------------- assignments

    def _assign_statement(self, node: ast.Assign) -> bool:
        found = self.value(node.value)
        if len(node.targets) > 1:
            found = self._kept(found)
        for target in node.targets:
            if isinstance(target, ast.Tuple):
                self._unpack(node, target, found)
            else:
                self.store(target, found)
        return False

    def _augassign_statement(self, node: ast.AugAssign) -> bool:
        assert isinstance(node.target, ast.Name | ast.Subscript)
        reading = ast.copy_location(_loaded(node.target), node.target)
        self.store(node.target, operators.binary(node.op, self.value(reading), self.value(node.value)))
        return False

    def _unpack(self, node: ast.Assign, target: ast.Tuple, found: Value) -> None:
        items = self._items(found, len(target.elts))
        if items is None:
            raise self.fail(node, "cannot be taken apart")
        if not _apart(target, node.value):
            items = [self._kept(item) for item in items]
        for one, item in zip(target.elts, items, strict=True):
            self.store(one, item)

    def _items(self, found: Value, count: int) -> list[Value] | None:
        items = self.items(found)
        if items is not None and len(items) == count:
            return items
        if isinstance(found, Array) and found.shape[0] == count and len(found.shape) == 1:
            return [Scalar(f"{found.text}[{i}]", found.kind) for i in range(count)]
        return None

    def _kept(self, item: Value) -> Value:
        """Keep a number that a target of the same statement may change before it is stored."""
        if not isinstance(item, Scalar):
            return item
        name = self.temporary(f"{item.kind} {{}}", "old")
        self.write(f"{name} = {item.text};")
        return Scalar(name, item.kind)

    def store(self, target: ast.expr, found: Value) -> None:
        """Write a value to a name or an element."""
        if isinstance(target, ast.Name):
            self._bind(target.id, found)
            return
        if not isinstance(target, ast.Subscript):
            raise self.fail(target, "is no place to store to")
        place = self.value(target)
        if isinstance(place, Known) or not isinstance(place, Scalar):
            raise self.fail(target, "is no element that can be written")
        self.write(f"{place.text} = {as_scalar(found).text};")

    def _label(self, name: str) -> str:
        if name in self.parameters:
            return f"{name}_now"
        return f"{name}_" if name in RESERVED else name

    def _bind(self, name: str, found: Value) -> None:
        self.assigned[name] += 1
        times = self.written[name] if self.earlier is None else self.earlier.assigned[name]
        fixed = times == 1 and name not in self.parameters
        if isinstance(found, Known):  # no number ever changes: None, a name, a function
            fixed = fixed or not isinstance(found.value, int | float)
        if isinstance(found, Fields) or (isinstance(found, Known) and fixed):
            self.names[name] = found
        elif isinstance(found, Several):
            self._bind_tuple(name, found)
        elif isinstance(found, Array):
            self._bind_array(name, found)
        else:
            self._bind_number(name, as_scalar(found))

    def _bind_tuple(self, name: str, found: Several) -> None:
        if all(isinstance(item, Scalar | Known) for item in found.items):
            parts = [as_scalar(item) for item in found.items]
            kind = DOUBLE if any(part.kind == DOUBLE for part in parts) else INT
            label = self._label(name)
            self.locals[name] = f"{kind} {label}[{len(parts)}]"
            for at, part in enumerate(parts):
                self.write(f"{label}[{at}] = {part.text};")
            self.names[name] = Array(label, (len(parts),), kind)
        else:
            self.names[name] = found

    def _bind_array(self, name: str, found: Array) -> None:
        if found.text.replace("->", "").replace("_", "").isalnum() and self.assigned[name] == 1:
            self.names[name] = found  # a whole array: its own name says more
            return
        label = self._label(name)
        declared = found.declared(label)
        if self.locals.get(name, declared) != declared:
            raise TranslationError(f"{self.function.__name__}: {name} stands for arrays of different kinds")
        self.locals[name] = declared
        self.write(f"{label} = {found.text};")
        value = found.value if self.earlier is not None and self.earlier.assigned[name] == 1 else None
        self.names[name] = Array(label, found.shape, found.kind, found.constant, found.rings, value)

    def _bind_number(self, name: str, found: Scalar) -> None:
        self.kinds.setdefault(name, set()).add(found.kind)
        kinds = self.earlier.kinds.get(name, {found.kind}) if self.earlier is not None else self.kinds[name]
        kind, label = (DOUBLE if DOUBLE in kinds else INT), self._label(name)
        self.names[name] = Scalar(label, kind)
        if self.earlier is not None and name not in self.earlier.read and "(" not in found.text:
            return  # nobody reads it
        self.locals[name] = f"{kind} {label}"
        self.write(f"{label} = {found.text};")

    def begin(self) -> None:
        """Begin with locals in the place of parameters that are assigned to."""
        for name, value in self.parameters.items():
            if self.written[name] and (self.earlier is None or self.earlier.assigned[name]):
                self._bind(name, as_scalar(value))
                self.assigned[name] -= 1


def _is_one(lines: list[str]) -> bool:
    """Return whether lines are one statement with braces: nothing but its own `else` stands at its level."""
    depth = len(lines[0]) - len(lines[0].lstrip())
    level = [one for one in lines[1:] if len(one) - len(one.lstrip()) == depth]
    return all(one.lstrip().startswith("}") for one in level) and lines[-1].strip() == "}"


def _leaves(nodes: list[ast.stmt]) -> bool:
    """Return whether statements leave a pass of the loop that they are in, or assign to a name of it twice."""
    return any(isinstance(one, ast.Continue | ast.Break) for node in nodes for one in ast.walk(node))


def _loaded(node: ast.Name | ast.Subscript) -> ast.expr:
    if isinstance(node, ast.Name):
        return ast.Name(node.id, ast.Load())
    return ast.Subscript(node.value, node.slice, ast.Load())


def _apart(target: ast.Tuple, source: ast.expr) -> bool:
    """Return whether no value of an assignment reads what another one of its targets is."""
    if not isinstance(source, ast.Tuple):
        return True  # what a function returns is complete
    written = {_base(one) for one in target.elts}
    return not any(
        isinstance(one, ast.Name | ast.Attribute) and ast.unparse(one) in written for one in ast.walk(source)
    )


def _base(node: ast.expr) -> str:
    while isinstance(node, ast.Subscript):
        node = node.value
    return ast.unparse(node)
