"""Cases of the combination matrix as C: made, compiled, replayed."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from lvnav_trade.export.code import FilterProgram, translate_filter
from lvnav_trade.export.filter_code import FLAGS
from lvnav_trade.export.program_replay import flight_bytes, replay_text, run_bytes
from lvnav_trade.simulation.preparation.prepare import PreparedCase
from tests.both_engines.combinations import scenario_of, with_stored_gains
from tests.both_engines.covering import DIMENSIONS
from tests.both_engines.short_flights import flight
from tests.building import prepare_hop

FIRST = {name: next(iter(levels)) for name, levels in DIMENSIONS.items()}


def prepared_of(levels: Mapping[str, str]) -> PreparedCase:
    """Return a case of the matrix, made ready; levels that are not named are the first ones."""
    case = FIRST | levels
    scenario, kind, stored = scenario_of(case)
    return prepare_hop(with_stored_gains(case, scenario) if stored else scenario, flight(kind))


def write(folder: Path, prepared_case: PreparedCase, made: FilterProgram, runs: int) -> None:
    """Write header, source and replay of a filter, and runs."""
    (folder / "nav_filter.h").write_text(made.header)
    (folder / "nav_filter.c").write_text(made.source)
    (folder / "replay.c").write_text(replay_text(made, prepared_case.layout.n_state))
    (folder / "flight.bin").write_bytes(flight_bytes(prepared_case, made))
    for run in range(runs):
        (folder / f"run_{run}.bin").write_bytes(run_bytes(prepared_case, made, 4, run))


def build(folder: Path) -> None:
    """Compile the replay; a warning is an error."""
    flags = [*FLAGS, "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
    command = ["cc", *flags, "-o", "replay", "nav_filter.c", "replay.c", "-lm"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def replay(folder: Path, runs: int) -> tuple[int, pd.DataFrame]:
    """Replay runs; return the exit code and the table."""
    command = ["./replay", "flight.bin", *(f"run_{run}.bin" for run in range(runs))]
    with (folder / "replay.csv").open("w") as table:
        done = subprocess.run(command, cwd=folder, stdout=table, stderr=subprocess.PIPE, text=True, check=False)
    assert not done.stderr, done.stderr
    return done.returncode, pd.read_csv(folder / "replay.csv")


def compiled(folder: Path, levels: Mapping[str, str], runs: int = 1) -> tuple[int, pd.DataFrame]:
    """Return exit code and table of a case's replay."""
    prepared_case = prepared_of(levels)
    write(folder, prepared_case, translate_filter(prepared_case, "A case of the matrix."), runs)
    build(folder)
    return replay(folder, runs)
