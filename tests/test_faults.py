"""Whatever happens to a campaign, on the real engines and through the command line: reported in one line, nothing lost,
resumed to the bytes of one that nothing happened to.
"""

from __future__ import annotations

import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd
import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[1]
ASKED = (
    "keep.history=5 s",
    "axes=[{path: imu, cards: [imu/tactical_fog, imu/tactical_mems]}]",
    "covariance={adjoint: false, sensitivity: false, observability: false}",
    "monte_carlo={runs: 160, block: 8}",
)
BLOCKS, RUNS = 40, 320
Process = subprocess.Popen[str]


class Ended(NamedTuple):
    """How a process ended: exit code, what it said on standard error, what on standard output."""

    code: int
    reported: str
    said: str

    @property
    def last(self) -> str:
        """The line that says why."""
        return self.reported.splitlines()[-1]


def start(folder: Path | str, *more: str, sets: Sequence[str] = ASKED, prefix: Sequence[str] = ()) -> Process:
    """Start the campaign in a process group of its own."""
    assigned = [word for assignment in sets for word in ("--set", assignment)]
    command = [*prefix, sys.executable, "-m", "lvnav_trade", "run", "campaigns/smoke.yaml", *assigned]
    return subprocess.Popen(
        [*command, "--no-report", "--jobs=2", "--out", str(folder), *more],
        cwd=ROOT, start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def end(process: Process) -> Ended:
    """Wait for a process."""
    said, reported = process.communicate(timeout=600)
    assert "Traceback" not in reported
    return Ended(process.returncode, reported, said)


def status(folder: Path | str) -> dict[str, object]:
    """Return what the status of a folder is said to be."""
    command = [sys.executable, "-m", "lvnav_trade", "status", str(folder), "--json"]
    found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    content: dict[str, object] = json.loads(found.stdout)
    return content


def stored(folder: Path) -> list[Path]:
    """Return the blocks on disk."""
    return sorted(path for path in folder.glob("parts/*/*.parquet") if not path.name.startswith("."))


def wait_for_blocks(folder: Path, n: int, process: Process) -> None:
    """Wait until so many blocks are stored."""
    last = time.monotonic() + 300
    while len(stored(folder)) < n:
        assert time.monotonic() < last
        assert process.poll() is None, end(process)
        time.sleep(0.02)


def digests(folder: Path) -> dict[str, str]:
    """Return the digests of the tables."""
    return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in folder.glob("*.parquet")}


class Whole(NamedTuple):
    """A campaign that nothing happened to: folder, digests of its tables, seconds that it took."""

    folder: Path
    tables: dict[str, str]
    seconds: float


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Whole:
    """Carry the campaign out, once for the kernels to be compiled and once to be timed."""
    place = tmp_path_factory.mktemp("faults")
    assert end(start(place / "first", sets=(*ASKED[:3], "monte_carlo={runs: 8, block: 8}"))).code == 0
    begun = time.monotonic()
    assert end(start(place / "whole")).code == 0
    found = Whole(place / "whole", digests(place / "whole"), time.monotonic() - begun)
    assert len(found.tables) > 10
    return found


@pytest.fixture
def copy(whole: Whole, tmp_path: Path) -> Path:
    """Return a copy of finished results."""
    return Path(shutil.copytree(whole.folder, tmp_path / "copy"))


def assert_resumes(folder: Path, whole: Whole) -> Ended:
    """Give the same command again and hold what it leaves against the campaign that nothing happened to."""
    found = end(start(folder))
    assert found.code == 0, found.reported
    assert digests(folder) == whole.tables
    assert [path.relative_to(folder) for path in stored(folder)] == [
        path.relative_to(whole.folder) for path in stored(whole.folder)
    ]
    assert not list(folder.rglob(".*.parquet.*")), "half written files were left"
    assert status(folder)["state"] == "finished"
    return found


