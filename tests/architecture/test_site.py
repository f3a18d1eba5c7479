"""The manual as a site: it builds without a network, its formulas and pages fit, its search works from a folder."""

from __future__ import annotations

import html
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
in_a_browser = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
REPORTS = ("demo", "error_budget")  # of some forty: a report takes a second

# Loads every page into a frame of a given width and notes those that are wider than it, or whose text has something
# that reaches beyond it without a box that scrolls. Headings reach half an em beyond the text.
WIDE = """<script>
const pages = PAGES, wide = [], frame = document.createElement("iframe");
frame.style.cssText = "border: 0; height: 900px; width: WIDTHpx";
function next(k) {
  if (k === pages.length) { document.title = JSON.stringify(wide); return; }
  frame.onload = () => {
    const root = frame.contentDocument.documentElement, article = frame.contentDocument.querySelector("article");
    if (root.scrollWidth > WIDTH + 1) wide.push([pages[k], root.scrollWidth]);
    const limit = article ? article.getBoundingClientRect().right + 12 : WIDTH;
    const box = (e) => ["auto", "scroll"].includes(getComputedStyle(e).overflowX);
    const scrolls = (e) => e !== article && (box(e) || scrolls(e.parentElement));
    const out = article ? Array.from(article.querySelectorAll("*")).find(
      (e) => e.getBoundingClientRect().right > limit && !scrolls(e)) : null;
    if (out) wide.push([pages[k], out.outerHTML.slice(0, 80)]);
    next(k + 1);
  };
  frame.src = pages[k];
}
addEventListener("load", () => { document.body.append(frame); next(0); });
</script><body></body>"""


@pytest.fixture(scope="module")
def site(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the manual, built where no network answers."""
    place = tmp_path_factory.mktemp("manual") / "site"
    nowhere = {"http_proxy": "http://127.0.0.1:9", "https_proxy": "http://127.0.0.1:9"}
    command = [sys.executable, str(root / "docs/generate.py"), str(place), *REPORTS]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, env=os.environ | nowhere, check=False)
    assert done.returncode == 0, done.stdout[-800:] + done.stderr[-800:]
    return place


def dumped(address: str, *arguments: str) -> str:
    """Return a page as a browser has it after its scripts."""
    command = [str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--proxy-server=127.0.0.1:9", *arguments]
    command += ["--dump-dom", address]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=True).stdout


def test_it_has_formulas_reference_and_reports_and_asks_for_nothing_from_a_network(site: Path) -> None:
    theory = (site / "theory.html").read_text()
    assert theory.count("<math") > 100
    assert theory.count('class="equation"') == len(re.findall(r'id="eq-\d+"', theory)) > 15
    for page in site.rglob("*.html"):
        asked = re.findall(r'(?:<(?:script|img)[^>]*src|<link[^>]*href)="(https?:)?//[^"]+"', page.read_text())
        assert asked == [], page.name
    fields = (site / "reference/fields.html").read_text()
    for word in ("imu.gyro", "receiver.clock", "bias_repeatability"):
        assert word in fields
    assert "lvnav_trade.api.run" in (site / "reference/python.html").read_text()
    assert "reports/demo/report.html" in (site / "index.html").read_text()


def test_no_formula_shows_its_markup(site: Path) -> None:
    pages = {str(page.relative_to(site)): page.read_text() for page in site.rglob("*.html")}
    raw = {name: re.findall(r"<m(?:i|o|n|text)>[^<]*(?:\\|&amp;)|\$\$", text) for name, text in pages.items()}
    assert {name: found for name, found in raw.items() if found} == {}
    assert [name for name, text in pages.items() if "\\begin{align" in text] == []


def test_every_figure_of_the_gallery_is_there(site: Path) -> None:
    page = (site / "gallery.html").read_text()
    shown = re.findall(r'<a href="([^"]+)"><img src="([^"]+)" alt="([^"]+)"', page)
    assert len(shown) > 3
    assert [link for link, figure, _ in shown if not ((site / link).is_file() and (site / figure).is_file())] == []


@in_a_browser
@pytest.mark.parametrize(
    ("words", "page"),
    [
        ("error budget", "theory.html"),
        ("NEES", "glossary.html"),
        ("jamming", "faults.html"),
        ("exit code", "how_to.html"),
    ],
)
def test_a_search_finds_pages_without_a_server(site: Path, words: str, page: str) -> None:
    address = f"{(site / 'search.html').as_uri()}?q={words.replace(' ', '+')}"
    shown = dumped(address, "--virtual-time-budget=8000")
    found = re.findall(r'<li class="kind-[^"]*"><a href="([^"?#]+)', shown)
    assert page in found[:12]


@in_a_browser
@pytest.mark.parametrize("width", [1280, 400])
def test_no_page_is_wider_than_the_window(site: Path, width: int) -> None:
    pages = sorted(str(page.relative_to(site)) for page in site.rglob("*.html"))
    harness = site / f"wide-{width}.html"
    harness.write_text(WIDE.replace("PAGES", json.dumps(pages)).replace("WIDTH", str(width)))
    shown = dumped(harness.as_uri(), "--allow-file-access-from-files", "--virtual-time-budget=200000")
    harness.unlink()
    found = re.search(r"<title>(.*?)</title>", shown)
    assert found, "the pages were not all loaded"
    assert json.loads(html.unescape(found[1])) == []
