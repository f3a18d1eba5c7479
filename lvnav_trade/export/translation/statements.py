"""Statements in the body of a kernel: assignments, loops, conditions, return."""

from __future__ import annotations

import ast
from collections import Counter
from dataclasses import replace
from typing import Any

from lvnav_trade.export.translation import operators
from lvnav_trade.export.translation.expressions import Expressions, Owner
from lvnav_trade.export.translation.values import (
    DOUBLE,
    INT,
    SUM,
    Array,
    Constant,
    RecordValue,
    Scalar,
    TranslationError,
    TupleValue,
    Value,
    as_scalar,
    operand_text,
)

# Names reserved by C or its library: a local variable of such a name gets an underscore.
RESERVED = frozenset({
    "auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else", "enum", "extern", "float",
    "for", "gamma", "goto", "if", "inline", "int", "j0", "j1", "jn", "long", "main", "register", "restrict", "return",
    "self", "short", "signed", "sizeof", "static", "struct", "switch", "typedef", "union", "unsigned", "void",
    "volatile", "while", "y0", "y1", "yn", "INFINITY", "NAN",
})  # fmt: skip


class Body(Expressions):
    """The statements of one kernel.

    A first pass determines which names are assigned more than once, which are read, and their types. The second pass
    writes the statements.
    """

    def __init__(
        self, program: Owner, function: Any, names: dict[str, Value], tree: ast.FunctionDef, first_pass: Body | None
    ) -> None:
        super().__init__(program, function, names)
        self.parameters = dict(names)
        name_nodes = [node for node in ast.walk(tree) if isinstance(node, ast.Name)]
        self.assignment_counts = Counter(node.id for node in name_nodes if isinstance(node.ctx, ast.Store))
        self.binding_counts: Counter[str] = Counter()
        self.c_types: dict[str, set[str]] = {}
        self.return_values: list[Value] = []
        self.first_pass = first_pass

    # ------------------------------------------------------------------------------------------- blocks

    def block(self, nodes: list[ast.stmt]) -> bool:
        """Translate statements; return whether the statements after them are unreachable."""
        for node in nodes:
            translator = getattr(self, f"_{type(node).__name__.lower()}_statement", None)
            if translator is None:
                raise self.fail(node, f"{type(node).__name__} is not translated")
            if translator(node):
                return True
        return False

    def _expr_statement(self, node: ast.Expr) -> bool:
        if not isinstance(node.value, ast.Constant):  # a docstring
            result = self.value(node.value)
            if isinstance(result, Scalar):
                self.write(f"{result.text};")
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
        return_value: Value = self.value(node.value) if node.value is not None else Constant(None)
        if isinstance(return_value, Constant) and isinstance(return_value.value, tuple):
            return_value = TupleValue(tuple(map(Constant, return_value.value)))
        self.return_values.append(return_value)
        return_values = self.first_pass.return_values if self.first_pass else self.return_values
        self.write(self.program.return_line(return_value, return_values))
        return True

    def _if_statement(self, node: ast.If) -> bool:
        condition = self.value(node.test)
        if isinstance(condition, Constant):
            return self.block(node.body if condition.value else node.orelse)
        self.write(f"if ({as_scalar(condition).text}) {{")
        begin = len(self.lines)
        is_unreachable = self._inner_block(node.body)
        is_empty = len(self.lines) == begin
        is_final = bool(node.orelse) and self._else_branch(node.orelse)
        if is_empty and len(self.lines) == begin:
            self.lines.pop()  # the condition has no effect
        else:
            self.write("}")
        return is_unreachable and is_final

    def _else_branch(self, nodes: list[ast.stmt]) -> bool:
        """Translate an else branch; return whether the statements after it are unreachable."""
        start = len(self.lines)
        self.write("} else {")
        is_unreachable = self._inner_block(nodes)
        branch_lines = self.lines[start + 1 :]
        if not branch_lines:
            self.lines.pop()
        elif branch_lines[0].lstrip().startswith("if (") and _is_one(branch_lines):
            head = f"{'    ' * self.indent}}} else {branch_lines[0].lstrip()}"
            self.lines[start:] = [head, *(line[4:] for line in branch_lines[1:-1])]
        return is_unreachable

    def _inner_block(self, nodes: list[ast.stmt]) -> bool:
        self.indent += 1
        is_unreachable = self.block(nodes)
        self.indent -= 1
        return is_unreachable

    def _while_statement(self, node: ast.While) -> bool:
        count = len(self.lines)
        condition = self.value(node.test)
        if len(self.lines) > count or node.orelse:
            raise self.fail(node, "a condition that needs statements of its own")
        self.write(f"while ({as_scalar(condition).text}) {{")
        self._inner_block(node.body)
        self.write("}")
        return False

    # -------------------------------------------------------------------------------------------- loops

    def _for_statement(self, node: ast.For) -> bool:
        if not isinstance(node.target, ast.Name) or node.orelse:
            raise self.fail(node, "loops run over one name, without else")
        name = node.target.id
        if isinstance(node.iter, ast.Call) and isinstance(node.iter.func, ast.Name) and node.iter.func.id == "range":
            bounds = [self.value(bound) for bound in node.iter.args]
            if len(bounds) == 1:
                bounds.insert(0, Constant(0))
            first, last = bounds[:2]
            step = bounds[2] if len(bounds) > 2 else Constant(1)
            self._count(node, name, first, last, step)
            return False
        values = self.value(node.iter)
        if not (isinstance(values, Constant) and isinstance(values.value, tuple)):
            raise self.fail(node, "loops run over a range, or over known numbers")
        for item in values.value:
            self.names[name] = Constant(item)
            self.block(node.body)
        return False

    def _count(self, node: ast.For, name: str, first: Value, last: Value, step: Value) -> None:
        """Translate a loop over a range; without passes or with a single pass there is no loop in C.

        name : name of the loop variable
        first, last, step : arguments of the range; `last` is excluded and the step is known
        """
        if not isinstance(step, Constant):
            raise self.fail(node, "a step that is not known")
        if isinstance(first, Constant) and isinstance(last, Constant):
            passes = range(first.value, last.value, step.value)
            if len(passes) == 0:
                return
            if len(passes) == 1 and not _has_jump(node.body):
                self.names[name] = first
                self.block(node.body)
                return
        label = self._label(name)
        self.names[name] = Scalar(label, INT)
        begin = as_scalar(first).text
        end = operand_text(as_scalar(last), SUM)
        increment = {1: f"{label}++", -1: f"{label}--"}.get(step.value, f"{label} += {step.value}")
        comparison = "<" if step.value > 0 else ">"
        start = len(self.lines)
        self.write(f"for (int {label} = {begin}; {label} {comparison} {end}; {increment}) {{")
        self._inner_block(node.body)
        if len(self.lines) == start + 1:
            self.lines.pop()  # the loop is empty
        else:
            self.write("}")

    # -------------------------------------------------------------------------------------- assignments

    def _assign_statement(self, node: ast.Assign) -> bool:
        value = self.value(node.value)
        if len(node.targets) > 1:
            value = self._temporary_copy(value)
        for target in node.targets:
            if isinstance(target, ast.Tuple):
                self._unpack(node, target, value)
            else:
                self.store(target, value)
        return False

    def _augassign_statement(self, node: ast.AugAssign) -> bool:
        assert isinstance(node.target, ast.Name | ast.Subscript)
        reading = ast.copy_location(_load_expression(node.target), node.target)
        value = self.value(reading)
        operand = self.value(node.value)
        result = operators.binary(node.op, value, operand)
        self.store(node.target, result)
        return False

    def _unpack(self, node: ast.Assign, target: ast.Tuple, value: Value) -> None:
        items = self._items(value, len(target.elts))
        if items is None:
            raise self.fail(node, "cannot be taken apart")
        if not _is_independent(target, node.value):
            items = [self._temporary_copy(item) for item in items]
        for element, item in zip(target.elts, items, strict=True):
            self.store(element, item)

    def _items(self, value: Value, count: int) -> list[Value] | None:
        """Return the numbers of a tuple or of an array with `count` elements; None for any other value."""
        items = self.items(value)
        if items is not None and len(items) == count:
            return items
        if isinstance(value, Array) and value.shape[0] == count and len(value.shape) == 1:
            return [Scalar(f"{value.text}[{i}]", value.c_type) for i in range(count)]
        return None

    def _temporary_copy(self, item: Value) -> Value:
        """Copy a number to a temporary if another target of the same statement may change it first."""
        if not isinstance(item, Scalar):
            return item
        name = self.temporary(f"{item.c_type} {{}}", "old")
        self.write(f"{name} = {item.text};")
        return Scalar(name, item.c_type)

    def store(self, target: ast.expr, value: Value) -> None:
        """Store a value to a name or an array element."""
        if isinstance(target, ast.Name):
            self._bind(target.id, value)
            return
        if not isinstance(target, ast.Subscript):
            raise self.fail(target, "is no place to store to")
        place = self.value(target)
        if not isinstance(place, Scalar):
            raise self.fail(target, "is no element that can be written")
        self.write(f"{place.text} = {as_scalar(value).text};")

    def _label(self, name: str) -> str:
        if name in self.parameters:
            return f"{name}_now"
        return f"{name}_" if name in RESERVED else name

    def _bind(self, name: str, value: Value) -> None:
        """Give a name a value: known values stay values, numbers that vary become a local variable."""
        self.binding_counts[name] += 1
        counts = self.assignment_counts if self.first_pass is None else self.first_pass.binding_counts
        is_fixed = counts[name] == 1 and name not in self.parameters
        if isinstance(value, Constant) and not isinstance(value.value, int | float):
            is_fixed = True  # not a number that can change: None, a name, a function
        if isinstance(value, RecordValue) or (isinstance(value, Constant) and is_fixed):
            self.names[name] = value
        elif isinstance(value, TupleValue):
            self._bind_tuple(name, value)
        elif isinstance(value, Array):
            self._bind_array(name, value)
        else:
            self._bind_number(name, as_scalar(value))

    def _bind_tuple(self, name: str, value: TupleValue) -> None:
        if not all(isinstance(item, Scalar | Constant) for item in value.items):
            self.names[name] = value
            return
        numbers = [as_scalar(item) for item in value.items]
        number_type = operators.common_type(numbers)
        label = self._label(name)
        self.locals[name] = f"{number_type} {label}[{len(numbers)}]"
        for k, number in enumerate(numbers):
            self.write(f"{label}[{k}] = {number.text};")
        self.names[name] = Array(label, (len(numbers),), number_type)

    def _bind_array(self, name: str, array: Array) -> None:
        is_whole = array.text.replace("->", "").replace("_", "").isalnum()
        if is_whole and self.binding_counts[name] == 1:
            self.names[name] = array  # a whole array keeps its own name
            return
        label = self._label(name)
        declaration = array.declaration(label)
        if self.locals.get(name, declaration) != declaration:
            raise TranslationError(f"{self.function.__name__}: {name} stands for arrays of different kinds")
        self.locals[name] = declaration
        self.write(f"{label} = {array.text};")
        is_assigned_once = self.first_pass is not None and self.first_pass.binding_counts[name] == 1
        self.names[name] = replace(array, text=label, value=array.value if is_assigned_once else None)

    def _bind_number(self, name: str, number: Scalar) -> None:
        self.c_types.setdefault(name, set()).add(number.c_type)
        # The first pass knows the types of all assignments to the name
        c_types = self.c_types[name] if self.first_pass is None else self.first_pass.c_types.get(name, {number.c_type})
        number_type = DOUBLE if DOUBLE in c_types else INT
        label = self._label(name)
        self.names[name] = Scalar(label, number_type)
        if self.first_pass is not None and name not in self.first_pass.read_names and "(" not in number.text:
            return  # it is never read
        self.locals[name] = f"{number_type} {label}"
        self.write(f"{label} = {number.text};")

    def begin(self) -> None:
        """Declare local variables for parameters that the kernel assigns to."""
        for name, value in self.parameters.items():
            if self.assignment_counts[name] and (self.first_pass is None or self.first_pass.binding_counts[name]):
                self._bind(name, as_scalar(value))
                self.binding_counts[name] -= 1