def test_ten_kills_at_random_moments_and_then_the_same_bytes(whole: Whole, tmp_path: Path, record_property) -> None:
    moments, folder, seen = random.Random(20261121), tmp_path / "killed", list[int]()
    while len(seen) < 10:
        if len(stored(folder)) == BLOCKS:  # the next kills should find runs to fly
            shutil.rmtree(folder)
        process = start(folder)
        wait_for_blocks(folder, min(len(stored(folder)) + moments.randrange(9), BLOCKS - 1), process)
        time.sleep(moments.uniform(0.0, 0.1) * whole.seconds)
        if process.poll() is None:
            if len(seen) % 2:
                os.killpg(process.pid, signal.SIGKILL)
            else:
                process.kill()  # its workers live on for a moment, beside the next one
            seen.append(len(stored(folder)))
            assert end(process).code == -signal.SIGKILL
            if (folder / "manifest.json").exists():
                # a campaign that is killed between its manifest and its end is finished
                is_whole = len(stored(folder)) == BLOCKS
                assert status(folder)["state"] in (("unfinished", "finished") if is_whole else ("unfinished",))
        else:  # it came to its end before the moment
            assert end(process).code == 0
    record_property("blocks stored at the kills", seen)
    assert_resumes(folder, whole)


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_campaign_says_so_and_goes_on(whole: Whole, tmp_path: Path, sent: signal.Signals) -> None:
    folder = tmp_path / "ended"
    process = start(folder)
    wait_for_blocks(folder, 5, process)
    if sent == signal.SIGINT:
        os.killpg(process.pid, sent)  # as a terminal does
    else:
        process.send_signal(sent)
    found = end(process)
    assert (found.code, found.last) == (130, "interrupted; the same command resumes")
    n = len(stored(folder))
    reported = status(folder)
    assert (reported["state"], reported["stored_runs"], reported["required_runs"]) == ("unfinished", 8 * n, RUNS)
    assert 5 <= n < BLOCKS
    assert f"runs: {RUNS - 8 * n}\n" in assert_resumes(folder, whole).reported


def test_a_worker_killed_by_the_system_costs_a_block(whole: Whole, tmp_path: Path) -> None:
    folder = tmp_path / "worker"
    process = start(folder)
    wait_for_blocks(folder, 5, process)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    workers = [pid for pid in map(int, children) if "popen_loky" in Path(f"/proc/{pid}/cmdline").read_text()]
    assert len(workers) == 2
    os.kill(workers[0], signal.SIGKILL)
    found = end(process)
    assert found.code == 0
    reported = "a worker process died (out of memory?); its work is done again by 2 workers"
    assert [line.endswith(reported) for line in found.reported.splitlines()].count(True) == 1
    assert digests(folder) == whole.tables
    assert status(folder)["workers_died"] == 1


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Callable[[str], Path]]:
    """Return what mounts a file system of a size, or gives it another one."""
    place = tmp_path / "disk"
    place.mkdir()
    mounted = False

    def sized(size: str) -> Path:
        nonlocal mounted
        options = f"{'remount,' if mounted else ''}size={size}"
        found = subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(place)], capture_output=True)
        if found.returncode:
            pytest.skip("no file system can be mounted here")
        mounted = True
        return place

    yield sized
    if mounted:
        subprocess.run(["umount", str(place)], check=True)


@pytest.mark.parametrize("size", ["16k", "600k", "4m"])
def test_a_full_disk_ends_in_one_line_and_goes_on_once_there_is_space(small_disk, whole: Whole, size: str) -> None:
    folder = small_disk(size) / "results"
    found = end(start(folder))
    assert found.code == 4
    assert found.last.startswith(str(folder))
    assert found.last.endswith(": No space left on device; the same command resumes once there is space")
    if (folder / "manifest.json").exists():
        assert status(folder)["state"] == "unfinished"
    small_disk("500m")
    assert_resumes(folder, whole)


def test_a_limit_on_the_size_of_files_ends_in_one_line_too(whole: Whole, tmp_path: Path) -> None:
    limited = ["sh", "-c", 'ulimit -f 100; exec "$@"', "sh"]
    found = end(start(tmp_path / "limited", prefix=limited))
    assert found.code == 4
    assert found.last.endswith(": File too large; the same command resumes once that is mended")
    assert_resumes(tmp_path / "limited", whole)


def test_a_folder_that_may_not_be_written_is_refused_before_anything_runs(copy: Path, whole: Whole) -> None:
    places = [path for path in (copy, *copy.rglob("*")) if path.is_dir()]
    for path in (*places, *(path for path in copy.rglob("*") if path.is_file())):
        path.chmod(0o500 if path.is_dir() else 0o400)
    drop = []
    if os.geteuid() == 0:
        if shutil.which("setpriv") is None:
            pytest.skip("root may write anywhere")
        drop = ["setpriv", "--bounding-set=-dac_override,-dac_read_search"]
    found = end(start(copy, prefix=drop))
    assert (found.code, found.reported) == (2, f"{copy}: cannot be locked: Permission denied\n")
    assert status(copy)["state"] == "finished"
    assert digests(copy) == whole.tables
    for path in places:
        path.chmod(0o700)


