"""Requirements that the number of runs is too small to demonstrate."""

from collections.abc import Iterator

from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.errors import Mistake
from lvnav_trade.metrics.basics.probability import runs_needed
from lvnav_trade.metrics.requirements.requirements import further_runs


def needed(probability: float, confidence: float, block: int) -> tuple[int, int]:
    """Return how many runs, all of them good, show a probability of success at a confidence: at a single look after the
    last run, and with a look after every block (``stop: decided``).
    """
    return runs_needed(0, probability, confidence), further_runs([], probability, confidence, block)


def undemonstrable(campaign: Campaign) -> Iterator[Mistake]:
    """Yield the requirements, and the corridor, that even runs without a failure would leave undecided, at their place.

    None of a campaign without runs: it asks linear covariance alone.
    """
    card = campaign.monte_carlo
    if card is None:
        return
    stated = [(f"requirements.{k}", one.name, one) for k, one in enumerate(campaign.requirements)]
    asked = [(path, name, one.probability, one.confidence) for path, name, one in stated]
    if campaign.corridor is not None:
        asked.append(("corridor", "corridor", campaign.corridor.probability, campaign.corridor.confidence))
    for path, name, probability, confidence in asked:
        fixed, in_order = needed(probability, confidence, card.block)
        stops = card.stop is not None and path != "corridor"
        if card.runs < (in_order if stops else fixed):
            shown = f"{100 * probability:.6g} % at {100 * confidence:.6g} % confidence"
            more = f"{fixed:,} are needed, {in_order:,} with stop: decided"
            yield campaign.written.mistake(path, f"{name}: {card.runs:,} runs cannot show {shown}: {more}")
