"""Requirements that the number of runs is too small to demonstrate."""

from collections.abc import Iterator

from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.quantities.errors import Mistake
from lvnav_trade.results.requirements.requirements import further_runs
from lvnav_trade.results.statistics.probability import runs_needed


def needed(probability: float, confidence: float, block: int) -> tuple[int, int]:
    """Return the number of runs that demonstrate a probability of success if none of them fails.

    Parameters
    ----------
    probability : float
        Probability of success to demonstrate.
    confidence : float
        Confidence of the demonstration.
    block : int
        Runs per block.

    Returns
    -------
    tuple of int
        Runs with a single test after the last run, and with a test after every block (``stop: decided``).
    """
    return runs_needed(0, probability, confidence), further_runs([], probability, confidence, block)


def requirements_beyond_run_count(campaign: Campaign) -> Iterator[Mistake]:
    """Yield an input error for each requirement, and the corridor, that stays undecided even if no run fails.

    A campaign without Monte Carlo yields none: linear covariance decides its requirements.
    """
    card = campaign.monte_carlo
    if card is None:
        return
    tested = [(f"requirements.{k}", r.name, r.probability, r.confidence) for k, r in enumerate(campaign.requirements)]
    if campaign.corridor is not None:
        tested.append(("corridor", "corridor", campaign.corridor.probability, campaign.corridor.confidence))
    for path, name, probability, confidence in tested:
        fixed, in_order = needed(probability, confidence, card.block)
        stops = card.stop is not None and path != "corridor"
        if card.runs < (in_order if stops else fixed):
            shown = f"{100 * probability:.6g} % at {100 * confidence:.6g} % confidence"
            more = f"{fixed:,} are needed, {in_order:,} with stop: decided"
            yield campaign.written.mistake(path, f"{name}: {card.runs:,} runs cannot show {shown}: {more}")
