"""What a part of streamed statistics costs, and how far its quantiles are from those of the whole sample.

Run: python docs/design/streamed_statistics.py
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np

from lvnav_trade.quantities.records import Output, RunBlock
from lvnav_trade.results.tables import parts
from lvnav_trade.simulation.statistics import merge, quantiles, summarise

N_HIST, N_EPOCH, N_CHANNEL, SIZE, BLOCKS = 700, 700, 64, 40, 25
NAMES = ("attitude", "velocity", "position", "gyro_bias", "accel_bias")
OUTPUTS = (
    *(Output(name, axis, "m", "m", 1.0) for name in NAMES for axis in "xyz"),
    Output("clock_bias", "time", "m", "m", 1.0),
    Output("clock_drift", "rate", "m/s", "m/s", 1.0),
)


def block(number: int) -> RunBlock:
    """Draw a block of white Gaussian errors of unit sigma."""
    draw = np.random.default_rng([1, number])
    inno = draw.standard_normal((SIZE, N_EPOCH, N_CHANNEL))
    err = draw.standard_normal((SIZE, N_HIST, len(OUTPUTS)))
    rows = np.full((SIZE, N_EPOCH), N_CHANNEL, dtype=np.int32)
    t = np.arange(float(N_HIST))
    return RunBlock(
        number * SIZE, t, err, np.ones_like(err), (err**2).sum(axis=2), t, (inno**2).sum(axis=2), rows, 0 * rows,
        inno, np.zeros(SIZE, dtype=np.int8), np.full(SIZE, np.nan),
    )  # fmt: skip


def main() -> None:
    """Print size and time of a part, memory of the merged summary, error of the quantiles."""
    events = {f"event {k}": float(70 * k) for k in range(10)}
    scale = np.ones((N_HIST, len(OUTPUTS)))
    with tempfile.TemporaryDirectory() as name:
        folder, errors = Path(name), []
        seconds = np.zeros(2)
        for number in range(BLOCKS):
            runs = block(number)
            errors.append(np.abs(runs.err[:, ::70]))
            start = time.perf_counter()
            summary = summarise(runs, events, scale, OUTPUTS)
            middle = time.perf_counter()
            path = parts.write(folder, summary)
            seconds += (middle - start, time.perf_counter() - middle)
        raw = sum(array.nbytes for array in runs if isinstance(array, np.ndarray))
        kept = sum(array.nbytes for array in summary if isinstance(array, np.ndarray))
        print(
            f"block {raw / 1e6:.1f} MB, summary in memory {kept / 1e6:.1f} MB, part {path.stat().st_size / 1e6:.2f} MB"
        )
        print(f"summarise {seconds[0] / BLOCKS:.3f} s, write {seconds[1] / BLOCKS:.3f} s per block of {SIZE} runs")
        start = time.perf_counter()
        whole = merge(parts.stream(folder))
        total = sum(array.nbytes for array in whole if isinstance(array, np.ndarray))
        print(f"merge of {BLOCKS} parts {time.perf_counter() - start:.1f} s, {total / 1e6:.1f} MB")
    sample = np.sort(np.concatenate(errors), axis=0)
    for probability in (0.5, 0.95, 0.997):
        exact = sample[int(np.ceil(probability * len(sample))) - 1]
        ratio = quantiles(whole, probability)[::70, : len(OUTPUTS)] / exact - 1.0
        print(f"quantile {probability}: rms {100 * np.std(ratio):.2f} %, worst {100 * np.abs(ratio).max():.2f} %")


if __name__ == "__main__":
    main()
