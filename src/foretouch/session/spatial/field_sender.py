"""When the materials that were learnt over a surface are sent."""

from __future__ import annotations

from foretouch.identification import Estimator, MaterialFieldLearner
from foretouch.messages import VERSION, FieldUpdate

__all__ = ["FieldSender"]

FIELD_PERIOD_NS = 100_000_000
"""Between two fields of materials, at least [ns]."""

FIELD_RATE = 30e3
"""Fields take so many bytes a second at most."""


class FieldSender:
    """Sends a field if it has changed and the last one is some time ago: the longer, the larger that was.

    Args:
        run: Epoch of the follower's process.
    """

    __slots__ = ("_next_ns", "_run", "_sent", "_updates")

    def __init__(self, run: int) -> None:
        self._run = run
        self._next_ns = self._updates = self._sent = 0

    def due(self, estimator: Estimator, now_ns: int) -> FieldUpdate | None:
        """The field that is due, of an estimator that learns one.

        Args:
            estimator: Of the session.
            now_ns: This side's monotonic clock [ns].
        """
        if not isinstance(estimator, MaterialFieldLearner) or estimator.updates == self._updates:
            return None
        if now_ns < self._next_ns:
            return None
        content = estimator.field.to_bytes()
        self._next_ns = now_ns + max(FIELD_PERIOD_NS, round(1e9 * len(content) / FIELD_RATE))
        self._updates = estimator.updates
        self._sent += 1
        return FieldUpdate(VERSION, self._sent, now_ns, content, self._run)
