"""Weights of the experts of a contact map, and its uncertainty; reasons: `foretouch.identification.ContactMap`."""

from __future__ import annotations

import math

from foretouch.core.compiling import inlined
from foretouch.identification.contact_map.state import Bank
from foretouch.models.contact_map.kernel import experts
from foretouch.models.contact_map.layout import EXPERTS, Map

SCORE_TIME = 1.0  # Time constant in contact with which scores fade [s]
FIRST_ERRORS = (0.1, 0.2, 0.3)  # Relative errors of law, coarse and fine map that are assumed at first
FIRST_TIME = 0.1  # Time in contact for which the assumed first errors count [s]
PENALTIES = (1.2, 1.0, 1.0)
"""Factors on the experts' errors: the law has to be clearly better than the map, for it is right nowhere where it is
not right everywhere."""
SHARPNESS = 8.0  # Exponent of the inverse error in the weights, the fourth power of its square
LEAST_SHARE = 1e-3
FINE_DEPTH, COARSE_DEPTH = 4e-4, 3e-4
"""Depths [m] beyond which the fine map, and short of which the coarse map, has less weight."""

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
    law, coarse, fine, mixed = experts(snapshot, bank.values, position, velocity, True)
    if not (contact or mixed > CONTACT_SHARE * notes.peak):
        return
    fading, forces = math.exp(-period / SCORE_TIME), (law, coarse, fine)
    for k in range(EXPERTS):
        notes.scores[k] = notes.scores[k] * fading + period * (forces[k] - force) ** 2
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
    mixed = experts(snapshot, bank.values, position, velocity, True)[3]
    if not (contact or mixed > CONTACT_SHARE * notes.peak):
        return
    least, squared = CONTACT_SHARE * notes.peak, (mixed - force) ** 2
    scale = least * least + mixed * mixed
    wrong = squared > max((WRONG * notes.doubt) ** 2 * scale, (LEAST_WRONG * notes.peak) ** 2)
    notes.wrong_for = notes.wrong_for + period if wrong else 0.0


@inlined
def allot(bank: Bank) -> None:
    """Set the weights of the experts from their scores, the assumed first errors, and the resolution of their knots."""
    learnt, notes = bank.map[0], bank.notes[0]
    first = max(FIRST_TIME * math.exp(-notes.contact / FIRST_TIME), 1e-9)  # for nothing may have been scored yet
    depth = max(learnt.reached + learnt.origin, 1e-6)
    weights, total = learnt.shares, 0.0
    for k in range(EXPERTS):
        squared = (notes.scores[k] + first * (FIRST_ERRORS[k] * notes.peak) ** 2) / (notes.scored + first)
        penalty = PENALTIES[k]
        if k == 1:
            penalty *= max(1.0, COARSE_DEPTH / depth)
        elif k == 2:
            penalty *= max(1.0, depth / FINE_DEPTH)
        unknown = bank.absent[k] > 0 or (k == 0 and not learnt.law[0] > 0.0)
        fourth = (squared * penalty**2 + 1e-12) ** 2
        weights[k] = 0.0 if unknown else 1.0 / (fourth * fourth)
        total += weights[k]
    if not total > 0.0:  # only the law, and it is not known yet
        weights[1] = total = 1.0
    kept = 0.0
    for k in range(EXPERTS):
        weights[k] = weights[k] / total if weights[k] > LEAST_SHARE * total else 0.0
        kept += weights[k]
    for k in range(EXPERTS):
        weights[k] /= kept
