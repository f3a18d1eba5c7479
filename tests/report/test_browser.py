"""The page in a browser: every figure is drawn, nothing is loaded, it prints. Skipped where there is no Chromium."""

from __future__ import annotations

import base64
import html
import json
import re
import shutil
import subprocess

import numpy as np
import pandas as pd
import pytest

from lvnav_trade import api
from lvnav_trade.report import build
from lvnav_trade.report.blocks import Picture, Section, Table
from lvnav_trade.report.build import html_page
from lvnav_trade.report.figures.figure import canvas, events_of

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
    shown = browsed("--window-size=1280,3000", "--virtual-time-budget=8000", "--dump-dom", page=page)
    assert 'class="uplot' in shown


def test_a_brief_report_has_at_most_ten_sheets_of_paper(page, tmp_path):
    brief, paper = build(page.parent, brief=True), tmp_path / "brief.pdf"
    browsed("--virtual-time-budget=20000", f"--print-to-pdf={paper}", page=brief)
    pages = len(re.findall(rb"/Type\s*/Page[^s]", paper.read_bytes()))
    assert 1 < pages <= 10


# Run on the page before its own scripts: notes every stroke and fill in the clipped area of a panel as its pieces.
SPY = """<script>
const context = CanvasRenderingContext2D.prototype, notes = new Map();
function wrap(name, note) {
  const own = context[name];
  context[name] = function (...given) { note.call(this, ...given); return own.apply(this, given); };
}
const of = (canvas) => { if (!notes.has(canvas)) { notes.set(canvas, []); } return notes.get(canvas); };
wrap("clearRect", function () { notes.set(this.canvas, []); });
wrap("clip", function () { this.inside = true; });
wrap("restore", function () { this.inside = false; });
wrap("beginPath", function () { this.pieces = this.corners = 0; });
wrap("lineTo", function () { this.corners += 1; });
wrap("moveTo", function () { this.pieces += 1; });
wrap("stroke", function () { if (this.inside && this.pieces) { of(this.canvas).push(["stroke", this.pieces]); } });
wrap("fill", function () { if (this.inside && this.corners) { of(this.canvas).push(["fill", 1]); } });
addEventListener("load", () => {
  dispatchEvent(new Event("beforeprint"));
  setTimeout(() => {
    const said = Array.from(document.querySelectorAll(".figure"), (figure) => [
      figure.querySelector("script").textContent,
      Array.from(figure.querySelectorAll(".uplot canvas"), (canvas) => notes.get(canvas) || [])]);
    document.body.innerHTML = "<pre id=said></pre>";
    document.getElementById("said").textContent = JSON.stringify(said);
  }, 500);
});
</script>"""


def drawn_pieces(page, tmp_path):
    """Return for every figure of a page its data and, for each of its panels, what was stroked and filled."""
    probed = tmp_path / "spied.html"
    probed.write_text(re.sub(r"<meta http-equiv[^>]*>", lambda _: SPY, page), encoding="utf-8")
    shown = browsed("--virtual-time-budget=20000", "--dump-dom", page=probed)
    found = json.loads(html.unescape(re.search(r'<pre id="said">(.*?)</pre>', shown, re.DOTALL)[1]))
    return [(json.loads(data), panels) for data, panels in found]


def stretches(*values):
    """Return how many stretches of numbers without a missing one there are."""
    good = np.isfinite(np.stack(values)).all(axis=0)
    return int((good & ~np.append(False, good[:-1])).sum())


def asked_pieces(figure):
    """Return for each panel the pieces of its lines and bands that its data ask for, by kind and in their order."""
    arrays = [np.frombuffer(base64.b64decode(text), dtype="<f4") for text in figure["arrays"]]
    found = []
    for panel in figure["panels"]:
        marks = [{key: arrays[mark[key]] if key in DATA and key in mark else mark.get(key) for key in (*DATA, *LOOK)}
                 for mark in panel["marks"]]  # fmt: skip
        lines = [stretches(mark["x"], mark["y"]) for mark in marks if mark["kind"] == "line" and mark["ls"] is not None]
        bands = [stretches(mark["x"], mark["low"], mark["high"]) for mark in marks if mark["kind"] == "band"]
        if marks:
            crosses = sum(int((np.isfinite(mark["x"]) & np.isfinite(mark["y"])).sum()) for mark in marks
                          if mark["kind"] == "line" and mark["marker"] in tuple("xXP*"))  # fmt: skip
            found.append((sorted(count for count in lines if count), sum(bands), crosses))
    return found


DATA, LOOK = ("x", "y", "low", "high"), ("kind", "ls", "marker")


