"""Habits that a reader relies on: no global generator, no stray print, frames in names, tests beside every module."""

from __future__ import annotations

import ast
import re
import tomllib
from fnmatch import fnmatch

import pytest

SEEDED = {"Generator", "BitGenerator", "SeedSequence", "Philox", "PCG64", "default_rng"}
FRAMES = "ienlbao"
MISNAMED = (
    re.compile(rf"^[Cq]_(?![{FRAMES}]_[{FRAMES}](_|$))[a-z]_[a-z](_|$)"),  # C_b_e, q_b_i: from, to
    re.compile(rf"^w_(?![{FRAMES}]{{2}}_[{FRAMES}](_|$))[a-z]{{2}}_[a-z](_|$)"),  # w_ib_b: of b relative to i, in b
    re.compile(rf"^[rvf]_(?![{FRAMES}xyz](_|$))[a-z](_|$)"),  # r_i, v_n, f_b: resolved in; f_x: a component
)
UNTESTED: set[str] = set()  # modules whose test stands elsewhere, each with its reason; empty is the aim


def _dotted(node: ast.expr) -> str:
    """Return ``np.random.normal`` for such an attribute, and nothing for any other expression."""
    if isinstance(node, ast.Name):
        return node.id
    return f"{_dotted(node.value)}.{node.attr}" if isinstance(node, ast.Attribute) else ""


def _random_offence(node: ast.AST) -> bool:
    if isinstance(node, ast.Import):
        return any(name.name == "random" for name in node.names)
    if isinstance(node, ast.ImportFrom):
        return node.module == "random" or (node.module == "numpy.random" and {n.name for n in node.names} > SEEDED)
    if isinstance(node, ast.Call) and _dotted(node.func).endswith("default_rng"):
        return not node.args and not node.keywords
    return bool(
        isinstance(node, ast.Attribute)
        and re.match(r"^(np|numpy)\.random\.", _dotted(node))
        and _dotted(node).split(".")[2] not in SEEDED
    )


def test_no_code_draws_from_a_global_or_unseeded_generator(modules):
    offences = [module.at(node) for module in modules for node in ast.walk(module.tree) if _random_offence(node)]
    assert offences == []


def test_no_kernel_uses_a_generator_of_numpy_at_all(modules):
    kernels = [module for module in modules if module.name.startswith("lvnav_trade.kernels")]
    assert kernels
    assert [str(m.path) for m in kernels if re.search(r"\b(np|numpy)\.random\b", m.text)] == []


def test_only_the_console_prints(modules):
    prints = [
        module.at(node)
        for module in modules
        if not module.name.startswith("lvnav_trade.cli")
        for node in ast.walk(module.tree)
        if isinstance(node, ast.Call) and _dotted(node.func) == "print"
    ]
    assert prints == []


def test_names_of_vectors_and_rotations_end_in_a_frame(modules):
    wrong = set()
    for module in modules:
        for node in ast.walk(module.tree):
            stored = isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
            name = node.arg if isinstance(node, ast.arg) else node.id if stored else ""
            if any(pattern.match(name) for pattern in MISNAMED):
                wrong.add(f"{module.at(node)} {name}")
    assert wrong == set()


@pytest.mark.parametrize(
    ("name", "accepted"),
    [
        ("C_b_e", True),
        ("q_b_i_hat", True),
        ("w_ib_b", True),
        ("r_i", True),
        ("f_x", True),
        ("C_b_k", False),
        ("r_k", False),
    ],
)
def test_the_check_of_names_knows_good_from_bad(name, accepted):
    assert accepted is not any(pattern.match(name) for pattern in MISNAMED)


def test_only_modules_that_hold_kernels_are_excused_from_annotations(modules, root):
    overrides = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["mypy"]["overrides"]
    patterns = [name for item in overrides if "disallow_untyped_defs" in item for name in item["module"]]
    assert patterns
    excused = [m for m in modules if any(fnmatch(m.name, pattern) for pattern in patterns)]
    assert [p for p in patterns if not any(fnmatch(m.name, p) for m in modules)] == []  # no excuse outlives its module
    outside = [m for m in excused if not m.name.startswith("lvnav_trade.kernels")]
    assert [
        m.at(one) for m in outside for one in m.functions() if not _is_annotated(one) and not _is_compiled(one)
    ] == []
    single = {m for m in outside if m.name in patterns}  # a pattern of a folder may match modules that need no excuse
    assert [str(m.path) for m in single if all(map(_is_annotated, m.functions()))] == []


def _is_annotated(function):
    arguments = [*function.args.args, *function.args.kwonlyargs]
    return function.returns is not None or all(one.annotation or one.arg in ("self", "cls") for one in arguments)


def _is_compiled(function):
    names = {ast.unparse(one).partition("(")[0] for one in function.decorator_list}
    return bool(names & {"jit", "inline_jit", "array_jit", "overload"})


def test_every_module_of_the_studies_has_its_test_file(root):
    modules = [path for path in (root / "lvnav_studies").glob("*.py") if not path.name.startswith("__")]
    assert modules
    assert [path.name for path in modules if not (root / "tests/studies" / f"test_{path.name}").exists()] == []
    scripts = [path for path in (root / "campaigns").glob("*/*.py") if path.name != "study.py"]
    assert scripts
    assert [path.name for path in scripts if not (root / "tests/published" / f"test_{path.name}").exists()] == []


def test_scripts_of_studies_use_the_public_functions_alone(root):
    scripts = sorted((root / "campaigns").glob("*/*.py"))
    used = {
        node.module
        for path in scripts
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("lvnav_trade")
    }
    assert used
    assert [name for name in sorted(used) if not name.startswith("lvnav_trade.api")] == []


def test_every_module_with_functions_has_its_test_file(modules, root):
    """test_NAME.py, or test_NAME_ASPECT.py where one file would be too long."""
    missing = set()
    for module in modules:
        if module.path.name.startswith("__") or not any(module.functions()):
            continue
        room = module.path.relative_to("lvnav_trade").parent
        folder, stem = root / "tests" / room, module.path.stem
        if not (folder / f"test_{stem}.py").exists() and not any(folder.glob(f"test_{stem}_*.py")):
            missing.add(str(module.path))
    assert sorted(missing) == sorted(UNTESTED)
