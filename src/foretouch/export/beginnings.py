"""What a leader and a follower hold before their first tick, as Python starts them: settings are fixed with it."""

from __future__ import annotations

import pickle
import sys
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.devices import GRIPS
from foretouch.robot import make_material
from foretouch.robot.slide import make_slide
from foretouch.session.safety.safety import Safety, SafetyLimits
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.setup import make_session_robot
from foretouch.session.steps import follower, leader
from foretouch.session.steps.delaying import Delaying
from foretouch.session.steps.following import Following

PRESSED = ("foam-measured", "hand", "sponge", "hunt-crossley", "kelvin-voigt", "bone")
"""Materials that are exported: those whose law is compiled (`foretouch.robot.materials.pressed`)."""

GRIP = "normal"  # of the simulated hand
LEAST = 5  # Words of a copy, at least: telling which so few are takes no more room
LOOKED_AT = 40  # Newest places at which a repetition is looked for
NOTED = 200  # First words of a copy that later copies may begin at

MOST = (1 << 16) - 1
"""Most words that a piece tells, and most different ones that a record may have."""

OWN = 1  # Number of a process that has not been given one


def following_of(state: follower.State) -> NDArray[np.void]:
    """The record of a follower along a line that was started in Python, in which a contact map learns."""
    conditioning, rings = state.learner.conditioner.memory
    parts: dict[str, Any] = {
        "followers": state.memory,
        "conditionings": conditioning,
        "learnings": state.learner.learning,
        "banks": state.learner.estimator.states,  # type: ignore[attr-defined]
        "hearings": state.records,
        "watches": state.watch._first,
    }
    made = Following.new(**parts)
    made["rings"][0, :, : rings.shape[1]] = rings
    return made


class Beginning(NamedTuple):
    """A function of C that writes what a new struct holds.

    Attributes:
        name: In C, without the prefix.
        struct: What the struct is called.
        record: What it writes, an array of one record.
        text: What is said of it.
        simulated: Whether it is for where robots and hands are simulated.
    """

    name: str
    struct: str
    record: NDArray[np.void]
    text: str
    simulated: bool = False


def beginnings(settings: SessionSettings) -> list[Beginning]:
    """All that begin a struct of C."""
    robot, _ = make_session_robot(settings)
    felt = leader.start(settings, epoch=OWN, device=settings.device).records
    unfelt = leader.start(settings, epoch=OWN).records
    followed = following_of(follower.start(robot.specification, settings, run=OWN))
    memory = Safety(SafetyLimits(), SAMPLE_PERIOD).memories
    return [
        Beginning("leader_init", "leader", felt, "A leader whose hand holds the device of the settings and feels it."),
        Beginning("leader_unfelt_init", "leader", unfelt, "A leader whose device moves only, such as a mouse."),
        Beginning("follower_init", "follower", followed, "A follower that has heard nothing and learnt nothing yet."),
        Beginning("safety_init", "safety", memory, "Safety alone, with limits that are often right."),
        Beginning("safety_limits_init", "safety_limits", memory["limits"], "Limits that are often right."),
        *simulated(settings),
    ]


def simulated(settings: SessionSettings) -> Iterator[Beginning]:
    """What begins the structs of what is simulated: robot, hand, the baseline of a delayed force, and recordings."""
    for name in PRESSED:
        record, said = make_slide(name), make_material(name).description
        yield Beginning(f"slide_{name.replace('-', '_')}_init", "slide", record, f"A slide over: {said}.", True)
    held = leader.start(replace(settings, grip=GRIP), epoch=OWN).records
    yield Beginning("leader_held_init", "leader", held, "A leader whose device is held by a simulated hand.", True)
    hand, _ = GRIPS[GRIP].holds(settings.device)
    about = "A hand at rest at 0, with a normal grip on the device of the settings."
    yield Beginning("hand_init", "hand", hand, about, True)
    yield Beginning("delaying_init", "delaying", Delaying.new(), "Before the first tick.", True)


def main() -> None:
    """Write the beginnings for the settings that the input holds to the output."""
    sys.stdout.buffer.write(pickle.dumps(beginnings(pickle.loads(sys.stdin.buffer.read()))))


class Packed(NamedTuple):
    """A record in fewer words.

    Attributes:
        words: Its different words of 64 bits.
        pieces: Numbers of 16 bits. Of each piece, how many words it tells, how many are copied behind them, and how far
            back they are, the latter two in two numbers each, the lower first; then which words it tells. A copy may
            overlap what it writes, so that equal words in a row are one.
    """

    words: list[int]
    pieces: list[int]


def packed(first: NDArray[np.void]) -> Packed:
    """A record in fewer words: what repeats is copied from earlier in it, as in Lempel and Ziv (1977)."""
    clean = np.zeros(1, first.dtype)  # what lies between two fields is anything, and is not copied
    clean[:] = first
    words: list[int] = np.frombuffer(clean.tobytes(), "<u8").tolist()
    places = {word: place for place, word in enumerate(sorted(set(words)))}
    pieces: list[int] = []
    told: list[int] = []
    for begin, end, back in _pieces(words):
        if not back:
            told += [places[word] for word in words[begin:end]]
        if back or len(told) == MOST:
            pieces += _piece(told, end - begin if back else 0, back)
            told = []
    return Packed(list(places), pieces + _piece(told, 0, 0) if told else pieces)


def _piece(told: list[int], length: int, back: int) -> list[int]:
    return [len(told), length & MOST, length >> 16, back & MOST, back >> 16, *told]


def _pieces(words: list[int]) -> list[tuple[int, int, int]]:
    """Begin and end of each piece, and how far back it is copied from; 0 for one that is told word by word."""
    known: dict[tuple[int, ...], list[int]] = defaultdict(list)
    pieces, at = [], 0
    while at < len(words):
        places = known[tuple(words[at : at + LEAST])][-LOOKED_AT:]
        length, place = max(((_same(words, place, at), place) for place in places), default=(0, 0))
        copies = length >= LEAST
        end = at + (length if copies else 1)
        pieces.append((at, end, at - place if copies else 0))
        for noted in range(at, min(end, at + NOTED)):
            known[tuple(words[noted : noted + LEAST])].append(noted)
        at = end
    return pieces


def _same(words: list[int], one: int, other: int) -> int:
    """How many words are the same from two places on."""
    length = 0
    while other + length < len(words) and words[one + length] == words[other + length]:
        length += 1
    return length
