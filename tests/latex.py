"""Values of the formulas that the manual prints: products, cross products and sums of vectors and matrices.

A column vector is an array (n, 1), a matrix (n, m), a scalar (). Symbols are looked up as they are printed, index and
all, such as ``C_b^i`` or ``\\dot\\ell^i``.
"""

from __future__ import annotations

import re

import numpy as np

Value = np.ndarray
TOKEN = re.compile(
    r"\\mathsf\{T\}|\\mathrm\{diag\}|\\[A-Za-z]+|[A-Za-z]'?|\d+(?:\.\d+)?|[-+/()\[\]{}^_]"
)  # fmt: skip
ACCENTS = {r"\dot", r"\hat"}
SPACES = re.compile(r"\\[,;!]|\\ |\s+|\\bigl|\\bigr")


def skew(v: Value) -> Value:
    """Return the matrix of the cross product with v (3, 1)."""
    x, y, z = v.ravel()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def product(a: Value, b: Value) -> Value:
    """Return the product of scalars, vectors and matrices."""
    return a * b if a.ndim == 0 or b.ndim == 0 else a @ b


class _Reader:
    def __init__(self, text: str, symbols: dict[str, Value]) -> None:
        plain = SPACES.sub(" ", text)
        self.tokens = TOKEN.findall(plain)
        assert "".join(self.tokens) == plain.replace(" ", ""), text
        self.symbols, self.at = symbols, 0

    def ahead(self, k: int = 0) -> str:
        return self.tokens[self.at + k] if self.at + k < len(self.tokens) else ""

    def take(self, wanted: str = "") -> str:
        found = self.ahead()
        assert found, "the formula ends early"
        assert wanted in ("", found), (wanted, found)
        self.at += 1
        return found

    def total(self) -> Value:
        sign = -1.0 if self.ahead() == "-" and self.take() else 1.0
        value = sign * self.product()
        while self.ahead() in ("+", "-"):
            sign = 1.0 if self.take() == "+" else -1.0
            value = value + sign * self.product()
        return np.asarray(value)

    def product(self) -> Value:
        value = self.factor()
        while self.ahead() not in ("", "+", "-", ")", "]", "}"):
            if self.ahead() == r"\times":
                if self.ahead(1) == "]":
                    break
                self.take()
                value = np.cross(value.ravel(), self.factor().ravel())[:, None]
            elif self.ahead() == r"\cdot":
                self.take()
                value = np.asarray(value.ravel() @ self.factor().ravel())
            else:
                value = product(value, self.factor())
        return value

    def group(self, opens: str, closes: str) -> Value:
        self.take(opens)
        value = self.total()
        self.take(closes)
        return value

    def factor(self) -> Value:
        token = self.ahead()
        if token == "(":
            value = self.group("(", ")")
        elif token == "[":
            self.take()
            value = skew(self.total())
            self.take(r"\times")
            self.take("]")
        elif token == r"\frac":
            self.take()
            above, below = self.group("{", "}"), self.group("{", "}")
            value = above / below
        elif token == r"\mathrm{diag}":
            self.take()
            value = np.diag(self.group("(", ")").ravel())
        elif token[:1].isdigit():
            value = np.asarray(float(self.take()))
        else:
            value = self.symbol()
        while self.ahead() == "^":
            self.take()
            raised = self.take()
            value = value.T if raised == r"\mathsf{T}" else value ** float(raised)
        return value

    def symbol(self) -> Value:
        name = self.take()
        if name in ACCENTS:
            name += self.take()
        if self.ahead() == "_":
            name += self.take() + self.index()
        if self.ahead() == "^" and self.ahead(1) != r"\mathsf{T}" and not self.ahead(1).isdigit():
            name += self.take() + self.index()
        assert name in self.symbols, f"{name} is no symbol of {sorted(self.symbols)}"
        return self.symbols[name]

    def index(self) -> str:
        if self.ahead() != "{":
            return self.take()
        self.take()
        inner = ""
        while self.ahead() != "}":
            inner += self.take()
        self.take()
        return inner


def evaluate(formula: str, symbols: dict[str, Value]) -> Value:
    """Return the value of a printed formula; AssertionError where it has what this page does not know."""
    reader = _Reader(formula, symbols)
    value = reader.total()
    assert reader.ahead() == "", f"{formula}: {reader.tokens[reader.at :]} is left"
    return value
