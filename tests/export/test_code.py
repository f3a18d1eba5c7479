"""The C of a filter: what its header says, what it is told, what is refused."""

from __future__ import annotations

import re
import subprocess

import pytest

from lvnav_trade.export.code import ESTIMATED, INPUTS, translate_filter
from lvnav_trade.quantities.errors import InputError
from tests.both_engines.covering import DIMENSIONS, covering, refusal
from tests.export.cases import FIRST, prepared_of
from tests.export.translation.compiled import needs_compiler

SOME = [case for case in covering() if not refusal(case) and case["gains"] == FIRST["gains"]][::14]


@needs_compiler
@pytest.mark.parametrize("case", SOME, ids=lambda case: f"{case['measurements']}, {case['algorithm']}")
def test_a_case_of_the_matrix_is_c99_without_a_warning(tmp_path, case):
    made = translate_filter(prepared_of(case), "A case.")
    (tmp_path / "nav_filter.h").write_text(made.header)
    (tmp_path / "nav_filter.c").write_text(made.source)
    flags = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-fsyntax-only", "nav_filter.c"]
    done = subprocess.run(["cc", *flags], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert not re.findall(r"\b(malloc|calloc|realloc|free|alloca)\b", made.source)
    assert all(name in INPUTS for fields in made.inputs.values() for name in fields)


def test_the_header_says_what_the_states_and_the_fields_are():
    made = translate_filter(prepared_of({"measurements": "ranges"}), "Filter of a test.")
    assert made.header.startswith("/* Filter of a test.")
    assert "    6 position x\n" in made.header
    assert (
        "double satellite_position[24][3]; /* position of a satellite at transmission (m), inertial frame */"
        in made.header
    )
    assert ESTIMATED["P"] in made.header
    assert re.search(r"void nav_filter_propagate\(struct nav_filter \*self\);", made.header)


def test_an_open_loop_has_corrected_outputs():
    assert translate_filter(prepared_of({"correction": "open"}), "").open_loop
    assert "nav_filter_correct_outputs(" in translate_filter(prepared_of({"correction": "open"}), "").header
    assert "nav_filter_correct_outputs(" not in translate_filter(prepared_of({"correction": "closed"}), "").header


def test_differences_of_epochs_are_told_of_two_epochs():
    phases = next(name for name, card in DIMENSIONS["measurements"].items() if "tdcp" in card["filter.measurements"])
    made = translate_filter(prepared_of({"measurements": phases}), "")
    assert made.depth == 2
    assert "modulo 2" in made.header


def test_redundant_units_are_refused():
    prepared_case = prepared_of({})

    class Units:
        redundant = True

    with pytest.raises(InputError, match="tested before the filter"):
        translate_filter(prepared_case._replace(options=prepared_case.options._replace(imu_array=Units())), "")
