"""A trace of one's own link: questions as large and as often as a session's messages, and when each answer came."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foretouch.doctor.network import FILLED, ROLE, Received, filling, wait
from foretouch.errors import LinkError
from foretouch.link import ZenohLink
from foretouch.messages import VERSION, Command, Message, encode
from foretouch.session import SAMPLE_PERIOD
from foretouch.session.runners.loop_timer import LoopTimer, steady

COMMAND = len(encode(Command(VERSION, 10**6, 10**15, 0.0123, 10**4, True, "operator@machine", 2**62, (), 10**6, 2**62)))
"""Size of a command [bytes], from when a session has been running for a while."""

TELEMETRY, MODEL, MODEL_EVERY = 90, 630, 20
"""Size of a telemetry message of a session along a line, and of a contact map [bytes], and how many of the first there
are for each of the second."""

QUESTION = 45  # Size of a question without filling [bytes]
MOST_SECONDS = 600.0  # The longest measurement [s]
MEETING = 10.0  # Longest time until the other machine is heard [s]
LAST_PATIENCE = 10.0  # Longest time for which the last answers are waited for [s]


@dataclass(frozen=True, eq=False)
class Measured:
    """What became of each question.

    Attributes:
        sent: When each was sent, since the first [s]; shape (n,).
        answered: When its answer came, by the same clock [s]; NaN where none came.
    """

    sent: NDArray[np.float64]
    answered: NDArray[np.float64]

    @property
    def lost(self) -> int:
        """Questions without an answer."""
        return int(np.isnan(self.answered).sum())

    def lines(self, title: str) -> Iterator[str]:
        """The lines of a file of them, which `foretouch.link.read_trace` reads.

        One without an answer counts as late as the next that has one: nothing came meanwhile. Those behind the last
        answer are left out.
        """
        lost = np.isnan(self.answered)
        known = np.where(lost, np.inf, self.answered)
        arrival = np.minimum.accumulate(known[::-1])[::-1]
        kept = np.isfinite(arrival)
        yield f"# {title}"
        yield f"# {self.lost} of {self.sent.size} without an answer: as late as the next that has one"
        yield "time_s,round_trip_s,lost"
        for sent, came, without in zip(self.sent[kept], arrival[kept], lost[kept], strict=True):
            yield f"{sent:.6f},{came - sent:.6f},{int(without)}"


def measure(
    open_link: Callable[[Callable[[Message], None]], ZenohLink],
    seconds: float,
    *,
    should_stop: Callable[[], bool],
    progress: Callable[[float], None],
) -> Measured:
    """Ask 1,000 times a second, as a session's leader sends commands, for a time [s].

    The questions are hellos that are filled to the size of a command, their answers to that of telemetry, each
    twentieth to that of a contact map: a command itself would be obeyed by a robot that listens there.

    Args:
        open_link: Opens the link, given what is to be called with each message.
        seconds: How long [s].
        should_stop: Asked in every tick.
        progress: Called now and then with the time since the begin [s].

    Raises:
        LinkError: Nobody answers there, or a session runs there, which would be disturbed.
        PeerVersionError: The peer speaks another version.
    """
    received, sent = Received(), list[int]()
    with open_link(received.take) as link:
        met = received.meet(link, MEETING)
        if met and received.roles - {ROLE}:
            who = ", ".join(sorted(received.roles - {ROLE}))
            raise LinkError(f"a session runs there ({who}), which would be disturbed: end it, or measure before it")
        if not received.present:
            raise LinkError("nobody answers there: run `foretouch network answer` on the other machine")
        question = filling(COMMAND - QUESTION)
        telemetry, model = (question | {FILLED: str(size - QUESTION)} for size in (TELEMETRY, MODEL))
        timer, ticks = LoopTimer(SAMPLE_PERIOD), round(seconds / SAMPLE_PERIOD)
        with steady():
            for number in range(1, ticks + 1):
                timer.wait()
                if should_stop() or timer.missed + number > ticks:
                    break
                sent.append(received.ask(link, number, model if number % MODEL_EVERY == 0 else telemetry))
                if number % round(1.0 / SAMPLE_PERIOD) == 0:
                    progress(number * SAMPLE_PERIOD)
        wait(lambda: len(received.answers) >= len(sent), LAST_PATIENCE)
        answers = dict(received.answers)
    if not answers:
        raise LinkError(f"{len(sent)} questions, no answer: run `foretouch network answer` anew on the other machine")
    came = np.array([answers.get(str(number), np.nan) for number in range(1, len(sent) + 1)])
    return Measured((np.array(sent) - sent[0]) * 1e-9, (came - sent[0]) * 1e-9)
