"""Names and texts of the user as plain text in Markdown, CSV, XML and scripts: nothing of them is taken as code."""

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

from lvnav_trade.quantities.errors import visible

_INLINE = (
    (re.compile(r"\\"), r"\\\\"),
    (re.compile(r"([`*])"), r"\\\1"),
    (re.compile(r"(?<![^\W_])_|_(?![^\W_])"), r"\\_"),  # within a word it is no emphasis
    (re.compile(r"~(?=~)|(?<=~)~"), r"\\~"),
    (re.compile(r"&(?=#?\w+;)"), "&amp;"),
    (re.compile(r"<(?=[A-Za-z/!?])"), "&lt;"),
)
_LINKS = (re.compile(r"(\])(?=[(\[:])"), r"\\\1")  # a link, or what a link refers to
_BRACKETS = (re.compile(r"([\[\]])"), r"\\\1")
_LINE_START = re.compile(r"^[ \t]+|[ \t]+$", re.MULTILINE)
_STRUCTURE = re.compile(r"^(?=#{1,6}(?:\s|$)|>|[-=:|][-=:| ]*$|\|)", re.MULTILINE)
_FORMULA = tuple("=+-@＝＋－＠")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|-")
_BREAKS = re.compile(r"[\r\n\t\0]+")
_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


# In JSON these are escape sequences already, which a page would undo
_HIDDEN_JSON = re.compile(r"(?<!\\)((?:\\\\)*)\\(u(?:00[01][0-9a-f]|007f|00[89][0-9a-f]|202[a-e]|206[6-9]))")


def markdown(text: object) -> str:
    """Return a text of one or more paragraphs that Markdown shows as it is; its lists stay lists."""
    return _STRUCTURE.sub(r"\\", _LINE_START.sub("", _inline(text)))


def markdown_line(text: object) -> str:
    """Return a text as one line, for a heading or an emphasis."""
    return markdown(" ".join(str(text).split()))


def markdown_cell(text: object) -> str:
    """Return a text for a cell of a table."""
    return _inline(" ".join(str(text).split())).replace("|", "\\|")


def markdown_alt(text: object) -> str:
    """Return a text for the description of a picture."""
    return _inline(" ".join(str(text).split()), _BRACKETS)


def _inline(text: object, links: tuple[re.Pattern[str], str] = _LINKS) -> str:
    found = str(text)
    for pattern, by in (*_INLINE, links):
        found = pattern.sub(by, found)
    return found


def markdown_fence(text: object) -> str:
    """Return the fence of a block of code: longer than any in the text."""
    return "".ljust(max(3, 1 + max(map(len, re.findall("`+", str(text))), default=0)), "`")


MARKDOWN = {"md": markdown, "line": markdown_line, "cell": markdown_cell, "alt": markdown_alt, "fence": markdown_fence}
"""Filters of the templates of Markdown pages."""


def source(name: str) -> str:
    """Return a template, or what stands in one."""
    return (resources.files("lvnav_trade.report") / "templates" / name).read_text(encoding="utf-8")


@cache
def texts() -> dict[str, dict[str, Any]]:
    """Return what `templates/texts.toml` holds."""
    return tomllib.loads(source("texts.toml"))


def note(name: str, group: str = "notes", **content: Any) -> str:
    """Return what a report says of something (`templates/texts.toml`), its braces filled with content."""
    return " ".join(texts()[group][name].split()).format(**content)


def render(template: str, **content: Any) -> str:
    """Return a page: its template filled with content; a Markdown page has single blank lines."""
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(source),
        autoescape=lambda name: bool(name and name.endswith(".html.j2")),
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
        finalize=_shown,
    )
    environment.filters |= {
        **MARKDOWN,
        "xml": lambda text: escape(xml_text(text)),
        "base64": lambda content: base64.b64encode(content).decode(),
    }
    text = environment.get_template(template).render(content)
    return re.sub(r"\n{3,}", "\n\n", text).strip() + "\n" if template.endswith(".md.j2") else text


def _shown(value: Any) -> Any:
    """Return a value as a template writes it: hidden characters of a text as their escape sequences."""
    return visible(value) if type(value) is str else value


def data_json(data: Any) -> str:
    """Return data as JSON that may stand in a script element of a page."""
    return _HIDDEN_JSON.sub(r"\1\\\\\2", str(htmlsafe_json_dumps(data)))


def xml_text(text: object) -> str:
    """Return a text without the characters that XML cannot hold."""
    return visible(_NOT_XML.sub("�", str(text)))


def csv_text(frame: pd.DataFrame) -> str:
    """Return a frame as CSV with six digits; an apostrophe precedes text that a spreadsheet would take as a formula."""
    safe = frame.rename(columns=_csv_cell)
    for place, kind in enumerate(safe.dtypes):
        if isinstance(kind, pd.StringDtype):  # a name stands in many rows
            names = safe.iloc[:, place]
            safe.isetitem(place, names.map({name: _csv_cell(name) for name in names.unique()}))
        elif not pd.api.types.is_numeric_dtype(kind):
            safe.isetitem(place, [_csv_cell(value) for value in safe.iloc[:, place]])
    return str(safe.to_csv(index=False, float_format="%.6g"))


def _csv_cell(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    text = visible(_BREAKS.sub(" ", value))
    return "'" + text if text.lstrip().startswith(_FORMULA) and not _NUMBER.fullmatch(text) else text