def check_gaps(page, tmp_path):
    """Compare the gaps of every line and band that is drawn with those of its data; return the number of gaps."""
    gaps, figures = 0, drawn_pieces(page, tmp_path)
    for figure, panels in figures:
        for (lines, bands, crosses), notes in zip(asked_pieces(figure), panels, strict=True):
            strokes = [pieces for kind, pieces in notes if kind == "stroke"]
            for count in set(lines):  # events and limits are strokes of one piece too
                assert count == 1 or strokes.count(count) >= lines.count(count), figure["panels"][0].get("ylabel")
            # a marker that is a cross is a stroke of two pieces
            assert sum(pieces - 1 for pieces in strokes if pieces > 1) == sum(count - 1 for count in lines) + crosses
            assert len([kind for kind, _ in notes if kind == "fill"]) >= bands
            gaps += sum(count - 1 for count in lines)
    return gaps


def test_a_line_ends_where_data_are_missing_on_every_scale(tmp_path):
    """On a logarithmic axis a missing value would have a place, and a line through it would fall off the panel."""
    blocks = []
    for scale in ("linear", "log", "root"):
        figure, grid = canvas(2, 1)
        t, y = np.arange(9.0), np.array([1.0, 2.0, 3.0, np.nan, 5.0, np.nan, np.nan, 8.0, 9.0])
        grid[0, 0].plot(t, y, label="line")
        grid[0, 0].fill_between(t, 0.5 * y, y)
        grid[1, 0].step(t, y[::-1], marker="o")
        for axes in grid[:, 0]:
            axes.set(yscale=scale)
        blocks.append(Picture(scale, figure, ""))
    page = html_page("gaps", "", [Section("summary", "Gaps", blocks)])
    assert check_gaps(page, tmp_path) == 3 * 4


def test_drawn_gaps_of_a_report_are_those_of_its_data(page, tmp_path):
    check_gaps(page.read_text(encoding="utf-8"), tmp_path)


def test_a_figure_states_units_scale_and_alternative_text(page):
    """Every figure has a text for those who do not see it, and a logarithmic axis names its scale."""
    text = page.read_text(encoding="utf-8")
    labels = re.findall(r'<div class="figure" role="group" aria-label="([^"]+)"', text)
    assert len(labels) == text.count('<div class="figure"')
    assert any("ordinate: velocity error, 3D RMS (m/s" in label and "abscissa: time since" in label for label in labels)
    for data in re.findall(r'<div class="figure".*?<script type="application/json">(.*?)</script>', text):
        for panel in json.loads(data)["panels"]:
            for side in ("x", "y"):
                if panel.get(f"{side}scale") == "log" and panel.get(f"{side}label"):
                    assert "log" in panel[f"{side}label"]


# Run on the page after its own scripts: what a reader does with the mouse, and what is seen then.
HAND = """<script>
addEventListener("load", () => setTimeout(async () => {
  const wait = () => new Promise((done) => setTimeout(done, 300));
  const figure = Array.from(document.querySelectorAll(".figure")).find((one) => one.textContent.includes("follow"));
  const over = figure.querySelector(".u-over"), box = over.getBoundingClientRect(), said = {};
  const mouse = (kind, x, where = over) => where.dispatchEvent(new MouseEvent(kind,
    { clientX: box.left + x * box.width, clientY: box.top + box.height / 2, movementX: 9, bubbles: true }));
  said.hint = figure.querySelector(".readout").textContent;
  mouse("mouseenter", 0.5); mouse("mousemove", 0.5); await wait();
  said.readout = figure.querySelector(".readout").textContent;
  said.coloured = figure.querySelectorAll(".readout span[style*=color]").length;
  const drawn = Array.from(document.querySelectorAll(".figure")).filter((one) => one.querySelector(".u-over"));
  const other = drawn.filter((one) => one !== figure);
  const pictures = () => other.map((one) => one.querySelector("canvas").toDataURL());
  const before = pictures();
  mouse("mousedown", 0.3); mouse("mousemove", 0.6); mouse("mouseup", 0.6, document); await wait();
  said.followed = pictures().filter((picture, k) => picture !== before[k]).length;
  mouse("dblclick", 0.5); await wait();
  mouse("mousemove", 0.5); await wait();
  said.reset = figure.querySelector(".readout").textContent;
  const entry = figure.querySelector(".legend button"), own = figure.querySelector("canvas").toDataURL();
  entry.click(); await wait();
  said.hidden = [entry.getAttribute("aria-pressed"), figure.querySelector("canvas").toDataURL() !== own];
  const nav = document.querySelector("nav");
  said.nav = nav.scrollWidth - nav.clientWidth;
  said.captions = Array.from(document.querySelectorAll(".caption"), (one) => one.getBoundingClientRect().right)
    .filter((right) => right > innerWidth).length;
  document.body.innerHTML = "<pre id=said></pre>";
  document.getElementById("said").textContent = JSON.stringify(said);
}, 500));
</script>"""


