"""Weights of the experts of a contact map, and its uncertainty; reasons: `foretouch.identification.ContactMap`."""

from __future__ import annotations

import math

from foretouch.core.compiling import inlined
from foretouch.identification.contact_map.state import Bank
from foretouch.models.contact_map.kernel import experts, uncertainty
from foretouch.models.contact_map.layout import EXPERTS, SPEED, UNCERTAINTIES, Map

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
UNCERTAINTY_TIME = 5.0  # Time constant with which late errors fade [s]
LEAST_UNCERTAINTY = 0.01  # Least standard deviation, relative to the peak force
FIRST_UNCERTAINTY = 0.25  # Standard deviation of a force before any is estimated, relative to the force
SPREAD_RATE = 0.01
OUTSIDE = 0.25
"""Fraction of errors beyond one standard deviation; less than a Gaussian's 0.32, for their tails are heavier, and two
standard deviations are to hold 95 % of them."""


_WIDER, _NARROWER = math.exp(SPREAD_RATE * (1.0 - OUTSIDE)), math.exp(-SPREAD_RATE * OUTSIDE)


@inlined
def score(bank: Bank, snapshot: Map, sample: tuple[float, float, float], contact: bool, period: float) -> None:
    """Score an older map on a sample, expert by expert; the errors determine the weights and the uncertainty.

    Args:
        bank: The state; its `values` are the features of the sample.
        snapshot: The older map.
        sample: Position from the origin [m], velocity [m/s], force [N].
        contact: The conditioner's judgement.
        period: Time since the previous sample [s].
    """
    position, velocity, force = sample
    parts, notes = bank.map[0].uncertainty, bank.notes[0]
    law, coarse, fine, mixed = experts(snapshot, bank.values, position, velocity, True)
    if not (contact or mixed > CONTACT_SHARE * notes.peak):
        return
    fading, forces = math.exp(-period / SCORE_TIME), (law, coarse, fine)
    for k in range(EXPERTS):
        notes.scores[k] = notes.scores[k] * fading + period * (forces[k] - force) ** 2
    notes.scored = notes.scored * fading + period
    # Uncertainty: squared errors as a constant and multiples of the squares of force and speed, by least squares.
    fading = math.exp(-period / UNCERTAINTY_TIME)
    squared, variance = (mixed - force) ** 2, uncertainty(bank.map[0], mixed, velocity)
    spread = notes.spread * (_WIDER if squared > variance else _NARROWER)
    notes.spread = spread = min(max(spread, 0.1), 10.0)
    scale_of, peak = spread * spread, notes.peak
    least = max((LEAST_UNCERTAINTY * peak) ** 2, 1e-12)
    scale = max(variance / scale_of, least)
    weight = 1.0 / (scale * scale)  # so that each counts by its information
    shapes = (1.0, mixed * mixed, (velocity / SPEED) ** 2)
    moments, targets = notes.moments, notes.targets
    for i in range(UNCERTAINTIES):
        fraction = weight * shapes[i]
        targets[i] = targets[i] * fading + fraction * squared
        for j in range(UNCERTAINTIES):
            moments[i, j] = moments[i, j] * fading + fraction * shapes[j]
    # None may be negative, or more than the peak: coordinate descent from the former values.
    inverse = 1.0 / scale_of
    for _ in range(3):
        for i in range(UNCERTAINTIES):
            if moments[i, i] > 0.0:
                rest = targets[i]
                for j in range(UNCERTAINTIES):
                    if j != i:
                        rest -= moments[i, j] * parts[j] * inverse
                largest = 1.0 if i == 1 else peak * peak
                parts[i] = min(scale_of * max(rest / moments[i, i], 0.0), largest)
    parts[0] = max(parts[0], least)


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
