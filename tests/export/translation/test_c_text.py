"""Texts of C: names in declarations, local names in a text, grouped declarations, tables."""

import pytest

from lvnav_trade.export.translation.c_text import declaration_lines, declared_name, refers_to, struct_line, table_text
from lvnav_trade.export.translation.expressions import constant_array


@pytest.mark.parametrize(
    ("declaration", "name"),
    [("double x", "x"), ("double (*P)[15]", "P"), ("const int *used", "used"), ("double old_1[3]", "old_1")],
)
def test_the_name_in_a_declaration_is_found(declaration, name):
    assert declared_name(declaration) == name


@pytest.mark.parametrize(
    ("text", "refers"), [("x + 1", True), ("2 * x", True), ("self->x", False), ("a.x", False), ("xy", False)]
)
def test_a_field_of_a_struct_is_no_local_name(text, refers):
    assert refers_to("x", text) is refers


def test_numbers_of_one_type_share_a_declaration_and_unused_ones_have_none():
    declarations = ["double a", "int n", "double b", "double unused", "double v[3]"]
    assert declaration_lines(declarations, "v[n] = a + b;") == ["double a, b", "int n", "double v[3]"]


def test_tables_and_structs_are_definitions():
    assert table_text("T", constant_array("T", [1.0, 2.0])) == "static const double T[2] = {1.0, 2.0};"
    assert struct_line("pair", ("double", "int")) == "struct pair { double v0; int v1; };"
