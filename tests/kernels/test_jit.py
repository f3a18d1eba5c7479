"""Compiled code is kept per version of the sources, and divides as numpy does."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core.registry import CPUDispatcher

from lvnav_trade.kernels.jit import array_jit, inline_jit, jit


@jit
def ratio(a, b):
    return a / b


@inline_jit
def _twice(a):
    return 2.0 * a


@jit
def four_times(a):
    return _twice(_twice(a))


def test_a_division_by_zero_is_infinite_or_no_number_and_no_error() -> None:
    assert ratio(1.0, 0.0) == np.inf
    assert np.isnan(ratio(0.0, 0.0))


def test_a_step_that_is_compiled_into_its_caller_computes_the_same() -> None:
    assert four_times(1.5) == 6.0


@array_jit
def copied(a):
    b = np.empty(a.size)
    b[:] = a
    return b


@jit
def summed(a):
    b = np.empty(a.size)
    b[:] = a
    return b[0] + b[1]


def test_only_a_kernel_that_says_so_makes_arrays_and_counts_references() -> None:
    given = np.arange(3.0)
    np.testing.assert_array_equal(copied(given), given)
    with pytest.raises(numba.TypingError, match="empty"):
        summed(given)


CALLERS = """
import numpy as np
from lvnav_trade.kernels.jit import jit

@jit
def plus_one(a):
    return a + np.exp(0.0 * a)

@jit
def plus_two(a):
    return plus_one(plus_one(a))

@jit
def plus_three(a):
    return plus_two(plus_one(a))
"""


ROWS = "from lvnav_trade.kernels.jit import array_jit\n" + "".join(
    f"""
@{decorator}
def {name}(rows):
    best = rows[0]
    for i in range(rows.shape[0]):
        row = rows[i]
        if row[0] + row[1] > best[0] + best[1]:
            best = row
    return best[0] + best[1]
"""
    for name, decorator in (("largest", "jit"), ("largest_counted", "array_jit"))
)
LANES = """
from lvnav_trade.kernels.lanes import view

@jit
def doubled(x):
    x[0] = x[0] * 2.0

@jit
def lifted(x):
    x[0] = x[0] + 2.0

@jit
def double(x):
    doubled(view(x))

@jit
def lift(x):
    lifted(view(x))

@jit
def both(x):
    doubled(view(x))
    lifted(view(x))
