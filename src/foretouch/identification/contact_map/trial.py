"""A recording that is learnt from and predicted, compiled: `foretouch.identification.predict` without Python."""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, kernel
from foretouch.identification.conditioning.kernel import Conditioning
from foretouch.identification.contact_map.kernel import LEARNT, Learning, learn_raw
from foretouch.identification.contact_map.scores import LONGEST_HORIZON
from foretouch.identification.contact_map.state import Bank
from foretouch.identification.exact.belief import FEWEST_UPDATES
from foretouch.models.contact_map.kernel import numbers_of
from foretouch.models.contact_map.layout import SIZE, Map
from foretouch.models.contact_map.wire import shrink
from foretouch.models.law_kernel import MAP, NO_NUMBERS, NOTHING
from foretouch.models.predictor_kernel import Prediction, adopt, catch_up, update

_adopt, _shrink, _catch_up, _update = adopt.function, shrink.function, catch_up.function, update.function

RING_ROOM = 1024  # Samples of the newest 50 ms for which there is room


class Trial(Record):
    """A learner, and what predicts from its models."""

    conditionings: Annotated[NDArray[Any], Conditioning, 1]
    rings: Annotated[NDArray[Any], float, (5, RING_ROOM)]
    learnings: Annotated[NDArray[Any], Learning, 1]
    banks: Annotated[NDArray[Any], Bank, 1]
    predictions: Annotated[NDArray[Any], Prediction, 1]
    learnt: int  # number of samples that were learnt from
    stale: bool = True  # whether what was learnt is newer than the model
    sent: Annotated[NDArray[Any], Map, 1]  # the model, with the numbers of 32 bits that a network carries
    count: int  # of them
    numbers: Annotated[NDArray[Any], np.float32, SIZE]


@kernel("(Trial, f8)")
def expect(trial: Trial, delay: float) -> None:
    """Score experts on predictions of this delay [s], before the first sample."""
    trial.banks[0].horizon = min(max(delay, 0.0), LONGEST_HORIZON)


@kernel("(Trial, f8, f8, f8)")
def learn(trial: Trial, time: float, position: float, force: float) -> None:
    """Learn from a sample: its time [s], position [m] and the sensor's force [N]."""
    conditioner = trial.conditionings, trial.rings
    raw = time, position, force
    code, news = learn_raw(trial.banks, None, conditioner, trial.learnings, raw, 0.0, False)
    trial.stale = trial.stale or news or code >= LEARNT
    trial.learnt += 1


@kernel("f8(Trial, f8, f8)")
def foretell(trial: Trial, time: float, position: float) -> float:
    """The force at the next sample of the motion [N], from what was learnt so far.

    Args:
        trial: Written.
        time: Time of the sample [s].
        position: Its position [m].
    """
    bank, surface = trial.banks[0], trial.conditionings[0].surface
    notes, memory = bank.notes[0], numbers_of(bank.memory)
    known = not math.isnan(surface) and notes.updates - notes.begun >= FEWEST_UPDATES
    if known and trial.stale:
        maps = bank.remembered.shown if bank.coarse.traced > 0 else bank.map
        trial.count, trial.stale = _shrink(maps, trial.sent, trial.numbers), False
    if trial.learnt > 0 and known and trial.count > 0:
        _adopt(trial.predictions, MAP, NO_NUMBERS, trial.sent, memory, surface, trial.learnt, 0, 0)
    elif trial.learnt > 0:
        _adopt(trial.predictions, NOTHING, NO_NUMBERS, trial.sent, memory, 0.0, -1, 0, 0)
    _catch_up(trial.predictions)
    return float(_update(trial.predictions, time, position, math.nan))


def make_trial(conditioning: NDArray[np.void], bank: NDArray[np.void]) -> NDArray[Any]:
    """A fresh trial, of the records of a fresh conditioner and a fresh `ContactMap`."""
    return Trial.new(conditionings=conditioning, banks=bank)
