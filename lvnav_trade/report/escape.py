"""Escaping of the user's names and texts for Markdown, CSV, XML and scripts, so that none of them is read as code."""

import base64
import re
import tomllib
from functools import cache
from importlib import resources
from typing import Any
from xml.sax.saxutils import escape

import jinja2
import pandas as pd
from jinja2.utils import htmlsafe_json_dumps

from lvnav_trade.quantities.errors import visible_text

_INLINE = (
    (re.compile(r"\\"), r"\\\\"),
    (re.compile(r"([`*])"), r"\\\1"),
    (re.compile(r"(?<![^\W_])_|_(?![^\W_])"), r"\\_"),  # within a word it is no emphasis
    (re.compile(r"~(?=~)|(?<=~)~"), r"\\~"),
    (re.compile(r"&(?=#?\w+;)"), "&amp;"),
    (re.compile(r"<(?=[A-Za-z/!?])"), "&lt;"),
)
_LINKS = (re.compile(r"(\])(?=[(\[:])"), r"\\\1")  # a link, or the target of a reference link
_BRACKETS = (re.compile(r"([\[\]])"), r"\\\1")
_LINE_START = re.compile(r"^[ \t]+|[ \t]+$", re.MULTILINE)
_STRUCTURE = re.compile(r"^(?=#{1,6}(?:\s|$)|>|[-=:|][-=:| ]*$|\|)", re.MULTILINE)
_FORMULA = tuple("=+-@＝＋－＠")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|-")
_BREAKS = re.compile(r"[\r\n\t\0]+")
_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


# In JSON these are escape sequences already, which an HTML document would undo
_HIDDEN_JSON = re.compile(r"(?<!\\)((?:\\\\)*)\\(u(?:00[01][0-9a-f]|007f|00[89][0-9a-f]|202[a-e]|206[6-9]))")


def markdown(text: object) -> str:
    """Return a text of one or more paragraphs, escaped for Markdown; lists remain lists."""
    return _STRUCTURE.sub(r"\\", _LINE_START.sub("", _inline(text)))


def markdown_line(text: object) -> str:
    """Return a text escaped as one line of Markdown, for a heading or an emphasis."""
    return markdown(" ".join(str(text).split()))


def markdown_cell(text: object) -> str:
    """Return a text escaped for a cell of a Markdown table."""
    return _inline(" ".join(str(text).split())).replace("|", "\\|")


def markdown_alt(text: object) -> str:
    """Return a text escaped for the description of a picture in Markdown."""
    return _inline(" ".join(str(text).split()), _BRACKETS)


def _inline(text: object, links: tuple[re.Pattern[str], str] = _LINKS) -> str:
    escaped_text = str(text)
    for pattern, replacement in (*_INLINE, links):
        escaped_text = pattern.sub(replacement, escaped_text)
    return escaped_text


def markdown_fence(text: object) -> str:
    """Return the fence of a Markdown code block, longer than any run of backticks in the text."""
    longest = max(map(len, re.findall("`+", str(text))), default=0)
    return "`" * max(3, longest + 1)


MARKDOWN = {"md": markdown, "line": markdown_line, "cell": markdown_cell, "alt": markdown_alt, "fence": markdown_fence}
"""Filters of the templates of Markdown pages."""


def source(name: str) -> str:
    """Return the content of a file in `report/templates`."""
    return (resources.files("lvnav_trade.report") / "templates" / name).read_text(encoding="utf-8")


@cache
def texts() -> dict[str, dict[str, Any]]:
    """Return the content of `templates/texts.toml`."""
    return tomllib.loads(source("texts.toml"))


def note(name: str, group: str = "notes", **content: Any) -> str:
    """Return a text of the report by its name.

    Parameters
    ----------
    name, group : str
        Key and table in `templates/texts.toml`.
    **content
        Values for the braces in the text.
    """
    return " ".join(texts()[group][name].split()).format(**content)


def render(template: str, **content: Any) -> str:
    """Return a document from its template.

    HTML templates (``.html.j2``) escape all values. In Markdown documents (``.md.j2``) repeated blank lines are merged.

    Parameters
    ----------
    template : str
        File name in `report/templates`.
    **content
        Variables of the template.
    """
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(source),
        autoescape=lambda name: bool(name and name.endswith(".html.j2")),
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
        finalize=_template_value,
    )
    environment.filters |= {
        **MARKDOWN,
        "xml": lambda text: escape(xml_text(text)),
        "base64": lambda content: base64.b64encode(content).decode(),
    }
    text = environment.get_template(template).render(content)
    if template.endswith(".md.j2"):
        return re.sub(r"\n{3,}", "\n\n", text).strip() + "\n"
    return text


def _template_value(value: Any) -> Any:
    """Return a value as a template prints it; hidden characters of a text become escape sequences."""
    return visible_text(value) if type(value) is str else value


def data_json(data: Any) -> str:
    """Return data as JSON that is safe within a script element of an HTML document."""
    return _HIDDEN_JSON.sub(r"\1\\\\\2", str(htmlsafe_json_dumps(data)))


def xml_text(text: object) -> str:
    """Return a text in which characters that XML does not allow are replaced or made visible."""
    return visible_text(_NOT_XML.sub("�", str(text)))


def csv_text(frame: pd.DataFrame) -> str:
    """Return a frame as CSV with six digits.

    Texts that a spreadsheet would evaluate as a formula are prefixed with an apostrophe.
    """
    safe = frame.rename(columns=_csv_cell)
    for place, dtype in enumerate(safe.dtypes):
        column = safe.iloc[:, place]
        if isinstance(dtype, pd.StringDtype):  # names repeat: escape each only once
            escaped_names = {name: _csv_cell(name) for name in column.unique()}
            safe.isetitem(place, column.map(escaped_names))
        elif not pd.api.types.is_numeric_dtype(dtype):
            cells = [_csv_cell(value) for value in column]
            safe.isetitem(place, cells)
    return str(safe.to_csv(index=False, float_format="%.6g"))


def _csv_cell(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    text = visible_text(_BREAKS.sub(" ", value))
    is_formula = text.lstrip().startswith(_FORMULA) and not _NUMBER.fullmatch(text)
    return f"'{text}" if is_formula else text