def test_zoom_links_all_figures_over_time_and_the_read_out_has_units(page, tmp_path):
    probed = tmp_path / "hand.html"
    probed.write_text(re.sub(r"<meta http-equiv[^>]*>", lambda _: HAND, page.read_text(encoding="utf-8")), "utf-8")
    found = None
    for _ in range(3):  # on a busy machine the browser's time may run out before the script is done
        shown = browsed("--window-size=1280,9000", "--virtual-time-budget=20000", "--dump-dom", page=probed)
        found = found or re.search(r'<pre id="said">(.*?)</pre>', shown, re.DOTALL)
        if found:
            break
    said = json.loads(html.unescape(found[1]))
    assert said["hint"].startswith("drag to zoom")
    assert re.match(r"t = [\d.]+ s · imu=fine: [\d.]+ (mrad|m/s|m) · imu", said["readout"])
    assert said["coloured"] >= 2
    assert said["followed"] >= 3
    assert said["reset"] == said["readout"]
    assert said["hidden"] == ["false", True]
    assert (said["nav"], said["captions"]) == (0, 0)  # nothing of the navigation or a caption is cut off


# Run on the page before its own scripts: notes every text on a canvas with its font's size and its corners, CSS pixels.
TEXTS = """<style>body { width: WIDTHpx !important; margin: 0 !important; }</style><script>
const seen = [];
window.IntersectionObserver = class {
  constructor(draw) { this.draw = draw; }
  observe(target) { seen.push([this.draw, target]); }
};
const context = CanvasRenderingContext2D.prototype, notes = new Map();
const write = context.fillText, clear = context.clearRect;
context.clearRect = function (...given) { notes.set(this.canvas, []); return clear.apply(this, given); };
context.fillText = function (text, x, y, ...rest) {
  const size = this.measureText(text), turn = this.getTransform(), corners = [];
  const across = [x - size.actualBoundingBoxLeft, x + size.actualBoundingBoxRight];
  const along = [y - size.actualBoundingBoxAscent, y + size.actualBoundingBoxDescent];
  across.forEach((a) => along.forEach((b) => {
    const at = turn.transformPoint({ x: a, y: b });
    corners.push([at.x / devicePixelRatio, at.y / devicePixelRatio]);
  }));
  const upright = Math.abs(turn.b) < 1e-9, font = parseFloat(this.font.match(/([0-9.]+)px/)[1]) / devicePixelRatio;
  if (!notes.has(this.canvas)) { notes.set(this.canvas, []); }
  if (String(text).trim()) { notes.get(this.canvas).push([text, font, corners, upright]); }
  return write.call(this, text, x, y, ...rest);
};
addEventListener("load", () => {
  document.querySelectorAll("details").forEach((one) => { one.open = true; });
  seen.forEach(([draw, target]) => draw([{ isIntersecting: true, target }]));
  setTimeout(() => {
    const said = Array.from(document.querySelectorAll(".figure"), (figure) => [
      figure.getAttribute("aria-label"), figure.clientWidth,
      Array.from(figure.querySelectorAll(".uplot canvas"), (canvas) => [
        canvas.width / devicePixelRatio, canvas.height / devicePixelRatio, notes.get(canvas) || []])]);
    document.body.innerHTML = "<pre id=said></pre>";
    document.getElementById("said").textContent = JSON.stringify(said);
  }, 500);
});
</script>"""
LEAST_FONT = 9.0  # CSS pixels


def texts_of(page, tmp_path, width):
    """Return for every figure of a page so many pixels wide its name and width, and for each of its panels the size of
    its canvas and the texts on it: text, font, corners, and whether it is upright.
    """
    probed, script = tmp_path / "texts.html", TEXTS.replace("WIDTH", str(width))
    probed.write_text(re.sub(r"<meta http-equiv[^>]*>", lambda _: script, page), encoding="utf-8")
    size = f"--window-size={max(width, 500)},900"
    shown = browsed(size, "--virtual-time-budget=20000", "--dump-dom", page=probed)
    return json.loads(html.unescape(re.search(r'<pre id="said">(.*?)</pre>', shown, re.DOTALL)[1]))


def unreadable(page, tmp_path):
    """Return what is wrong with the labels in the figures of a page that is 400 pixels wide, and how many there are:
    too small, cut off at an edge, one over another, or two names that were cut to the same text.
    """
    found, count = [], 0
    for name, across, canvases in texts_of(page, tmp_path, 400):
        assert 0 < across <= 400
        assert canvases, name
        for width, height, texts in canvases:
            boxes = [(text, np.min(corners, axis=0), np.max(corners, axis=0)) for text, _, corners, _ in texts]
            count += len(boxes)
            found += [f"{name[:60]}: {text!r} has {font:g} px" for text, font, *_ in texts if font < LEAST_FONT]
            found += [f"{name[:60]}: {text!r} is cut off" for text, low, high in boxes
                      if low.min() < -1.0 or high[0] > width + 1.0 or high[1] > height + 1.0]  # fmt: skip
            upright = [box for box, text in zip(boxes, texts, strict=True) if text[3]]
            for k, (text, low, high) in enumerate(upright):
                for other, below, above in upright[k + 1 :]:
                    if bool((low + 1.0 < above).all() and (below + 1.0 < high).all()):
                        found.append(f"{name[:60]}: {text!r} and {other!r} overlap")
                    elif "…" in text and text == other:
                        found.append(f"{name[:60]}: two names are {text!r}")
    return found, count