def test_damaged_blocks_are_found_reported_and_flown_again(copy: Path, whole: Whole) -> None:
    cut, flipped, *_ = stored(copy)
    cut.write_bytes(cut.read_bytes()[:-1000])
    content = bytearray(flipped.read_bytes())
    content[len(content) // 2] ^= 1
    flipped.write_bytes(content)
    reported = status(copy)
    assert (reported["state"], reported["stored_runs"]) == ("damaged", RUNS - 16)
    assert [str(path) in line for path, line in zip((cut, flipped), reported["damaged_files"], strict=True)] == [
        True,
        True,
    ]
    again = assert_resumes(copy, whole).reported
    assert "runs: 16\n" in again
    for path in (cut, flipped):
        (line,) = [line for line in again.splitlines() if line.startswith(f"{path}: damaged part: ")]
        assert line.endswith("; dropped, its runs will be computed again")


def test_a_damaged_table_is_reported_and_made_again_from_the_blocks(copy: Path, whole: Whole) -> None:
    path = copy / "runs.parquet"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    reported = status(copy)
    assert reported["state"] == "damaged"
    assert [line.startswith(f"{path}: damaged: ") for line in reported["damaged_files"]] == [True]
    command = [sys.executable, "-m", "lvnav_trade", "report", str(copy)]
    refused = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert refused.returncode == 2
    assert refused.stderr.startswith(f"{path}: damaged: ")
    assert refused.stderr.count("\n") == 1
    assert " runs: " not in assert_resumes(copy, whole).reported  # no run is computed again


def test_two_processes_do_not_work_on_one_campaign(whole: Whole, tmp_path: Path) -> None:
    folder = tmp_path / "shared"
    first = start(folder)
    wait_for_blocks(folder, 3, first)
    os.killpg(first.pid, signal.SIGSTOP)  # it must not come to its end before the other one asks
    assert status(folder)["state"] == "running"
    second = end(start(folder, "--fresh"))
    os.killpg(first.pid, signal.SIGCONT)
    assert second.code == 2
    assert second.last.startswith(f"{folder}: process {first.pid} on ")
    assert second.last.endswith(" is working on these results; wait, or give another folder")
    assert end(first).code == 0
    assert digests(folder) == whole.tables


def test_another_campaign_or_code_is_never_mixed_in(copy: Path, whole: Whole) -> None:
    other = end(start(copy, "--set", "seed=2"))
    assert other.code == 2
    assert other.reported == f"{copy}: holds the results of another campaign; use --fresh, or another folder\n"
    manifest = json.loads((copy / "manifest.json").read_text())
    (copy / "manifest.json").write_text(json.dumps({**manifest, "code_digest": "0123"}))
    other = end(start(copy))
    assert other.code == 2
    assert other.reported.startswith(f"{copy}: was computed by another code (0123, this is ")
    assert digests(copy) == whole.tables
    (copy / "manifest.json").unlink()  # nobody knows any more; the blocks still do
    assert end(start(copy, "--set", "seed=2")).code == 0
    fresh = copy.with_name("fresh")
    assert end(start(fresh, "--set", "seed=2")).code == 0
    assert digests(copy) == digests(fresh)
    assert digests(copy) != whole.tables


def test_a_diverging_filter_leaves_a_row_per_failed_run_and_the_command_that_flies_it_again(tmp_path: Path) -> None:
    sets = (*ASKED[:3], "monte_carlo={runs: 16, block: 8}", "filter=filters/inertial", "diverged=9 km")
    folder = tmp_path / "lost"
    found = end(start(folder, sets=sets))
    assert found.code == 4
    runs = pd.read_parquet(folder / "runs.parquet").drop_duplicates(["case", "run_number"])
    assert len(runs) == 32
    failed = runs[runs.failure != ""]
    assert 5 < len(failed) < 32
    assert set(failed.failure) == {"diverged"}
    assert (failed.t_failed_s > 0).all()
    lines = [line for line in found.said.splitlines() if line.startswith("failed: ")]
    assert len(lines) == 11
    assert lines[-1] == f"failed: {len(failed) - 10} more; all of them: column failure of the table runs, or --json"
    reported = status(folder)
    assert (reported["state"], reported["failed_runs"]) == ("finished", len(failed))
    command = lines[0].partition("; ")[2].split()
    assert command[:2] == ["lvnav-trade", "replay"]
    again = subprocess.run(
        [sys.executable, "-m", "lvnav_trade", *command[1:]], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert again.stdout.splitlines()[0].endswith(": diverged")
    assert end(start(folder, sets=sets)).code == 4  # a second look does not make it well


def test_five_hundred_runs_and_five_hundred_more_are_a_thousand(tmp_path: Path) -> None:
    def asked(runs: int) -> tuple[str, ...]:
        return ("keep.history=10 s", f"monte_carlo={{runs: {runs}}}")

    assert end(start(tmp_path / "grown", sets=asked(500))).code == 0
    half = digests(tmp_path / "grown")
    assert end(start(tmp_path / "grown", sets=asked(1000))).code == 0
    assert end(start(tmp_path / "whole", sets=asked(1000))).code == 0
    assert digests(tmp_path / "grown") == digests(tmp_path / "whole") != half
