"""What is public says what it is; a module's first line is its caption."""

from __future__ import annotations

import ast


def _public(tree: ast.Module):
    """Yield public functions and classes of a module, and public methods of public classes."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            yield node
            if isinstance(node, ast.ClassDef):
                yield from (item for item in _public(node) if isinstance(item, ast.FunctionDef))


def test_every_public_function_and_class_has_a_docstring(modules):
    bare = [
        f"{module.at(node)} {node.name}"
        for module in modules
        for node in _public(module.tree)
        if not ast.get_docstring(node)
    ]
    assert bare == []


def test_every_module_begins_with_a_caption(modules):
    wrong = {}
    for module in modules:
        first, _, rest = (ast.get_docstring(module.tree) or "").partition("\n")
        one_sentence_alone = first.endswith(".") and (not rest or rest.startswith("\n"))
        if not one_sentence_alone:
            wrong[str(module.path)] = first
    assert wrong == {}
