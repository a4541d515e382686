"""A whole session in memory: what the leader and the follower said, tick by tick."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import msgspec
import numpy as np
from numpy.typing import NDArray

from foretouch.messages.schema import LeaderState, Message, ModelUpdate, Telemetry

__all__ = ["COUNT_PREFIX", "FOLLOWER_DTYPE", "LEADER_DTYPE", "SessionLog", "SessionRows", "as_row", "split_texts"]

_NUMBERS = ("model_jump", "standard_deviation", "update_step", "energy", "energy_bound", "rendered_share")
_TYPES = dict.fromkeys(_NUMBERS, "f8") | dict.fromkeys(("clipped", "in_contact", "guarded", "engaged"), "?")


def _dtype(kind: type[Message]) -> np.dtype[np.void]:
    """Structured dtype with the fields of a message class, its version left out."""

    def column(name: str) -> str:
        if name in _TYPES:
            return _TYPES[name]
        return "f8" if name.endswith(("force", "position", "velocity")) else "i8"

    return np.dtype([(name, column(name)) for name in kind.__struct_fields__ if name != "version"])


LEADER_DTYPE = _dtype(LeaderState)
"""Columns of `SessionLog.leader`: the fields of `LeaderState`."""

FOLLOWER_DTYPE = _dtype(Telemetry)
"""Columns of `SessionLog.follower`: the fields of `Telemetry`."""


def as_row(message: Message) -> tuple[object, ...]:
    """The fields of a message as a row of its table."""
    return msgspec.structs.astuple(message)[1:]


COUNT_PREFIX = "count_"
"""Begins the names of counters among the texts of a `Hello`."""


def split_texts(texts: Mapping[str, str]) -> tuple[dict[str, str], dict[str, int]]:
    """The settings and the counters among the texts of a `Hello`."""
    counts = {
        name.removeprefix(COUNT_PREFIX): int(value)
        for name, value in texts.items()
        if name.startswith(COUNT_PREFIX) and value.isdigit()
    }
    return {name: value for name, value in texts.items() if not name.startswith(COUNT_PREFIX)}, counts


@dataclass(frozen=True)
class SessionRows:
    """One row per command sequence number that the follower applied: the first tick that applied it.

    All arrays have the same length and are ordered by command sequence.

    Attributes:
        leader: Rows of `SessionLog.leader`.
        follower: Rows of `SessionLog.follower`.
        never_applied: Commands that were sent and not applied by any tick; counted, not scored.
    """

    leader: NDArray[np.void]
    follower: NDArray[np.void]
    never_applied: int


@dataclass(frozen=True)
class SessionLog:
    """What was said in a session.

    Attributes:
        leader: One row per `LeaderState`, structured as `LEADER_DTYPE`.
        follower: One row per `Telemetry`, structured as `FOLLOWER_DTYPE`.
        models: Every `ModelUpdate`, in order of sequence.
        settings: The session's settings as text, from the `Hello` messages.
        counts: Counters of both sides at the end, for example ``"undecodable"``.
    """

    leader: NDArray[np.void]
    follower: NDArray[np.void]
    models: tuple[ModelUpdate, ...]
    settings: dict[str, str] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)

    @classmethod
    def from_messages(
        cls,
        leader: list[LeaderState],
        follower: list[Telemetry],
        models: list[ModelUpdate],
        settings: dict[str, str],
        counts: dict[str, int],
    ) -> SessionLog:
        """Log from the messages themselves."""
        return cls(
            np.array([as_row(message) for message in leader], dtype=LEADER_DTYPE),
            np.array([as_row(message) for message in follower], dtype=FOLLOWER_DTYPE),
            tuple(sorted(models, key=lambda model: model.sequence)),
            settings,
            counts,
        )

    def rows(self) -> SessionRows:
        """Pair each applied command with the first follower tick that applied it."""
        applied = self.follower[self.follower["command_sequence"] > 0]
        sequences, first = np.unique(applied["command_sequence"], return_index=True)
        _, in_leader, in_follower = np.intersect1d(
            self.leader["sequence"], sequences, assume_unique=True, return_indices=True
        )
        return SessionRows(self.leader[in_leader], applied[first[in_follower]], int(self.leader.size - in_leader.size))
