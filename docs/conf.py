"""Settings of Sphinx for the manual; `generate.py` gathers the pages."""

import re
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert

project = "lvnav-trade"
author = "The lvnav-trade authors"
extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
suppress_warnings = ["myst.header"]  # a report may begin with a heading of any level
default_role = "code"
autodoc_typehints = "none"  # numpydoc states them
numpydoc_show_class_members = False
html_theme = "furo"
html_title = "lvnav-trade"
html_static_path = ["styles"]
html_css_files = ["manual.css"]
html_math_renderer = "mathml"
html_search_scorer = str(Path(__file__).parent / "styles/scorer.js")
html_copy_source = False
html_show_sphinx = False
html_theme_options = {"navigation_with_keys": True}
exclude_patterns: list[str] = []


_NUMBER = re.compile(r"\\tag\{(\d+)\}")


def _inline(self: Any, node: Any) -> None:
    self.body.append(convert(node.astext()))


def _display(self: Any, node: Any) -> None:
    text = node.astext().strip()
    number = _NUMBER.search(text)
    formula = convert(_NUMBER.sub("", text).strip(), display="block")
    label = f'<span id="eq-{number[1]}">({number[1]})</span>' if number else ""
    self.body.append(f'<div class="equation">{formula}{label}</div>')


def _skip(self: Any, node: Any) -> None:
    from docutils.nodes import SkipNode

    raise SkipNode


def _visit(write: Any) -> Any:
    def visit(self: Any, node: Any) -> None:
        write(self, node)
        _skip(self, node)

    return visit


def setup(app: Any) -> None:
    """Register formulas as MathML, which browsers draw without a script."""
    app.add_html_math_renderer("mathml", (_visit(_inline), None), (_visit(_display), None))
