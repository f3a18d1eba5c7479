"""What tests of the command line share: trajectories that nobody flies, and results to look at."""

from __future__ import annotations

from pathlib import Path

import pytest

from lvnav_trade.campaign.running import work
from lvnav_trade.campaign.running.work import Engine


@pytest.fixture
def events(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> dict[str, float]:
    """Let every trajectory have the same events, so that nothing is flown; work in an empty folder."""
    monkeypatch.chdir(tmp_path)
    times = {"liftoff": 0.0, "stage1_cutoff": 150.0, "stage2_ignition": 200.0, "injection": 600.0}

    def none(*_: object) -> None:
        raise AssertionError("nothing should be computed")

    def nothing(*_: object) -> None:
        """Prepare nothing, and know of no effect."""

    monkeypatch.setattr(work, "ENGINE", Engine(lambda scenario: times, nothing, *[none] * 8, nothing))
    return times


@pytest.fixture(scope="module")
def variants(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with results and three candidates."""
    from lvnav_trade.results.tables.read import load
    from tests import synthetic
    from tests.results.variants import variant, worse

    folder = tmp_path_factory.mktemp("variants")
    base = load(synthetic.results(folder / "base", n_run=40))
    variant(base, folder / "same", runs=worse(1.0))
    variant(base, folder / "larger", runs=worse(1.3))
    variant(base, folder / "close", runs=worse(1.05, 0.05))
    variant(base, folder / "other", campaign=lambda campaign: campaign | {"seed": 8})
    return folder
