"""The page in a browser: every figure is drawn, nothing is loaded, it prints. Skipped where there is no Chromium."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess

import pytest

from lvnav_trade.report import build

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")

# Run on the page before its own scripts: opens what is closed, draws all as print does, and counts.
PROBE = """<script>
const said = [];
addEventListener("error", (event) => said.push(event.message));
console.error = (text) => said.push(String(text));
addEventListener("load", () => {
  dispatchEvent(new Event("beforeprint"));
  setTimeout(() => {
    const figures = Array.from(document.querySelectorAll(".figure"));
    const panel = (canvas) => {
      const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
      return data.some((value) => value > 0);
    };
    const canvases = (figure) => Array.from(figure.querySelectorAll(".uplot canvas"));
    const drawn = figures.filter((figure) => canvases(figure).length && canvases(figure).every(panel));
    const loaded = performance.getEntriesByType("resource");
    document.title = JSON.stringify([figures.length, drawn.length, said, loaded.length]);
  }, 500);
});
</script>"""


def browsed(*arguments, page):
    command = [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--proxy-server=127.0.0.1:9", *arguments]
    return subprocess.run([*command, page.as_uri()], capture_output=True, text=True, timeout=300, check=True).stdout


@pytest.mark.parametrize("size", ["1280,900", "500,900"])
def test_every_figure_is_drawn_without_an_error_and_nothing_is_loaded(page, tmp_path, size):
    text = page.read_text(encoding="utf-8")
    probed = tmp_path / "page.html"
    probed.write_text(re.sub(r"<meta http-equiv[^>]*>", PROBE, text), encoding="utf-8")
    shown = browsed(f"--window-size={size}", "--virtual-time-budget=20000", "--dump-dom", page=probed)
    count, drawn, said, loaded = json.loads(html.unescape(re.search(r"<title>(.*?)</title>", shown)[1]))
    assert count == text.count('<div class="figure"') > 10
    assert (drawn, said, loaded) == (count, [], 0)


def test_the_security_policy_allows_the_scripts_of_the_page(page):
    shown = browsed("--virtual-time-budget=8000", "--dump-dom", page=page)
    assert 'class="uplot' in shown


def test_a_brief_report_has_at_most_ten_sheets_of_paper(page, tmp_path):
    brief, paper = build(page.parent, brief=True), tmp_path / "brief.pdf"
    browsed("--virtual-time-budget=20000", f"--print-to-pdf={paper}", page=brief)
    pages = len(re.findall(rb"/Type\s*/Page[^s]", paper.read_bytes()))
    assert 1 < pages <= 10
