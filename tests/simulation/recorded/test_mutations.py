"""Damaged logs: each is refused in one line, or what is left of it is finite and its losses are counted."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from lvnav_trade.campaign.recorded_log import read_card
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.simulation.recorded.alignment import align
from lvnav_trade.simulation.recorded.log_consistency import remove_wild_solutions
from lvnav_trade.simulation.recorded.navigation_log import read_recording
from tests import recorded_log

COUNT = 25  # mutants of each file
FIELDS = (
    "", "nan", "inf", "-inf", "0", "-0.0", "-1", "1e308", "-1e308", "1e-308", "4294967295", "1_0", "\u0661", "G", "G 1",
    "x" * 5000, '"', "1;2", "NaN", "\x00", "47.0", "9e9",
)  # fmt: skip


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drive")
    recorded_log.write(folder, ranges=True)
    for name, most in (("imu", 3400), ("gnss", 136), ("ranges", 450)):  # 34 s, of which 14 s in motion
        lines = (folder / f"{name}.csv").read_text().splitlines(keepends=True)
        (folder / f"{name}.csv").write_text("".join(lines[: most + 1]))
    return folder


def mutated(text: str, rng: np.random.Generator) -> str:
    """Return a file of comma-separated values with one kind of damage."""
    lines = text.splitlines()
    titles = lines[0].split(",")
    rows = [line.split(",") for line in lines[1:]]
    k, column = int(rng.integers(len(rows))), int(rng.integers(len(titles)))
    kind = int(rng.integers(9))
    if kind == 0:
        rows[k][column] = str(rng.choice(FIELDS))
    elif kind == 1:  # a column of it
        field = str(rng.choice(FIELDS))
        rows = [[*row[:column], field, *row[column + 1 :]] for row in rows]
    elif kind == 2:
        rows[k] = ["0"] * len(titles)
    elif kind == 3:
        rows.insert(k, rows[int(rng.integers(len(rows)))])
    elif kind == 4:
        del rows[k : k + int(rng.integers(1, 200))]
    elif kind == 5:  # two columns exchanged, all along or in a row
        other = int(rng.integers(len(titles)))
        for row in rows if rng.random() < 0.5 else rows[k : k + 1]:
            row[column], row[other] = row[other], row[column]
    elif kind == 6:
        factor = float(rng.choice([-1.0, 0.0, 1e-3, 1e3, 57.29578, 1.0 / 57.29578, 3.6]))
        for row in rows if rng.random() < 0.5 else rows[k : k + 3]:
            row[column] = f"{factor * float(row[column]):.12g}" if titles[column] != "satellite" else row[column]
    elif kind == 7:
        titles[column] = str(rng.choice(["", "t_s", "v_north_m_s", "#", titles[0]]))
    else:
        rows[k] = rows[k][: int(rng.integers(len(titles)))]
    return "\n".join([",".join(titles), *map(",".join, rows)]) + "\n"


@pytest.mark.parametrize("name", ["gnss", "imu", "ranges"])
def test_a_damaged_log_is_refused_in_one_line_or_finite(drive, tmp_path, name):
    rng = np.random.default_rng([11, *name.encode()])
    text, refusals, read = (drive / f"{name}.csv").read_text(), [], 0
    folder = tmp_path / "log"
    shutil.copytree(drive, folder)
    card = folder / "log.yaml"
    plain = card.read_text()
    for _ in range(COUNT):
        (folder / f"{name}.csv").write_text(mutated(text, rng))
        card.write_text(plain.replace("gnss.csv}", "gnss.csv, noise: log}") if rng.random() < 0.5 else plain)
        stated = read_card(card)
        try:
            log = remove_wild_solutions(read_recording(stated, folder), stated, np.zeros(3))
            aligned = align(log, stated)
        except InputError as fault:
            refusals.append(str(fault))
            continue
        read += 1
        for part in (
            log.t,
            log.angle_sums,
            log.velocity_sums,
            log.t_fix,
            log.place,
            log.velocity_ned,
            aligned.C_b_n,
            aligned.gyro_bias,
        ):
            assert np.isfinite(part).all()
        if stated.gnss.noise == "log":
            assert (log.sigma > 0.0).all()
        assert len(log.notes) == len(set(log.notes))
    assert all(said and "\n" not in said for said in refusals)
    assert min(len(refusals), read) > 2
