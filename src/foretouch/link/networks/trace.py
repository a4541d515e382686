"""What a network did to messages over time: a `NetworkTrace`, and a `Way`, one direction of a session over it."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STREAM_PERIOD = 1e-3  # Time between two messages of the stream that shows how long nothing comes [s]


@dataclass(frozen=True, eq=False)
class NetworkTrace:
    """Delays of messages, by the time at which they were sent.

    Nothing overtakes: a message that would is as late as the one before it. Where the delay grows faster than time
    passes, the network stood still, and what is sent between two rows comes with the later one; elsewhere the delay
    between two rows is interpolated.

    Args:
        name: Its name here, or its file.
        time: When each message was sent, from 0 on, growing [s]; shape (n,), 2 or more.
        measured: How long each was on its way [s]: a round trip, or one way; shape (n,).
        one_way: Whether that is one way.
        spacing: Shortest time between two messages of one kind that it takes [s]: what comes sooner is lost. 0 takes
            all.
        source: Where the numbers come from, in one sentence.
        licence: Under which they are published; "" for a file of the user's and for what is only described here.
    """

    name: str
    time: Array
    measured: Array
    one_way: bool = False
    spacing: float = 0.0
    source: str = ""
    licence: str = ""

    @cached_property
    def length(self) -> float:
        """After how long it begins again [s]: its last message, and the usual time between two."""
        return float(self.time[-1] + np.median(np.diff(self.time)))

    @cached_property
    def delay(self) -> Array:
        """Delay of each message one way [s].

        Half of a round trip that nothing disturbs. What a stall adds is not halved: it holds what is sent either way
        until it ends, and an answer that is sent after its end is held no more. Undisturbed is the shortest round trip
        of the messages that were sent while this one was on its way.
        """
        arrival = np.maximum.accumulate(self.time + self.measured)
        measured = arrival - self.time
        if self.one_way:
            return measured
        sent = np.searchsorted(self.time, arrival, side="right")
        undisturbed = [measured[index : max(end, index + 1)].min() for index, end in enumerate(sent.tolist())]
        return np.asarray(measured - 0.5 * np.array(undisturbed))

    @property
    def usual_round_trip(self) -> float:
        """Twice the median delay one way [s]."""
        return 2.0 * float(np.median(self.delay))

    @cached_property
    def corners(self) -> tuple[Array, Array]:
        """Times and one-way delays between which the delay is linear [s]: the rows, and the beginnings of stalls."""
        arrival = np.maximum.accumulate(self.time + self.delay)
        still = np.flatnonzero(np.diff(arrival) > 2.0 * np.diff(self.time))
        time = np.insert(self.time, still + 1, self.time[still])
        return time, np.insert(arrival, still + 1, arrival[still + 1]) - time

    def arrivals(self, sent: Array) -> Array:
        """When messages arrive that are sent at these growing times [s], from the trace's begin on."""
        time, delay = self.corners
        return np.maximum.accumulate(sent + np.interp(sent, time, delay))

    @cached_property
    def stalls(self) -> Array:
        """Begin and length of each time for which nothing of a stream at 1 kHz comes, one way [s]; shape (n, 2)."""
        arrival = self.arrivals(np.arange(0.0, self.time[-1], STREAM_PERIOD))
        between = np.diff(arrival)
        still = between > 2.0 * STREAM_PERIOD
        return np.column_stack((arrival[:-1][still], between[still]))

    @property
    def longest_stall(self) -> float:
        """The longest of them [s]; 0 where there is none."""
        return float(self.stalls[:, 1].max(initial=0.0))


class Way:
    """One direction over a trace, which begins with the first message, and again where it ends.

    Args:
        trace: The trace.
        start: Where in it the first message is sent [s]; beyond its end it is counted from its begin again.
    """

    def __init__(self, trace: NetworkTrace, start: float = 0.0) -> None:
        time, delay = trace.corners
        # Plain floats: one message is looked up at a time.
        self._time: list[float] = time.tolist()
        self._delay: list[float] = delay.tolist()
        self._length = trace.length
        self._start, self._spacing_ns = start, round(trace.spacing * 1e9)
        self._begun_ns: int | None = None
        self._arrival_ns = 0  # of the latest
        self._taken_ns: dict[type, int] = {}  # when the last message of a kind was taken

    def takes(self, now_ns: int, kind: type) -> bool:
        """Whether it takes a message of this kind now, by the receiver's clock."""
        if not self._spacing_ns:
            return True
        before = self._taken_ns.get(kind)
        if before is not None and now_ns - before < self._spacing_ns:
            return False
        self._taken_ns[kind] = now_ns
        return True

    def arrival_ns(self, now_ns: int) -> int:
        """When a message arrives that is sent now: never before one that was sent earlier."""
        if self._begun_ns is None:
            self._begun_ns = now_ns
        delay = self._delay_at((self._start + (now_ns - self._begun_ns) * 1e-9) % self._length)
        self._arrival_ns = max(self._arrival_ns, now_ns + round(delay * 1e9))
        return self._arrival_ns

    def _delay_at(self, moment: float) -> float:
        after = bisect_right(self._time, moment)
        if after == len(self._time):  # on the way from its end to its begin
            return self._delay[-1]
        begin, end = self._time[after - 1], self._time[after]
        before, then = self._delay[after - 1], self._delay[after]
        return before + (then - before) * (moment - begin) / (end - begin)
