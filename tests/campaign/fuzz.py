# ruff: noqa: RUF005 - pools of texts
"""Mutants of a campaign, its cards and a file of data, and what must hold of each: refused in short lines, or meant."""

from __future__ import annotations

import math
import re
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.quantities.data_file import read_columns
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.trajectory.files.row_checks import usable_rows

CAMPAIGN = """\
  faults:
    - {kind: satellite_outage, start: "stage1_cutoff + 20 s", duration: "30 s", keep: 2}
    - {kind: wild_samples, start: "100 s", duration: "5 s", sigma: "50 m", satellites: [A1]}
axes:
  - {path: imu, cards: [imu/good, imu/poor]}
  - {path: initial.tilt, values: ["0.1 deg", "0.2 deg"]}
  - {path: filter.gate, values: [4, 5.5]}
design: grid
monte_carlo: {runs: 40, block: 40}
keep: {history: "1 s"}
requirements:
  - {name: speed, metric: velocity_error_3d, at: injection, probability: 0.95, below: "0.3 m/s"}
references:
  - {source: x, case: {imu: good}, metric: velocity_error_3d, value: 1.5, unit: m/s, band: [0.5, 2]}
"""

# Where a quantity stands: file, its text, path in the loaded campaign, factors of units that fit.
_ANGLE = {"deg": math.pi / 180.0, "rad": 1.0, "mrad": 1e-3, "arcsec": math.pi / 648_000.0, "°": math.pi / 180.0}
_LENGTH = {"m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3}
_SPEED = {"m/s": 1.0, "km/s": 1e3, "cm/s": 1e-2, "mm/s": 1e-3}
_TIME = {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0}
_RATE = {"deg/h": math.pi / 648_000.0, "deg/s": math.pi / 180.0, "rad/s": 1.0}
QUANTITIES = (
    ("campaign.yaml", '"0.05 deg"', "base.initial.heading", _ANGLE),
    ("campaign.yaml", '"1 m"', "base.initial.position", _LENGTH),
    ("campaign.yaml", '"0.01 m/s"', "base.initial.velocity", _SPEED),
    ("campaign.yaml", '"30 s"', "base.faults.0.duration", _TIME),
    ("campaign.yaml", '"50 m"', "base.faults.1.sigma", _LENGTH),
    ("campaign.yaml", '"0.3 m/s"', "requirements.0.below", _SPEED),
    ("campaign.yaml", '"1 s"', "keep.history", _TIME),
    ("configs/receivers/plain.yaml", '"2 m"', "base.receiver.pseudorange_sigma", _LENGTH),
    ("configs/receivers/plain.yaml", '"3 m"', "base.receiver.solution.position_sigma", _LENGTH),
    ("configs/imu/good.yaml", '"1 deg/h"', "base.imu.gyro.bias_repeatability", _RATE),
)  # fmt: skip
UNITS = sorted(
    {unit for _, _, _, units in QUANTITIES for unit in units} | {"kg", "Hz", "ppm", "furlong", "dB", "g", ""}
)
STRICT = re.compile(r"([+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?) (\S+)", re.ASCII)

_NUMBERS = st.one_of(
    st.floats(allow_nan=True).map(repr),
    st.integers(-(10**20), 10**20).map(str),
    st.sampled_from(
        [
            "1 000",
            "10 000",
            "1,5",
            "1.000,5",
            "1_000",
            "1 5",
            "１",
            "٣",
            "1e999",
            "9e99",
            ".5",
            "5.",
            "+1",
            "--1",
            "0x1F",
            "1e5",
        ]
        + ["", "inf", "nan", "1'000", "1/2", "1e", "0.1 deg +", "9" * 400, "1\u00a0", "-0"]
    ),
)
_SPACES = st.sampled_from([" ", " ", " ", "", "  ", "\t", "\u2009", " * ", " + 1 "])
_TAILS = st.sampled_from(["", "", "", "", " ", "**2", "^1e9", "**9**9**9", " m", "/", "(", "#"])
WORDS = st.one_of(
    st.sampled_from(
        ["true", "null", ".nan", ".inf", "-1", "0", "1e400", "1000000000000000000", "[]", "{}", "[1, 2]", "{a: {b: c}}"]
        + [
            "imu/good",
            "imu/poor",
            "grid",
            "zip",
            "one_at_a_time",
            "base",
            "good",
            "start",
            "end",
            "matched",
            "{kind: x}",
        ]
        + [
            "''",
            '"\\e[2J"',
            '"\\0"',
            "*x",
            "&x 1",
            "!!python/name:os.system x",
            "!!bool 1",
            "2026-08-01",
            "faults.0",
            "initial",
        ]
        + [
            "i" * 300,
            "[" * 60,
            "/dev/zero",
            "..",
            "velocity_error_q",
            "kg",
            "m/s",
            "5 m",
            "0.1 deg",
            "{card: imu/good}",
        ]
    ),
    st.text(max_size=12),
)


@st.composite
def quantities(draw: Any) -> str:
    """Draw a text that is a quantity, or nearly."""
    return f"{draw(_NUMBERS)}{draw(_SPACES)}{draw(st.sampled_from(UNITS))}{draw(_TAILS)}"


@st.composite
def rewritten(draw: Any, text: str) -> str:
    """Draw the text with one to three of its words, lines or characters replaced, removed, repeated or exchanged."""
    for _ in range(draw(st.integers(1, 3))):
        kind = draw(st.sampled_from(["word", "word", "word", "line", "repeat", "swap", "character", "cut"]))
        lines = text.split("\n")
        at = draw(st.integers(0, len(lines) - 1))
        if kind == "word":
            found = list(re.finditer(r'"[^"]*"|[^\s,:{}\[\]]+', text))
            if found:
                word = found[draw(st.integers(0, len(found) - 1))]
                text = text[: word.start()] + draw(WORDS) + text[word.end() :]
        elif kind == "line":
            text = "\n".join(lines[:at] + lines[at + 1 :])
        elif kind == "repeat":
            text = "\n".join([*lines[: at + 1], *lines[at : at + 1] * draw(st.integers(1, 3)), *lines[at + 1 :]])
        elif kind == "swap":
            other = draw(st.integers(0, len(lines) - 1))
            lines[at], lines[other] = lines[other], lines[at]
            text = "\n".join(lines)
        elif kind == "character" and text:
            place = draw(st.integers(0, len(text) - 1))
            text = text[:place] + draw(st.characters(exclude_categories=["Cs"])) + text[place + 1 :]
        else:
            text = text[: draw(st.integers(0, len(text)))]
    return text


@contextmanager
def bounded(seconds: float) -> Iterator[None]:
    """Raise TimeoutError after so many seconds of the processor's time, which other programs do not use up."""

    def late(*_: object) -> None:
        raise TimeoutError(f"more than {seconds:g} s")

    before = signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def read(file: Path) -> tuple[Campaign, list[Case]] | None:
    """Return the campaign and its cases, None where it is refused in lines that are fit to be read."""
    with bounded(5.0):
        try:
            found = load(file)
            return found, cases(found)
        except InputError as error:
            fit_to_be_read(str(error))
            return None


def fit_to_be_read(message: str) -> None:
    """Hold a message against what a terminal and a reader bear."""
    lines = message.split("\n")
    assert all(line.strip() and line.isprintable() for line in lines), message
    assert len(lines) <= 101
    assert max(map(len, lines)) < 2_500
    assert "Node(" not in message
    assert "Traceback" not in message


def stated(text: str, units: dict[str, float]) -> float | None:
    """Return the number that a text states by a grammar of its own; None where it states none."""
    match = STRICT.fullmatch(text)
    return float(match[1]) * units[match[2]] if match and match[2] in units else None


def value_at(model: Any, path: str) -> Any:
    """Return what a loaded campaign has at a path."""
    for key in path.split("."):
        model = model[int(key)] if key.isdigit() else getattr(model, key)
    return model


def is_meant(campaign: Campaign, found: list[Case]) -> None:
    """Hold a campaign that was accepted against its own labels and published numbers."""
    assert found
    labels = [case.label for case in found]
    assert len(set(labels)) == len(labels)
    for case in found:
        for axis, (name, label) in zip(campaign.axes, case.axes.items(), strict=True):
            if label == "base":
                continue
            assert axis.labels is not None
            assert axis.values is not None
            level = axis.values[axis.labels.index(label)]
            dumped = case.scenario.model_dump(mode="json")
            for key in axis.path.split("."):
                dumped = dumped[int(key)] if isinstance(dumped, list) else dumped[key]
            later = campaign.axes[list(case.axes).index(name) + 1 :]
            if not any(one.path.startswith(f"{axis.path}.") for one in later):
                assert dumped == level, f"{name}={label}"
    for one in campaign.references:
        assert any(one.case.items() <= case.axes.items() for case in found)
    for one in campaign.references:
        assert math.isfinite(one.value)
    assert campaign.monte_carlo is None or 1 <= campaign.monte_carlo.runs <= 10**6


TABLE = "t_s,x_m\n" + "\n".join(f"{0.5 * k},{6.4e6 + 3.0 * k}" for k in range(20)) + "\n"


def read_table(file: Path) -> None:
    """Read a file of data; it is refused in one line, or is a table of finite numbers over rising times."""
    with bounded(5.0):
        try:
            table, places = read_columns(str(file), ["t_s", "x_m"], ",")
            usable_rows(table[:, 0], {}, str(file), places)
        except InputError as error:
            fit_to_be_read(str(error))
            return
    assert all(math.isfinite(value) for row in table for value in row)
    assert all(first < second for first, second in zip(table[:, 0], table[1:, 0], strict=False))
    rows = [
        line.split(",") for line in file.read_text(encoding="utf-8-sig").splitlines() if re.match(r"[ \"+.0-9-]", line)
    ]
    assert len(table) <= len(rows)
