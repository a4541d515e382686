"""Weights of the experts of a contact map, and its uncertainty; reasons: `foretouch.identification.ContactMap`."""

from __future__ import annotations

import math

from foretouch.core.compiling import inlined, squared
from foretouch.identification.conditioning.air import SURE
from foretouch.identification.conditioning.kernel import PEAK_SHARE
from foretouch.identification.contact_map.state import Bank
from foretouch.identification.exact.belief import FIRST_ERROR, LEARNING_TIME, YOUNG
from foretouch.models.contact_map.kernel import experts
from foretouch.models.contact_map.layout import CLEAR, EXPERTS, STUCK, Map

LONGEST_HORIZON = 0.3
"""Largest delay of the predictions on which experts are scored [s]: over longer ones they are too much alike. Changes
are looked for in predictions of this age."""
RING_PERIOD = LONGEST_HORIZON / 15.0
"""Time between two snapshots of the map, and for which assumed errors before a sample is learnt count [s]."""
PENALTY = 1.2
"""Factor on the error of the law, and of the fine map against the coarse one: each has to be clearly better, for where
it is not right it is far off."""
NEEDED = 0.02  # Least error of the coarse map, relative to the peak, with which the fine one is needed


@inlined
def score(bank: Bank, snapshot: Map, sample: tuple[float, float, float], contact: bool, period: float) -> None:
    """Score an older map on a sample, expert by expert; the errors determine weights and doubt.

    Args:
        bank: The state; its `values` are the features of the sample.
        snapshot: The older map.
        sample: Position from the origin [m], velocity [m/s], force [N].
        contact: The conditioner's judgement.
        period: Time since the previous sample [s].
    """
    position, velocity, force = sample
    notes = bank.notes[0]
    law, coarse, fine, mixed = experts(snapshot, bank.values, position, velocity, bank.memory[STUCK], True)
    pulls = snapshot.pull > 0.0 and min(mixed, force) < -PEAK_SHARE * notes.peak
    if not (contact or pulls or mixed > PEAK_SHARE * notes.peak) or not notes.peak > 0.0:
        return
    fading, shares = math.exp(-period / LEARNING_TIME), bank.map[0].shares
    known = shares[1] + shares[2]
    maps = coarse + (shares[2] / known * (fine - coarse) if known > 0.0 else 0.0)
    notes.scores[0] = notes.scores[0] * fading + period * squared(law - force)
    notes.scores[1] = notes.scores[1] * fading + period * squared(maps - force)
    notes.scored = notes.scored * fading + period
    # A force is uncertain by a part of itself, and no less than by that of a clear force.
    least = CLEAR * notes.peak
    notes.errors = notes.errors * fading + period * abs(mixed - force) / math.sqrt(least * least + mixed * mixed)
    doubt = (notes.errors + YOUNG * FIRST_ERROR) / (notes.scored + YOUNG)
    set_doubt(bank.map[0], doubt, least)


@inlined
def set_doubt(learnt: Map, doubt: float, least: float) -> None:
    """Set the standard deviation of late predictions from the mean of their absolute errors.

    Args:
        learnt: Written.
        doubt: That mean, each relative to its force and the least one together.
        least: Force to a part of which each is uncertain [N].
    """
    variance = 0.5 * math.pi * doubt * doubt  # as of a Gaussian
    learnt.uncertainty[0], learnt.uncertainty[1] = variance * least * least, variance


@inlined
def watch(bank: Bank, snapshot: Map, sample: tuple[float, float, float], contact: bool, period: float) -> None:
    """Note for how long the predictions of an older map have been wrong by far more than usual; as `score`."""
    position, velocity, force = sample
    notes = bank.notes[0]
    mixed = experts(snapshot, bank.values, position, velocity, bank.memory[STUCK], True)[3]
    if not (contact or max(mixed, force) > PEAK_SHARE * notes.peak):
        return
    expected = SURE * SURE * (snapshot.uncertainty[0] + snapshot.uncertainty[1] * mixed * mixed)
    # At its foot a press may be a little elsewhere.
    wrong = squared(mixed - force) > max(expected, squared(CLEAR * notes.peak))
    if not wrong:
        notes.wrong.time = notes.wrong.product = notes.wrong.square = 0.0
        return
    notes.wrong.time += period
    notes.wrong.product += period * mixed * force
    notes.wrong.square += period * mixed * mixed


@inlined
def trust(wrong: float) -> float:
    """Weight of an expert before they sum to one, of its mean squared error [N^2]."""
    fourth = squared(wrong + 1e-12)
    return float(1.0 / (fourth * fourth))


@inlined
def fine_share(bank: Bank) -> float:
    """Weight of the fine map between the two maps: what the coarse one cannot resolve it learns wrong at once."""
    present, least = bank.notes[0].present, NEEDED * bank.notes[0].peak
    if bank.absent[1] == 0 and present.coarse < least * least * present.time:
        return 0.0
    coarse = 0.0 if bank.absent[1] > 0 else trust(present.coarse)
    fine = 0.0 if bank.absent[2] > 0 else trust(present.fine * squared(PENALTY))
    return fine / (coarse + fine) if coarse + fine > 0.0 else 0.0


@inlined
def allot(bank: Bank) -> None:
    """Set the weights of the experts from their scores and the assumed first errors."""
    learnt, notes, weights = bank.map[0], bank.notes[0], bank.map[0].shares
    first = max(YOUNG * math.exp(-notes.contact / YOUNG), 1e-9)  # for nothing may have been scored yet
    assumed = squared(FIRST_ERROR * notes.peak)
    # A law that is right describes what it learns at once, which a map does whether it is right or not.
    law = (notes.present.law + RING_PERIOD * assumed) / (notes.present.law_time + RING_PERIOD)
    maps = assumed * (0.25 if bank.changes > 0 else 1.0)
    law = trust((notes.scores[0] + first * law) / (notes.scored + first) * squared(PENALTY))
    maps = trust((notes.scores[1] + first * maps) / (notes.scored + first))
    law = 0.0 if bank.absent[0] > 0 or not learnt.law[0] > 0.0 else law
    maps = maps if bank.absent[1] == 0 or bank.absent[2] == 0 or law == 0.0 else 0.0
    share = fine_share(bank)
    if share > 0.0:  # a law is at the mercy of the surface there
        law = min(law * (1.0 - share), maps)
    law /= law + maps
    maps, kept = 1.0 - law, 0.0
    weights[0], weights[1], weights[2] = law, maps * (1.0 - share), maps * share
    for k in range(EXPERTS):
        weights[k] = weights[k] if weights[k] > PEAK_SHARE else 0.0
        kept += weights[k]
    for k in range(EXPERTS):
        weights[k] /= kept
