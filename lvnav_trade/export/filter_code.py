"""Filter of a case as C: source files, recorded runs, and the result of their replay."""

from __future__ import annotations

import io
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from lvnav_trade.campaign.definition.axes import Case
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.quantities.errors import InputError

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off")
"""Compiler options. Fused multiply-add is disabled, because it rounds differently from the kernels."""
_SLOWEST = 600.0  # s, time-out of the compiler and of the replay


class FilterCode(NamedTuple):
    """The filter of a case as C.

    files : Content of the files by name.
    differences : Run, estimate, number of times compared, and largest difference, relative to the magnitude of the
        estimate (in sigmas for `sigmas`); None if this machine has no C compiler.
    compiler : C compiler of this machine; empty if there is none.
    agrees : Whether every difference is within the tolerance.
    """

    files: dict[str, bytes | str]
    differences: pd.DataFrame | None
    compiler: str
    agrees: bool

    @property
    def command(self) -> str:
        """The command that compiles and replays the runs."""
        return f"{build_line()} && ./replay flight.bin run_*.bin"


def compiler_of_machine() -> str:
    """Return the C compiler of this machine: from the variable CC, or else cc, gcc or clang; empty if there is none."""
    preferred_compiler = os.environ.get("CC")
    for name in [preferred_compiler] if preferred_compiler else ["cc", "gcc", "clang"]:
        path = shutil.which(name)
        if path:
            return path
    return ""


def filter_code(campaign: Campaign, case: Case, runs: int, progress: Callable[[str], None]) -> FilterCode:
    """Return the C code of the filter of a case with recorded runs, compiled and replayed if there is a compiler.

    Parameters
    ----------
    campaign : Campaign
        The campaign; its seed determines the random draws.
    case : Case
        The case.
    runs : int
        Number of recorded runs.
    progress : callable
        Receives a text at each step.

    Raises
    ------
    InputError
        The case has no filter that can be exported, a kernel cannot be translated, or the compiler fails.
    """
    from lvnav_trade.export.code import NAME, translate_filter
    from lvnav_trade.export.program_replay import flight_bytes, replay_text, run_bytes
    from lvnav_trade.export.translation.values import TranslationError
    from lvnav_trade.simulation.preparation.prepare import prepare

    if runs < 0:
        raise InputError(f"--runs {runs}: should be 0 or more")
    prepared_case = prepare(case.scenario)
    words = f"Filter of the campaign {campaign.name}, case {case.label} ({case.id})."
    title = " ".join(words.replace("*/", "* /").replace("/*", "/ *").split())
    try:
        code = translate_filter(prepared_case, title)
    except TranslationError as error:
        raise InputError(f"the filter of this case cannot be translated to C: {error}") from None
    files: dict[str, bytes | str] = {f"{NAME}.h": code.header, f"{NAME}.c": code.source}
    files["README.md"] = _readme(_MARKUP.sub(r"\\\g<0>", title), code.open_loop, code.counts_epochs, runs)
    if runs:
        files["replay.c"] = replay_text(code, prepared_case.layout.n_state)
        files["flight.bin"] = flight_bytes(prepared_case, code)
    for run in range(runs):
        progress(f"run {run + 1} of {runs}")
        files[f"run_{run}.bin"] = run_bytes(prepared_case, code, campaign.seed, run)
    compiler = compiler_of_machine()
    if not runs or not compiler:
        return FilterCode(files, None, compiler, True)
    progress("compiling and replaying")
    differences, agrees = _replay(files, compiler, runs)
    files["replay.csv"] = differences.to_csv(index=False)
    return FilterCode(files, differences, compiler, agrees)


def build_line(compiler: str = "cc") -> str:
    """Return the command that compiles the replay."""
    return f"{compiler} {' '.join(FLAGS)} -o replay nav_filter.c replay.c -lm"


_MARKUP = re.compile(r"[\\`*_<>\[\]#!|~&]")  # Markdown characters, which are escaped in names


def _readme(title: str, open_loop: bool, counts_epochs: bool, runs: int) -> str:
    """Return the README of the C code: how to call it and how to build it.

    Parameters
    ----------
    title : str
        Name of campaign and case, escaped for Markdown.
    open_loop : bool
        Whether the outputs are the sum of the inertial solution and the error state.
    counts_epochs : bool
        Whether `update` has the number of the epoch as argument.
    runs : int
        Number of recorded runs. The replay is described if there are any.
    """
    text = _CALLS.format(title=title, number=", epoch" if counts_epochs else "")
    if open_loop:
        text += _OPEN
    if runs:
        text += _REPLAY.format(command=f"{build_line()} && ./replay flight.bin run_*.bin")
    return text


def _replay(files: dict[str, bytes | str], compiler: str, runs: int) -> tuple[pd.DataFrame, bool]:
    """Compile the filter and replay its recorded runs.

    Parameters
    ----------
    files : dict
        Content of the files by name.
    compiler : str
        Path of the C compiler.
    runs : int
        Number of recorded runs.

    Returns
    -------
    differences : pandas.DataFrame
        Columns run, estimate, times, difference.
    agrees : bool
        Whether every difference is within the tolerance.

    Raises
    ------
    InputError
        The compiler or the replay fails.
    """
    with tempfile.TemporaryDirectory(prefix="lvnav-trade-") as place:
        for name, content in files.items():
            data = content if isinstance(content, bytes) else content.encode()
            Path(place, name).write_bytes(data)
        build = _run([compiler, *FLAGS, "-o", "replay", "nav_filter.c", "replay.c", "-lm"], place)
        if build.returncode:
            raise InputError(f"{compiler}: could not compile the filter: {build.stderr.strip().splitlines()[:1]}")
        recordings = [f"run_{run}.bin" for run in range(runs)]
        replay = _run([str(Path(place, "replay")), "flight.bin", *recordings], place)
    if replay.returncode not in (0, 1):
        raise InputError(f"the replay of the filter ended with code {replay.returncode}: {replay.stderr.strip()[:200]}")
    return pd.read_csv(io.StringIO(replay.stdout)), replay.returncode == 0


_CALLS = """# A navigation filter in C99

{title}

No allocation, no recursion, no state beside `struct nav_filter`; `math.h` and `string.h` are all it needs.

```c
nav_filter_begin(&filter, nav);
/* every window: set filter.increments and filter.window, then */
nav_filter_propagate(&filter);
/* every epoch: set what was measured and filter.epoch, then */
nav_filter_update(&filter{number});
```

The header says what every field is. A window is a step of the covariance; its last tick is that of the epoch, where
there is one. What does not change on the flight of the case is in tables, gains of a schedule among them.
"""
_OPEN = """
The loop is open: between `nav_filter_correct_outputs` and `nav_filter_restore_outputs` the estimates are the corrected
outputs, else those of the inertial system.
"""
_REPLAY = """
    {command}

replays the recorded runs. It prints by how much each estimate differs from that of the simulation, as a share of its
size, and `sigmas`: velocity and position in sigmas. The recordings are doubles in the byte order of the machine that
wrote them, in the order in which `replay.c` reads them.
"""


def _run(command: list[str], place: str) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run(
            command,
            cwd=place,
            capture_output=True,
            text=True,
            timeout=_SLOWEST,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise InputError(f"{command[0]}: {error}") from error