"""


@pytest.fixture
def say(tmp_path: Path) -> Callable[[str], str]:
    """Return a function that runs a line beside the kernels above in a process of its own, and returns what it prints.

    All processes of a test share a cache that is empty at first.
    """
    (tmp_path / "callers.py").write_text(CALLERS + ROWS + LANES)
    environment = {
        **os.environ,
        "NUMBA_CACHE_DIR": str(tmp_path / "kernels-here"),
        "PYTHONPATH": os.pathsep.join([str(Path(__file__).resolve().parents[2]), str(tmp_path)]),
    }

    def run(line: str) -> str:
        command = [sys.executable, "-c", f"from callers import *\n{line}"]
        return subprocess.run(command, capture_output=True, text=True, env=environment, check=True).stdout.strip()

    return run


def test_a_kernel_that_only_kernels_call_gets_no_entry_for_python_until_python_calls_it(say) -> None:
    entries = "len(plus_one.inner.signatures), len(plus_one.signatures)"
    assert say(f"plus_two(1.0); print({entries}); print(plus_one(2.0), {entries})") == "1 0\n3.0 1 1"


def test_a_kernel_that_only_kernels_call_has_no_machine_code_of_its_own(say) -> None:
    size = "len(next(iter({}.overloads.values())).library._get_compiled_object())"
    part, whole = say(f"plus_two(1.0); print({size.format('plus_one.inner')}, {size.format('plus_two')})").split()
    assert int(part) == 0
    assert int(whole) > 500


def test_of_an_entry_the_cache_keeps_machine_code_alone_and_of_a_part_what_callers_are_built_from(
    say, tmp_path
) -> None:
    say("plus_two(1.0)")
    bitcode = {path.name.partition("-")[0]: b"BC\xc0\xde" in path.read_bytes() for path in tmp_path.rglob("*.nbc")}
    assert bitcode == {
        "callers.plus_two": False,
        "callers.plus_one_part_of_lvnav_trade": True,
    }
    assert say("print(plus_two(1.0), sum(plus_two.stats.cache_hits.values()))") == "3.0 1"


def test_code_of_others_is_compiled_as_ever() -> None:
    @numba.njit
    def halve(a):
        return 0.5 * a

    assert halve(3.0) == 1.5
    assert type(halve) is CPUDispatcher


def test_what_one_process_has_kept_of_a_kernel_another_one_builds_a_new_caller_with(say) -> None:
    assert say("print(plus_two(1.0))") == "3.0"
    assert say("print(plus_three(1.0), sum(plus_one.inner.stats.cache_hits.values()))") == "4.0 1"
    assert say("print(plus_one(1.0), plus_three(2.0))") == "2.0 5.0"


def test_without_compilation_a_kernel_is_the_python_function() -> None:
    code = (
        "from lvnav_trade.kernels.earth import gravity_j4\n"
        "assert not hasattr(gravity_j4, 'signatures')\n"
        "print(repr(gravity_j4(4.0e6, 3.0e6, 4.1e6)))"
    )
    root = Path(__file__).resolve().parents[2]
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(root)}
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True)
    from lvnav_trade.kernels.earth import gravity_j4

    interpreted = [float(word.strip("()np.float64 \n")) for word in found.stdout.split(",")]
    np.testing.assert_allclose(interpreted, gravity_j4(4.0e6, 3.0e6, 4.1e6), rtol=1e-15)


def test_a_kernel_on_what_it_is_given_counts_no_references(say) -> None:
    code = "next(iter({}.inspect_llvm().values()))"
    counts = ", ".join(f"'@NRT_incref(' in {code.format(name)}" for name in ("largest", "largest_counted"))
    assert say(f"x = np.eye(2); print(largest(x), largest_counted(x), {counts})") == "1.0 1.0 False True"


def test_parts_that_different_processes_compiled_fit_together(say) -> None:
    """Both parts hold a function of one name and signature, which works out an operator: one multiplies, one adds."""
    say("double(np.ones((1, 8)))")
    say("lift(np.ones((1, 8)))")
    hits = ", ".join(f"sum({part}.inner.stats.cache_hits.values())" for part in ("doubled", "lifted"))
    assert say(f"x = np.full((1, 8), 3.0); both(x); print(x[0, 0], {hits})") == "8.0 1 1"


def test_a_forked_process_counts_its_functions_apart(say) -> None:
    line = (
        "import os; from numba.core.bytecode import FunctionIdentity as F\n"
        "r, w = os.pipe()\n"
        "if os.fork() == 0: os.write(w, str(next(F._unique_ids)).encode()); os._exit(0)\n"
        "print(next(F._unique_ids) - int(os.read(r, 99)) != 0)"
    )
    assert say(line) == "True"


def _decorated(tree: ast.Module) -> dict[str, tuple[set[str], ast.FunctionDef]]:
    """Return the functions of a module with the names of their decorators."""
    return {
        node.name: ({item.id for item in node.decorator_list if isinstance(item, ast.Name)}, node)
        for node in tree.body
        if isinstance(node, ast.FunctionDef)
    }


def _origins(tree: ast.Module, module: str) -> dict[str, tuple[str, str]]:
    """Return module and name of what the names of a module are."""
    origins = {name: (module, name) for name in _decorated(tree)}
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and node.module:
            origins |= {item.asname or item.name: (node.module, item.name) for item in node.names}
    return origins


def test_no_kernel_without_counted_references_calls_one_that_makes_arrays() -> None:
    """It would never give the array back: the memory of guided runs grew by 1.6 MB a run."""
    root = Path(__file__).resolve().parents[2]
    texts = {path: path.read_text() for path in (root / "lvnav_trade").rglob("*.py")}
    trees = {
        ".".join(path.relative_to(root).with_suffix("").parts): ast.parse(text)
        for path, text in texts.items()
        if "jit" in text  # the others have no kernel
    }
    functions = {module: _decorated(tree) for module, tree in trees.items()}
    makers = {
        (module, name)
        for module, of_module in functions.items()
        for name, (decorators, _) in of_module.items()
        if "array_jit" in decorators
    }
    assert len(makers) > 20
    origins = {module: _origins(tree, module) for module, tree in trees.items()}
    offences = [
        f"{module}.{name} calls {call.func.id}"
        for module, of_module in functions.items()
        for name, (decorators, function) in of_module.items()
        if decorators & {"jit", "inline_jit"}
        for call in ast.walk(function)
        if isinstance(call, ast.Call)
        and isinstance(call.func, ast.Name)
        and origins[module].get(call.func.id) in makers
    ]
    assert offences == []
