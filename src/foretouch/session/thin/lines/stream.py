"""Numbers that change in every tick, said by a packet only where their straight continuation would be wrong.

Each end keeps the same straight lines, one for each number: its value at the tick of the newest packet, and its slope.
The sender compares them with what there is, and says new ones where a number leaves the bound that was given for it
(dead reckoning, as IEEE 1278.1 has it for moving bodies; the deadband of IEEE 1918.1.1 is the case without a slope).
The receiver goes on along the lines in every tick, as long as the next packet may take, and no longer.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, compiled, kernel

MOST = 16  # Numbers for which there is room
WINDOW = 8
"""Newest ticks of which the slope is taken, the least squares' one. Fewer see the steps of an encoder, more lag behind:
of 4, 8, 16 and 30 it needs the fewest packets, by little."""

LONGEST_GAP = 50  # Ticks between two packets at most: what is silent for longer is not there
REACH = 100  # Ticks for which lines go on without a packet: the longest gap twice, so that one may be lost
RUN_ON = 5e-3
"""Way that a line of a position may go on after its newest packet [m], so that no robot runs far on after a link broke;
with a fast hand packets come oftener than every `LONGEST_GAP`."""
SOONER = 0.5  # Part of the receiver's reach after which the sender speaks at the latest
JUMP = 20.0  # Multiple of its bound from which on an error is a step, behind which slopes are taken anew
ENOUGH = 0.5  # Part of its bound from which on an error is worth a line in a packet that is said anyway
KEPT = 0.7  # Part of the step to a new line that is left after a tick
LOOK_BACK = 250  # Ticks over which the least lateness is taken
SPREAD = 5  # Ticks from one that is left out to the next
DENOMINATOR = WINDOW * (WINDOW * WINDOW - 1) / 12.0  # Sum of the squared distances of the ticks from their mean


class Lines(Record):
    """Straight lines of some numbers from a tick on, as both ends know them."""

    count: int  # of numbers
    known: bool
    tick: int  # from which they go
    values: Annotated[NDArray[Any], float, MOST]  # there; NaN where one is not known
    slopes: Annotated[NDArray[Any], float, MOST]  # [1/tick]
    positions: int  # of them, the first, are positions that a robot goes to


class Said(Record):
    """State of the sender."""

    lines: Lines
    bounds: Annotated[NDArray[Any], float, MOST]  # largest error of each line
    shares: Annotated[NDArray[Any], float, MOST]  # and the part of the number itself by which it is larger
    steps: Annotated[NDArray[Any], float, MOST]  # in which values are said
    slope_steps: Annotated[NDArray[Any], float, MOST]  # in which slopes are said [1/tick]
    newest: Annotated[NDArray[Any], float, (WINDOW, MOST)]  # numbers of the newest ticks, a ring
    noted: int  # ticks noted since the numbers began
    tick: int  # newest
    again: int  # those whose lines are said once more, a bit for each: the packet may be lost
    turn: int  # number that is said whether or not it needs to be: what was lost twice comes back so


class Heard(Record):
    """State of the receiver."""

    lines: Lines
    steps: Annotated[NDArray[Any], float, MOST]  # in which values are said
    slope_steps: Annotated[NDArray[Any], float, MOST]  # in which slopes are said [1/tick]
    apart: Annotated[NDArray[Any], float, MOST]  # what is left of the step to the newest line
    tick: int  # newest that was given
    lateness: int  # least of packets since that was looked at, in ticks
    looked: int  # ticks since
    slow: int  # lateness of then: as many ticks less one are left out
    given: Annotated[NDArray[Any], float, MOST]  # numbers of the newest tick


class Number(NamedTuple):
    """How exactly a number is said: `bound` plus `share` of itself is the largest error, `step` the resolution."""

    bound: float
    step: float
    slope_step: float
    share: float = 0.0


POSITION = Number(bound=5e-5, step=2e-6, slope_step=1e-7)
"""A position that a robot goes to [m]: within 0.05 mm, in steps of 2 um, to 16 m from the origin; its speed in steps
of 0.1 mm/s, up to 3.2 m/s."""
PLACE = Number(bound=2e-4, step=2e-6, slope_step=1e-7)  # One that is only shown [m]
FORCE = Number(bound=0.05, step=2e-3, slope_step=1e-3, share=0.05)
"""A force [N]: within 0.05 N and a twentieth of itself, of which people tell a tenth."""


def said(numbers: tuple[Number, ...], positions: int) -> NDArray[Any]:
    """State of a sender of these numbers, of which the first are positions that a robot goes to."""
    made = _begun(Said.new(), numbers, positions)
    for at, one in enumerate(numbers):
        made["bounds"][0, at], made["shares"][0, at] = one.bound, one.share
    return made


def heard(numbers: tuple[Number, ...], positions: int) -> NDArray[Any]:
    """State of a receiver of these numbers, of which the first are positions that a robot goes to."""
    return _begun(Heard.new(), numbers, positions)


def _begun(made: NDArray[Any], numbers: tuple[Number, ...], positions: int) -> NDArray[Any]:
    """The state with lines of which nothing is known, and the steps in which they are said."""
    lines = made["lines"]
    lines["count"], lines["positions"], lines["values"] = len(numbers), positions, math.nan
    for at, one in enumerate(numbers):
        made["steps"][0, at], made["slope_steps"][0, at] = one.step, one.slope_step
    return made


@kernel("i8(Lines)")
def reach_of(lines: Lines) -> int:
    """Ticks for which the lines may go on."""
    fastest = 0.0
    for at in range(lines.positions):
        fastest = max(fastest, abs(lines.slopes[at]))
    return int(min(max(RUN_ON / fastest, 5.0), float(REACH))) if fastest > 0.0 else REACH


_reach_of = reach_of.function


@compiled
def _error(said: Said, i: int) -> float:
    """Error of a line in the newest tick, as a multiple of its bound; infinite where it is not known."""
    lines, number = said.lines, said.newest[said.tick % WINDOW, i]
    if math.isnan(lines.values[i]):
        return math.inf
    wrong = abs(lines.values[i] + lines.slopes[i] * (said.tick - lines.tick) - number)
    return float(wrong / (said.bounds[i] + said.shares[i] * abs(number)))


MISSING, NOTHING, WORTH, SOON, DUE = range(-1, 4)
"""Whether a packet is to be said now: not known, for numbers are missing; no; yes, for a line is wrong; yes, for the
lines will soon have gone on as far as they may; and in any case, as the sign of life."""


@kernel("i8(Said[::1], i8, UniTuple(f8, 16))")
def note(saids: NDArray[np.void], tick: int, numbers: tuple[float, ...]) -> int:
    """Note the numbers of a tick: `NOTHING`, `WORTH`, `SOON` or `DUE`; `MISSING`, and none noted, if one is not finite.

    Args:
        saids: An array of one `Said`; written.
        tick: Of the sender, which counts them.
        numbers: As many as there are; the rest is not read.
    """
    said, lines = saids[0], saids[0].lines
    for i in range(lines.count):
        if not math.isfinite(numbers[i]):
            return MISSING
    if tick != said.tick + 1:  # ticks are missing: their slope is not known, and the lines do not go on over them
        said.noted = 0
        for i in range(lines.count):
            lines.values[i] = math.nan
    said.tick, worst = tick, 0.0
    for i in range(lines.count):
        said.newest[tick % WINDOW, i] = numbers[i]
        worst = max(worst, _error(said, i))
    said.noted = 1 if worst > JUMP else min(said.noted + 1, WINDOW)
    gone = tick - lines.tick
    if gone < 0 or gone >= LONGEST_GAP:
        return DUE
    if gone >= SOONER * _reach_of(lines):
        return SOON
    return WORTH if worst > 1.0 else NOTHING


@compiled
def _slope(said: Said, i: int) -> float:
    """Of the newest ticks, by least squares [1/tick]; 0 where they are too few."""
    slope = 0.0
    if said.noted == WINDOW:
        for back in range(WINDOW):
            slope += (0.5 * (WINDOW - 1) - back) * said.newest[(said.tick - back) % WINDOW, i]
    return slope / DENOMINATOR


@compiled
def _chosen(said: Said, most: int) -> int:
    """Which numbers are said, a bit for each: that whose turn it is, and those that are worth it, in turn."""
    chosen, count = 0, said.lines.count
    said.turn = (said.turn + 1) % count
    for step in range(count):
        i = (said.turn + step) % count
        if most > 0 and (step == 0 or said.again >> i & 1 or _error(said, i) > ENOUGH):
            chosen |= 1 << i
            most -= 1
    return chosen


@kernel("i8(Said[::1], i8[::1], i8)")
def say(saids: NDArray[np.void], words: NDArray[np.int64], most: int) -> int:
    """Begin new lines at the newest tick: of those that are worth it as they are said, of the others as they go on.

    Args:
        saids: An array of one `Said`; written.
        words: Written, two for each number that is said: its value, of 24 bits, and its slope, of 16, in steps.
        most: How many numbers are said at most, 1 or more.

    Returns:
        Which numbers are said, a bit for each.
    """
    said, lines = saids[0], saids[0].lines
    gone, chosen, at = said.tick - lines.tick, _chosen(said, most), 0
    again = said.again & ~chosen
    for i in range(lines.count):
        if not chosen >> i & 1:
            lines.values[i] += lines.slopes[i] * gone
            continue
        again |= (_error(said, i) > ENOUGH) << i
        value, slope = said.newest[said.tick % WINDOW, i] / said.steps[i], _slope(said, i) / said.slope_steps[i]
        words[at] = min(max(round(value), -0x7FFFFF), 0x7FFFFF)
        words[at + 1] = min(max(round(slope), -0x7FFF), 0x7FFF)
        lines.values[i] = words[at] * said.steps[i]
        lines.slopes[i] = words[at + 1] * said.slope_steps[i]
        at += 2
    lines.tick, said.again = said.tick, again
    return chosen


@kernel("b1(Heard[::1], i8, i8, i8[::1])")
def take(heards: NDArray[np.void], tick: int, chosen: int, words: NDArray[np.int64]) -> bool:
    """Take the lines of a packet, if no newer ones are known; whether they were taken.

    Args:
        heards: An array of one `Heard`; written.
        tick: From which they go.
        chosen: Which numbers are said, a bit for each.
        words: As `say` writes them.
    """
    heard, lines = heards[0], heards[0].lines
    if lines.tick > 0 and tick <= lines.tick:
        return False
    follows, gone, at = heard.tick > 0 and abs(tick - heard.tick) <= REACH, tick - lines.tick, 0
    lost = gone > _reach_of(lines)  # so that a number that is not said now may have been said meanwhile
    lines.known = True
    for i in range(lines.count):
        if chosen >> i & 1:
            lines.values[i], lines.slopes[i] = words[at] * heard.steps[i], words[at + 1] * heard.slope_steps[i]
            at += 2
        else:
            lines.values[i] = math.nan if lost else lines.values[i] + lines.slopes[i] * gone
        lines.known = lines.known and math.isfinite(lines.values[i])
        here = lines.values[i] + lines.slopes[i] * (heard.tick - tick)
        heard.apart[i] = heard.given[i] - here if follows and math.isfinite(here) else 0.0
    heard.lateness = min(heard.lateness, heard.tick - tick)
    lines.tick = tick
    return True


@kernel("i8(Heard[::1])")
def go_on(heards: NDArray[np.void]) -> int:
    """The next tick, whose numbers are then in `Heard.given`; 0 where there is none.

    Ticks are given in the rhythm of the receiver. Where all packets of a while came late, the sender's are slower, and
    as many are left out, one now and then. Where one came early, those between are left out.

    Args:
        heards: An array of one `Heard`; written.
    """
    heard, lines = heards[0], heards[0].lines
    if not lines.known:
        return 0
    heard.looked += 1
    if heard.looked >= LOOK_BACK:
        heard.looked, heard.slow = 0, heard.lateness if heard.lateness < REACH else 0
        heard.lateness = REACH
    if heard.slow > 1 and heard.looked % SPREAD == 0:
        heard.slow -= 1
        return 0
    tick = max(heard.tick + 1, lines.tick)
    gone = tick - lines.tick
    if gone > _reach_of(lines):
        return 0
    heard.tick = tick
    for i in range(lines.count):
        heard.apart[i] *= KEPT
        heard.given[i] = lines.values[i] + lines.slopes[i] * gone + heard.apart[i]
    return int(tick)
