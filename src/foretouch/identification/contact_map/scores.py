"""Weights of the experts of a contact map, and its uncertainty; reasons: `foretouch.identification.ContactMap`."""

from __future__ import annotations

import math

from foretouch.core.compiling import inlined
from foretouch.identification.contact_map.state import Bank
from foretouch.models.contact_map.kernel import experts
from foretouch.models.contact_map.layout import EXPERTS, STUCK, Map

SCORE_TIME = 1.0  # Time constant in contact with which scores fade [s]
FIRST_ERROR = 0.2  # Relative error that is assumed at first, of maps half of it after a change: they go on
FIRST_TIME = 0.1  # Time in contact for which the assumed first late errors count [s]
ASSUMED_TIME = 0.02  # The same of errors before a sample is learnt [s]
LAW_PENALTY = 1.2
"""Factor on the law's error: it has to be clearly better than the maps, for it is right nowhere where it is not right
everywhere."""
FINE_PENALTY = 1.2  # The same for the fine map against the coarse one
NEEDED = 0.02  # Least error of the coarse map, relative to the peak, with which the fine one is needed
LEAST_SHARE = 0.05
CONTACT_SHARE = 0.05  # Fraction of the peak above which predictions are scored out of contact too
FIRST_DOUBT = 0.25  # Standard deviation of a late prediction, relative to its force, before any was scored
DOUBTS = 0.01, 1.0  # Its least and its largest value
DOUBT_RATE = 0.01  # Its change with each score, on average
OUTSIDE = 0.32  # Fraction of errors beyond one standard deviation, as of a Gaussian

WRONG = 3.0  # Standard deviations by which a late prediction is wrong where the material has changed
LEAST_WRONG = 0.1  # Least such error, relative to the peak: at its foot a press may be a little elsewhere


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
    pulls = snapshot.pull > 0.0 and min(mixed, force) < -CONTACT_SHARE * notes.peak
    if not (contact or pulls or mixed > CONTACT_SHARE * notes.peak):
        return
    fading, shares = math.exp(-period / SCORE_TIME), bank.map[0].shares
    known = shares[1] + shares[2]
    maps = coarse + (shares[2] / known * (fine - coarse) if known > 0.0 else 0.0)
    notes.scores[0] = notes.scores[0] * fading + period * (law - force) ** 2
    notes.scores[1] = notes.scores[1] * fading + period * (maps - force) ** 2
    notes.scored = notes.scored * fading + period
    # A force is uncertain by a part of itself, and no less than by that of the smallest force that counts.
    least, squared = CONTACT_SHARE * notes.peak, (mixed - force) ** 2
    scale = least * least + mixed * mixed
    beyond = 1.0 if squared > notes.doubt * notes.doubt * scale else 0.0
    doubt = notes.doubt * math.exp(DOUBT_RATE * (beyond - OUTSIDE))
    notes.doubt = doubt = min(max(doubt, DOUBTS[0]), DOUBTS[1])
    bank.map[0].uncertainty[0], bank.map[0].uncertainty[1] = (doubt * least) ** 2, doubt * doubt


@inlined
def watch(bank: Bank, snapshot: Map, sample: tuple[float, float, float], contact: bool, period: float) -> None:
    """Note for how long the predictions of an older map have been wrong by far more than usual; as `score`."""
    position, velocity, force = sample
    notes = bank.notes[0]
    mixed = experts(snapshot, bank.values, position, velocity, bank.memory[STUCK], True)[3]
    if not (contact or max(mixed, force) > CONTACT_SHARE * notes.peak):
        return
    least, squared = CONTACT_SHARE * notes.peak, (mixed - force) ** 2
    scale = least * least + mixed * mixed
    wrong = squared > max((WRONG * notes.doubt) ** 2 * scale, (LEAST_WRONG * notes.peak) ** 2)
    if not wrong:
        notes.wrong.time = notes.wrong.product = notes.wrong.square = 0.0
        return
    notes.wrong.time += period
    notes.wrong.product += period * mixed * force
    notes.wrong.square += period * mixed * mixed


@inlined
def trust(squared: float) -> float:
    """Weight of an expert before they sum to one, of its mean squared error [N^2]."""
    fourth = (squared + 1e-12) ** 2
    return float(1.0 / (fourth * fourth))


@inlined
def fine_share(bank: Bank) -> float:
    """Weight of the fine map between the two maps: what the coarse one cannot resolve it learns wrong at once."""
    present, least = bank.notes[0].present, NEEDED * bank.notes[0].peak
    if bank.absent[1] == 0 and present.coarse < least * least * present.time:
        return 0.0
    coarse = 0.0 if bank.absent[1] > 0 else trust(present.coarse)
    fine = 0.0 if bank.absent[2] > 0 else trust(present.fine * FINE_PENALTY**2)
    return fine / (coarse + fine) if coarse + fine > 0.0 else 0.0


@inlined
def allot(bank: Bank) -> None:
    """Set the weights of the experts from their scores and the assumed first errors."""
    learnt, notes, weights = bank.map[0], bank.notes[0], bank.map[0].shares
    first = max(FIRST_TIME * math.exp(-notes.contact / FIRST_TIME), 1e-9)  # for nothing may have been scored yet
    assumed = (FIRST_ERROR * notes.peak) ** 2
    # A law that is right describes what it learns at once, which a map does whether it is right or not.
    law = (notes.present.law + ASSUMED_TIME * assumed) / (notes.present.law_time + ASSUMED_TIME)
    maps = assumed * (0.25 if bank.changes > 0 else 1.0)
    law = trust((notes.scores[0] + first * law) / (notes.scored + first) * LAW_PENALTY**2)
    maps = trust((notes.scores[1] + first * maps) / (notes.scored + first))
    law = 0.0 if bank.absent[0] > 0 or not learnt.law[0] > 0.0 else law
    maps = maps if bank.absent[1] == 0 or bank.absent[2] == 0 or law == 0.0 else 0.0
    share = fine_share(bank)
    law, fine = law * (1.0 - share), maps * share
    weights[0], weights[1], weights[2] = law, maps - fine, fine
    total, kept = law + maps, 0.0
    for k in range(EXPERTS):
        weights[k] = weights[k] if weights[k] > LEAST_SHARE * total else 0.0
        kept += weights[k]
    for k in range(EXPERTS):
        weights[k] /= kept
