"""Decision 90: two readings of Canepa and Servidia by rules that were stated before the first evaluation.

    python docs/design/conae_readings.py

Own noise of the loose filter: velocity and attitude noise over a grid, by the mean of squared logarithms of ours over
published. One of tables 2 and 3 is fitted, the other withheld as a whole, and the other way round.
Whiteness: largest autocorrelation of the innovations of the receiver's own filter at lags 1 to 10, without the epochs
after a jump of thrust, of satellites that are tracked long enough.
"""

from __future__ import annotations

import json
import math

import conae_search as search
import numpy as np

SET = search.PRINTED | {
    "gyro_walk": 1.944e-4,
    "attitude_noise": 2.0,
    "longitudinal": "z",
    "content": 5,
    "hour": 5,
    "channels": 8,
}
VELOCITY = (0.0, 0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2)  # m/s/sqrt(s)
ATTITUDE = (2.0, 0.0)  # deg/sqrt(h)
JUMPS = ("liftoff", "stage1_cutoff", "stage2_ignition", "injection")
AFTER = 8.0  # s after a jump that do not count
LEAST = 100  # epochs of a satellite in a flight
LIMIT, LAGS = 0.15, 10


def squares(at: dict) -> tuple[np.ndarray, np.ndarray]:
    """Return the squared logarithms of ours over published of tables 2 and 3 at a point."""
    found: dict[str, list[float]] = {"position": [], "velocity": []}
    for case in dict.fromkeys(row.case for row in search.rows() if row.file == "pvt_sources"):
        values = json.dumps(search._values("pvt_sources", case, at))
        prepared_case = search._noisy(search._prepared("pvt_sources", case, values), at)
        end = prepared_case.trajectory.events["injection"]
        t, err, names = search._errors(prepared_case, search._campaign("pvt_sources")[0].seed)
        for row in search.rows():
            if (row.file, row.case) == ("pvt_sources", case):
                ours = search._measured(row, t, err, names, end)
                found[row.metric.partition("_")[0]].append(math.log(ours / row.value) ** 2)
    return np.array(found["position"]), np.array(found["velocity"])


def own_noise() -> None:
    """Print the objective of both tables over the grid, and what each fit makes of the withheld table."""
    points = {
        (velocity, attitude): squares(SET | {"velocity_noise": velocity, "attitude_noise": attitude})
        for attitude in ATTITUDE
        for velocity in VELOCITY
    }
    flown = points[0.0, 2.0]
    for (velocity, attitude), (second, third) in points.items():
        close = int(sum((np.sqrt(one) < math.log(2.0)).sum() for one in (second, third)))
        print(f"velocity {velocity:5} attitude {attitude}: {second.mean():.3f} {third.mean():.3f}, {close} of 30")
    for fitted, withheld, names in ((0, 1, "table 2, table 3"), (1, 0, "table 3, table 2")):
        best = min(points, key=lambda at, fitted=fitted: points[at][fitted].mean())
        before, after = flown[withheld].mean(), points[best][withheld].mean()
        print(f"fitted, withheld: {names}: best {best}, withheld {before:.3f} -> {after:.3f}: {after < before}")


def whiteness() -> None:
    """Print the largest autocorrelation of the receiver's filter by case and kind of channel."""
    campaign, labelled = search._campaign("receiver")
    for label, case in labelled.items():
        if "EKF-GNSS" not in label or "faults=none" not in label or "realisation=0" not in label:
            continue
        prepared_case = search.prepare(case.scenario, history=10.0)
        block = search.run_block(prepared_case, campaign.seed, 0, search.RUNS)
        t, events = prepared_case.t_epoch, prepared_case.trajectory.events
        counted = np.ones(t.size, dtype=bool)
        for name in JUMPS:
            counted &= ~((t >= events[name] - 1e-6) & (t < events[name] + AFTER))
        z = np.where(counted[None, :, None], block.innovation, np.nan)
        found: dict[str, list[tuple[float, str]]] = {}
        for k, channel in enumerate(prepared_case.channel_names):
            words = channel.split(" ")
            if words[0] != "receiver":
                continue
            mine = z[:, :, k]
            if np.isfinite(mine).sum(axis=1).mean() < LEAST:
                continue
            power = np.nanmean(mine**2)
            sizes = [abs(np.nanmean(mine[:, lag:] * mine[:, :-lag])) / power for lag in range(1, LAGS + 1)]
            found.setdefault(" ".join(words[2:]), []).append((float(np.nanmax(sizes)), channel))
        for kind, sizes in found.items():
            worst = max(sizes)
            said = "white" if worst[0] < LIMIT else "correlated"
            print(f"{label}: {kind}: {worst[0]:.3f} ({worst[1]}, of {len(sizes)}), {said}")


if __name__ == "__main__":
    own_noise()
    whiteness()
