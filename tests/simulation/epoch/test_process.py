"""A policy stands in one place: it acts in runs, in linear covariance and on the way back."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

# Rules of the one function that both engines call, in force from the second epoch on: no range rates, by the function
# that says which rows of the receiver a filter takes; no measurement at all, by the function itself, of a filter with a
# reference satellite and an altimeter, which the first rule does not reach.
# Not compiled: a rule can then be put in the place of another, and four seconds of flight take as long as that. The
# flight is short therefore, with few samples of the inertial unit and few steps of the covariance.
SCRIPT = """
import json
from types import FunctionType
import numpy as np
from lvnav_trade.simulation.epoch import process
from lvnav_trade.covariance.history import adjoint, covariance
from lvnav_trade.simulation.montecarlo import run_block
from tests.building import MATCHED, hop, loaded, prepare_hop, with_fields
from tests.both_engines.covering import ALTIMETER

BRIEF = loaded(MATCHED, "base.imu.rate=50 Hz", "base.filter.covariance_rate=2 Hz")

def shortened(scenario):
    prepared = prepare_hop(scenario, hop(4.0, 1.0))
    last = int(np.flatnonzero(prepared.schedule.epoch == 3)[0])
    schedule = type(prepared.schedule)(*(windows[: last + 1].copy() for windows in prepared.schedule))
    return prepared._replace(schedule=schedule)

def compute(prepared, source):
    history, block, back = covariance(prepared), run_block(prepared, 1, 0, 1), adjoint(prepared, 4.0, bin_seconds=1.0)
    put_in = back.contribution[3, back.sources.index(source)]
    sigma = float(history.formal_sigma[4, 3])
    return [block.n_row[0, :4].tolist(), history.n_row[:4].tolist(), put_in.tolist(), sigma]

prepared, found, present = shortened(BRIEF), {}, process.is_present
found["usual"] = compute(prepared, "range-rate noise")
process.is_present = lambda delayed, model, epoch, channel: (
    present(delayed, model, epoch, channel) and (epoch == 0 or channel % 2 == 0)
)
found["policy"] = compute(prepared, "range-rate noise")
process.is_present = present

def process_at_first(work, parts, case, joint, open_loop, sensors, rules, epoch):
    if epoch == 0:
        process_as_usual(work, parts, case, joint, open_loop, sensors, rules, epoch)

changes = {"filter.measurements": ["pseudorange", "range_rate", "altitude"], "filter.clock": "differenced"}
prepared = shortened(with_fields(BRIEF, sensors={"altitude": ALTIMETER}, **changes))
found["all usual"] = compute(prepared, "range-rate noise")
process.process_as_usual = FunctionType(process.process_epoch.__code__, vars(process))
process.process_epoch.__code__ = process_at_first.__code__  # whoever has imported it gets the rule
found["all policy"] = compute(prepared, "range-rate noise")
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def found(root):
    given = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(root)}
    told = subprocess.run(
        [sys.executable, "-c", SCRIPT], env=given, cwd=root, capture_output=True, text=True, check=True
    )
    return json.loads(told.stdout)


def test_a_policy_that_is_added_once_acts_in_both_engines(found):
    usual, policy = found["usual"], found["policy"]
    assert usual[0] == usual[1]
    assert policy[0] == policy[1] == [usual[0][0], *(n // 2 for n in usual[0][1:])]
    assert policy[3] > 1.01 * usual[3]


def test_and_in_the_backward_pass(found):
    usual, policy = found["usual"][2], found["policy"][2]
    assert min(usual[:4]) > 0.0
    assert policy[0] > 0.0
    assert max(policy[1:]) == 0.0


def test_a_rule_of_the_epoch_itself_reaches_the_reference_satellite_and_the_sensors(found):
    usual, policy = found["all usual"], found["all policy"]
    assert usual[0] == usual[1]
    assert usual[0][0] % 2 == 1  # a pair for each satellite, and the altimeter
    assert policy[0] == policy[1] == [usual[0][0], 0.0, 0.0, 0.0]
    assert policy[3] > 1.01 * usual[3]
    assert min(usual[2][:4]) > 0.0
    assert policy[2][0] > 0.0
    assert max(policy[2][1:]) == 0.0
