import numpy as np
import pytest
from pydantic import ValidationError

from lvnav_trade.campaign.reading.expand import expand
from lvnav_trade.campaign.syntax import tree
from lvnav_trade.campaign.syntax.cards import Shelf, shipped
from lvnav_trade.world.receiver.receiver import ReceiverCard

NAMES = sorted(file.stem for file in (shipped("configs") / "receivers").glob("*.yaml"))
BARE = {
    "name": "test", "source": "none", "pseudorange_sigma": "2 m", "range_rate_sigma": "0.1 m/s",
    "solution": {"kind": "direct", "position_sigma": "2 m", "velocity_sigma": "0.1 m/s"},
    "clock": {"h0": 0.0, "h_minus2": 0.0},
}  # fmt: skip


def shipped_receiver(name):
    folder = shipped("configs")
    node, mistakes = expand(tree.read(folder / "receivers" / f"{name}.yaml"), ReceiverCard, Shelf((folder,)))
    assert mistakes == []
    return ReceiverCard.model_validate(tree.plain(node))


@pytest.mark.parametrize("name", NAMES)
def test_a_shipped_receiver_reads_and_reads_back(name):
    card = shipped_receiver(name)
    assert ReceiverCard.model_validate(card.model_dump(mode="json")) == card
    assert card.source


def test_the_four_patches_stand_across_the_axis_a_right_angle_apart():
    # Canepa and Servidia, section 6.1 and figure 9
    card = shipped_receiver("l1_four_patch")
    axes = np.array([antenna.boresight for antenna in card.antennas])
    np.testing.assert_array_equal(axes[:, 0], 0.0)
    np.testing.assert_array_equal(np.sum(axes * np.roll(axes, 1, axis=0), axis=1), 0.0)
    np.testing.assert_array_equal(axes, -np.roll(axes, 2, axis=0))
    assert card.mask == pytest.approx(np.radians(10.0))
    assert card.mask_height == pytest.approx(10.0 * 7518.8)


def test_without_antennas_the_one_lever_is_the_receivers():
    assert ReceiverCard(**BARE, lever_b=("1 m", "0 m", "2 m")).lever_arms == ((1.0, 0.0, 2.0),)
    antenna = {"name": "a", "lever_b": ["3 m", "0 m", "0 m"], "pattern": {"kind": "cosine", "peak": "5 dBi"}}
    card = ReceiverCard(**BARE, lever_b=("1 m", "0 m", "2 m"), antennas=[antenna, antenna | {"name": "b"}])
    assert card.lever_arms == ((3.0, 0.0, 0.0),) * 2


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"loops": {}}, "loops need a link"),
        ({"mask_height": "0 m"}, "greater than 0"),
        ({"latency_sigma": "-1 ms"}, "greater than or equal to 0"),
    ],
)
def test_a_receiver_that_makes_no_sense_is_refused(changes, message):
    with pytest.raises(ValidationError, match=message):
        ReceiverCard(**BARE, **changes)
