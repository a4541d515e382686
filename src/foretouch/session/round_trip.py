"""How late a model is used, by the clock of the one who sends it."""

from __future__ import annotations

import math
from heapq import heappop, heappush

__all__ = ["RoundTrip"]

PERIOD_NS = 1_000_000_000
"""The smallest round trip is taken over so long [ns], and said once in it."""

LARGEST_MEMORY = 4096
"""No more models and commands are remembered than this: a leader that never answers fills nothing."""


class RoundTrip:
    """Time from sending a model to applying the first command of a leader that had it.

    That is how far the motion that a model is used on is ahead of the motion that it was learnt from: the way there and
    the way back, whichever of them is the longer. Both ends are ticks of the follower, so no clock is compared with
    another's. The smallest of a second is taken: what is larger waited somewhere.

    Attributes:
        current: Model that the leader of the newest applied command rendered from; 0 for none.
    """

    __slots__ = ("_acknowledged", "_applied", "_commands", "_due_ns", "_sent", "_smallest_ns", "current")

    def __init__(self) -> None:
        self._sent: dict[int, int] = {}
        self._due_ns: int | None = None
        self.restart()

    def restart(self) -> None:
        """Another leader, who counts from 1 again and knows nothing yet."""
        self._acknowledged: dict[int, int] = {}  # models by command
        self._commands: list[int] = []  # those commands, as a heap
        self._applied = self.current = 0
        self._smallest_ns = math.inf

    def sent(self, model: int, now_ns: int) -> None:
        """A model with this sequence number is sent [ns]."""
        if len(self._sent) >= LARGEST_MEMORY:
            self._sent.clear()
        self._sent[model] = now_ns

    def commanded(self, command: int, model: int) -> None:
        """A command has arrived whose leader had this model; one that comes after its turn says nothing new."""
        if command <= self._applied:
            return
        if len(self._acknowledged) >= LARGEST_MEMORY:
            self._acknowledged.clear()
            self._commands.clear()
        if command not in self._acknowledged:
            heappush(self._commands, command)
        self._acknowledged[command] = model

    def applied(self, command: int, now_ns: int) -> float | None:
        """One tick, in which this command is the newest that was applied [ns].

        Returns:
            Once a second the smallest round trip of that second [s], None in all other ticks and where there was none.
        """
        if command > self._applied:
            self._applied = command
        commands = self._commands
        while commands and commands[0] <= command:
            self.current = self._acknowledged.pop(heappop(commands))
            if self.current in self._sent:  # else it was heard of before, or is of another process of the follower
                self._hear(self.current, now_ns)
        if self._due_ns is None:
            self._due_ns = now_ns + PERIOD_NS
        if now_ns < self._due_ns:
            return None
        self._due_ns = now_ns + PERIOD_NS
        smallest, self._smallest_ns = self._smallest_ns, math.inf
        return smallest * 1e-9 if smallest < math.inf else None

    def _hear(self, model: int, now_ns: int) -> None:
        """The first command was applied whose leader had this model."""
        self._smallest_ns = min(self._smallest_ns, now_ns - self._sent[model])
        self._sent = {number: sent for number, sent in self._sent.items() if number > model}