def test_labels_are_readable_on_a_page_of_400_pixels(page, tmp_path):
    found, count = unreadable(page.read_text(encoding="utf-8"), tmp_path)
    assert count > 100
    assert found == []


def test_events_are_named_at_their_lines_where_there_is_room_and_numbered_elsewhere(tmp_path):
    """Three close events: names in three rows, the last one lowest; twelve of them have numbers and a key."""
    pages = []
    for count in (3, 12):
        times = {f"event_{k}": 10.0 + 0.5 * k for k in range(count)}
        rows = pd.DataFrame({"event": list(times), "kind": "event", "t_s": times.values(), "t_end_s": times.values()})
        figure, ((axes,),) = canvas(1, 1)
        axes.plot(np.arange(100.0), np.arange(100.0))
        axes.set(xlabel="time since lift-off (s)", ylabel="error (m)")
        axes.events = events_of(rows)
        pages.append(html_page("events", "", [Section("summary", "Events", [Picture("events", figure, "")])]))
    named, numbered = (texts_of(page, tmp_path, 1000) for page in pages)
    ((_, _, ((_, _, texts),)),) = named
    found = {text: np.array(corners) for text, _, corners, _ in texts if text.startswith("event")}
    assert list(found) == ["event 2", "event 1", "event 0"]
    lows = [corners[:, 1].max() for corners in found.values()]
    assert lows == sorted(lows, reverse=True)
    assert len(set(lows)) == 3
    ((_, _, ((_, _, texts),)),) = numbered
    assert not [text for text, *_ in texts if text.startswith("event")]
    assert {"1-6", "7-12"} <= {text for text, *_ in texts}


def printed(page, paper):
    """Print a page to a file and return the text of each sheet; skipped without pdftotext."""
    if shutil.which("pdftotext") is None:
        pytest.skip("no pdftotext on this machine (poppler-utils)")
    browsed("--virtual-time-budget=20000", "--no-pdf-header-footer", f"--print-to-pdf={paper}", page=page)
    text = subprocess.run(["pdftotext", "-layout", str(paper), "-"], capture_output=True, text=True, check=True).stdout
    return text.split("\f")[:-1]


def check_sheets(page, paper):
    """Check page numbers, and that no heading is the last line of a sheet; return how many sheets there are."""
    sheets = printed(page, paper)
    headings = set(re.findall(r"<h2>(.*?)</h2>", page.read_text(encoding="utf-8")))
    found = set()
    for number, sheet in enumerate(sheets, 1):
        lines = [line.strip() for line in sheet.splitlines() if line.strip()]
        assert lines[-1].replace(" ", "") == f"{number}/{len(sheets)}"
        assert lines[-2] not in headings, f"sheet {number} ends with a heading"
        found |= headings & set(lines)
    assert found == headings
    return len(sheets)


def test_sheets_of_paper_are_numbered_and_none_ends_with_a_heading(page, tmp_path):
    assert check_sheets(page, tmp_path / "report.pdf") <= 14


def test_the_head_of_a_table_is_repeated_on_its_next_sheet(tmp_path):
    rows = tuple((f"row {k}", str(k)) for k in range(300))
    table = Table(("name of the row", "size"), rows, (False, True), "long")
    page = tmp_path / "table.html"
    page.write_text(html_page("long", "", [Section("summary", "Long", [table])]), encoding="utf-8")
    sheets = printed(page, tmp_path / "table.pdf")
    assert len(sheets) > 1
    assert all(sheet.count("name of the row") == 1 for sheet in sheets)


@pytest.mark.slow
def test_the_report_of_the_demo_has_its_gaps_and_at_most_25_sheets(tmp_path):
    """The campaign of the demo with few runs: as many figures and tables as with all of them."""
    few = ("monte_carlo.runs=8", "monte_carlo.other_runs=8")
    folder = api.run("demo", few, tmp_path / "demo", jobs=1).folder
    page = folder / "report.html"
    assert check_sheets(page, tmp_path / "demo.pdf") <= 25
    assert check_gaps(page.read_text(encoding="utf-8"), tmp_path) > 0
    assert unreadable(page.read_text(encoding="utf-8"), tmp_path)[0] == []