def _is_one(lines: list[str]) -> bool:
    """Return whether lines form one C statement with braces; only its own `else` is at its level."""
    if lines[-1].strip() != "}":
        return False
    depth = _indentation(lines[0])
    lines_at_level = [line.lstrip() for line in lines[1:] if _indentation(line) == depth]
    return all(line.startswith("}") for line in lines_at_level)


def _indentation(line: str) -> int:
    return len(line) - len(line.lstrip())


def _has_jump(nodes: list[ast.stmt]) -> bool:
    """Return whether statements contain continue or break."""
    inner_nodes = [inner for node in nodes for inner in ast.walk(node)]
    return any(isinstance(inner, ast.Continue | ast.Break) for inner in inner_nodes)


def _is_independent(target: ast.Tuple, source: ast.expr) -> bool:
    """Return whether no value of an assignment reads another of its targets."""
    if not isinstance(source, ast.Tuple):
        return True  # the results of a call are complete before the first of them is stored
    target_texts = {_base(element) for element in target.elts}
    for node in ast.walk(source):
        if isinstance(node, ast.Name | ast.Attribute) and ast.unparse(node) in target_texts:
            return False
    return True


def _load_expression(node: ast.Name | ast.Subscript) -> ast.expr:
    if isinstance(node, ast.Name):
        return ast.Name(node.id, ast.Load())
    return ast.Subscript(node.value, node.slice, ast.Load())


def _base(node: ast.expr) -> str:
    while isinstance(node, ast.Subscript):
        node = node.value
    return ast.unparse(node)
