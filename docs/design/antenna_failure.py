"""How long an antenna failure lasts in the number of satellites, by what aids the search; behind decision 0014.

Run as ``python docs/design/antenna_failure.py``: prints a table, takes half a minute.
"""

from __future__ import annotations

import numpy as np

from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.syntax.card_lookup import campaign_file
from lvnav_trade.gnss.visibility import sky
from lvnav_trade.trajectory.flight import build

START, END, REALISATIONS = 300.0, 330.0, 40
ALIVE = 1  # the antenna that looks down in level flight


def main() -> None:
    """Print, for each kind of aiding, when four and ten satellites are tracked again."""
    scenario = load(campaign_file("campaigns/smoke.yaml"), ["base.receiver=receivers/l1_four_patch"]).base
    flight, receiver = build(scenario.trajectory), scenario.receiver
    t = np.arange(flight.start + 1.0, flight.end, 1.0)
    alive = np.ones((t.size, 4), dtype=bool)
    alive[(t >= START) & (t < END)] = np.arange(4) == ALIVE
    print("seconds after the antennas are back, 5, 50 and 95 % of realisations")
    for aiding in ("none", "own", "fused"):
        back = []
        for number in range(REALISATIONS):
            tracking = receiver.tracking.model_copy(update={"aiding": aiding, "realisation": number})
            card = receiver.model_copy(update={"tracking": tracking})
            count = sky(scenario.constellation, card, flight, t, antenna_alive=alive).is_tracked.sum(axis=1)
            back.append([t[(t >= END) & (count >= least)][0] - END for least in (4, 10)])
        four, ten = np.percentile(back, [5, 50, 95], axis=0).T.round().astype(int)
        print(f"aided by {aiding:6s} four satellites {four}, ten {ten}")


if __name__ == "__main__":
    main()
