"""Requirements that the number of runs is too small to demonstrate."""

from collections.abc import Iterator

from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.quantities.errors import Mistake
from lvnav_trade.results.requirements.requirements import further_runs
from lvnav_trade.results.statistics.probability import runs_needed


def required_run_counts(probability: float, confidence: float, block: int) -> tuple[int, int]:
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
    tested_requirements = []
    for k, requirement in enumerate(campaign.requirements):
        path = f"requirements.{k}"
        tested_requirements.append((path, requirement.name, requirement.probability, requirement.confidence))
    if campaign.corridor is not None:
        corridor = campaign.corridor
        tested_requirements.append(("corridor", "corridor", corridor.probability, corridor.confidence))
    for path, name, probability, confidence in tested_requirements:
        fixed_test, sequential_test = required_run_counts(probability, confidence, card.block)
        # The corridor is evaluated after all runs; it does not decide when a case stops.
        is_sequential = card.stop is not None and path != "corridor"
        required_runs = sequential_test if is_sequential else fixed_test
        if card.runs < required_runs:
            goal = f"{100 * probability:.6g} % at {100 * confidence:.6g} % confidence"
            runs_needed_text = f"{fixed_test:,} are needed, {sequential_test:,} with stop: decided"
            message = f"{name}: {card.runs:,} runs cannot show {goal}: {runs_needed_text}"
            yield campaign.source_tree.mistake(path, message)
