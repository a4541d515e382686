"""Sending of models by the follower, the leader's acknowledgement of them, and their delay until use.

The delay is measured by the sender's own clock.
"""

from __future__ import annotations

import math
from heapq import heappop, heappush

from foretouch.identification import (
    SENSOR_SENTENCES,
    Estimator,
    Learner,
    LearntModel,
    ScaleFieldLearner,
    SensorState,
)
from foretouch.messages import VERSION, FieldUpdate, ModelUpdate, encode
from foretouch.models import ContactMapModel, ContactModel

PERIOD_NS = 1_000_000_000  # Interval over which the smallest round trip is taken, and after which it is reported [ns]
LARGEST_MEMORY = 4096  # Largest number of models and commands remembered: a leader that never answers fills no memory


class RoundTrip:
    """Time from sending a model to applying the first command of a leader that had it.

    It is how far the motion that a model is used on is ahead of the motion that it was learnt from: the delay in both
    directions together. Both ends are ticks of the follower, so no two clocks are compared. The smallest of a second
    is taken: a larger one includes waiting.

    Attributes:
        current: Model that the leader of the newest applied command rendered from; 0 for none.
    """

    __slots__ = ("_acknowledged", "_applied", "_commands", "_due_ns", "_sent", "_smallest_ns", "current")

    def __init__(self) -> None:
        self._sent: dict[int, int] = {}
        self._due_ns: int | None = None
        self.restart()

    def restart(self) -> None:
        """Start again with another leader, which counts from 1 again and has no model yet."""
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
        """A command has arrived whose leader had this model; one that comes after its turn adds nothing."""
        if command <= self._applied:
            return
        if len(self._acknowledged) >= LARGEST_MEMORY:
            self._acknowledged.clear()
            self._commands.clear()
        if command not in self._acknowledged:
            heappush(self._commands, command)
        self._acknowledged[command] = model

    def applied(self, command: int, now_ns: int) -> float | None:
        """One tick [ns] after this newest applied command: once a second its smallest round trip [s], else None."""
        if command > self._applied:
            self._applied = command
        commands = self._commands
        while commands and commands[0] <= command:
            current = self.current = self._acknowledged.pop(heappop(commands))
            if current in self._sent:  # else it was heard of before, or is of another process of the follower
                self._smallest_ns = min(self._smallest_ns, now_ns - self._sent[current])
                self._sent = {model: sent_ns for model, sent_ns in self._sent.items() if model > current}
        if self._due_ns is None:
            self._due_ns = now_ns + PERIOD_NS
        if now_ns < self._due_ns:
            return None
        self._due_ns = now_ns + PERIOD_NS
        smallest, self._smallest_ns = self._smallest_ns, math.inf
        return smallest * 1e-9 if smallest < math.inf else None


SURFACE_CHANGE = 1e-4  # Motion of a surface since the last model above which one is sent at once [m]

BYTE_RATE, LARGEST_BURST = 43e3, 3e3
"""Byte rate of the models [byte/s], and bytes that may be sent at once after a silence: with the one that may exceed
it, no second holds more than 50 kB. A model that does not fit waits, and is sent as it is by then."""

ERRORS_PERIOD_NS = 500_000_000  # Time between two computations of the parameters' standard errors [ns]
CHANGE_TOLD_NS = 2_000_000_000  # Time for which models report that the material has changed [ns]


class ModelSender:
    """Sends models on schedule, and at once when something has changed, as far as the bytes allow.

    Args:
        period_ns: Time between two models while nothing changes [ns].
        run: Epoch of this process.

    Attributes:
        sequence: Sequence number of the newest model sent, 0 before the first.
        round_trip: Learns how late models are used.
        remembers: Whether surfaces are remembered until the leader is known to have them.
    """

    def __init__(self, period_ns: int, run: int) -> None:
        self._period_ns = period_ns
        self._run = run
        self._sent: LearntModel | None = None
        self._sent_ns = 0
        self._allowance = 0.0  # bytes that could have been sent beside it
        self._changed = False  # something has, since that is worth a model at once
        self._changes = 0  # of the material, as the estimator has found
        self._changed_ns: int | None = None
        self._errors: tuple[float, ...] = ()
        self._errors_ns = -ERRORS_PERIOD_NS
        self._surfaces: dict[int, float] = {}  # of models sent since the one that the leader has; NaN if not valid
        self.sequence = 0
        self.remembers = False
        self.round_trip = RoundTrip()

    def surface_of(self, model: int) -> float:
        """Surface of a model that a command acknowledges [m]; NaN if it had none, or none is remembered."""
        return self._surfaces.get(model, math.nan)

    def due(
        self, learner: Learner, sensors: SensorState, command_sequence: int, epoch: int, now_ns: int
    ) -> ModelUpdate | None:
        """The model to send in this tick, if one is due.

        Args:
            learner: Learner of the model.
            sensors: Validity of the sensors.
            command_sequence: Sequence number of the newest command that was applied.
            epoch: Epoch of the leader of that command.
            now_ns: Time of this tick [ns].
        """
        if self._is_changed(learner, now_ns):
            self._changed = True
        since_ns = now_ns - self._sent_ns
        if not self._changed and since_ns < self._period_ns:
            return None
        allowance = (
            LARGEST_BURST if self._sent is None else min(self._allowance + BYTE_RATE * since_ns * 1e-9, LARGEST_BURST)
        )
        if allowance <= 0.0:
            return None
        learnt = learner.learnt()
        self._sent, self._sent_ns, self._changed = learnt, now_ns, False
        self.sequence += 1
        model = learnt.model
        update = ModelUpdate(
            VERSION,
            self.sequence,
            now_ns,
            command_sequence,
            "" if model is None else model.law,
            () if model is None else model.parameters,
            learnt.state,
            learnt.surface,
            model is not None,
            self._reason(learnt, sensors, now_ns),
            learner.estimator.name,
            model.map if isinstance(model, ContactMapModel) else b"",
            epoch,
            self._run,
            standard_errors=() if model is None else self._errors_of(model, learner.estimator, now_ns),
        )
        self._allowance = allowance - len(encode(update))
        self.round_trip.sent(update.sequence, now_ns)
        if self.remembers:
            since = self.round_trip.current
            full = len(self._surfaces) >= LARGEST_MEMORY  # a leader that never answers fills nothing
            self._surfaces = {n: x for n, x in self._surfaces.items() if n == since or (n > since and not full)}
            self._surfaces[update.sequence] = math.nan if model is None else learnt.surface
        return update

    def _errors_of(self, model: ContactModel, estimator: Estimator, now_ns: int) -> tuple[float, ...]:
        """Standard errors of a model's parameters: they change slowly, and asking for them takes as long as a step."""
        if now_ns - self._errors_ns >= ERRORS_PERIOD_NS or len(self._errors) not in (0, len(model.parameters)):
            result, self._errors_ns = estimator.standard_errors, now_ns
            known = {} if result is None else result
            errors = tuple(math.nan if (error := known.get(name)) is None else error for name in model.parameter_names)
            self._errors = errors if known else ()
        return self._errors

    def _is_changed(self, learner: Learner, now_ns: int) -> bool:
        """Whether the model became valid or not, its surface moved, or the material changed, since the last model.

        It is asked in every tick and packs no map for the answer.
        """
        estimator, sent, changes = learner.estimator, self._sent, self._changes
        if estimator.changes != changes:
            self._changes = estimator.changes
            if self._changes > changes:
                self._changed_ns = now_ns
                return True
        if sent is None:
            return True
        surface = learner.conditioner.surface - estimator.surface_correction
        if math.isnan(surface):
            return sent.model is not None
        if sent.model is None:
            return estimator.has_model
        # A map stays valid until its estimator begins anew.
        valid = estimator.updates > 0 if isinstance(sent.model, ContactMapModel) else estimator.has_model
        return not valid or abs(surface - sent.surface) > SURFACE_CHANGE

    def _reason(self, learnt: LearntModel, sensors: SensorState, now_ns: int) -> str:
        """State of the sensors if they fail; else of the learner, or for a while after a change that there was one.

        It is repeated, for a message may be lost.
        """
        if sensors is not SensorState.GOOD:
            return f"nothing is learnt: {SENSOR_SENTENCES[sensors]}"
        if learnt.model is None or self._changed_ns is None or now_ns - self._changed_ns > CHANGE_TOLD_NS:
            return learnt.reason
        return f"the material changed {(now_ns - self._changed_ns) * 1e-9:.1f} s ago: it is learnt anew"


FIELD_PERIOD_NS = 100_000_000  # Time between two messages of the field [ns]
AGAIN = 3  # Number of messages in which a node that has changed is sent, for some are lost

LEAST_NODES, MOST_NODES = 16, 64
"""Nodes of a message: those that have changed, up to the most; others, in turn, fill it up to the least, for a leader
that begins."""


class FieldSender:
    """Sends the nodes of a field that have changed, and the others in turn.

    Args:
        run: Epoch of the follower's process.
    """

    __slots__ = ("_before", "_next_ns", "_run", "_sent")

    def __init__(self, run: int) -> None:
        self._run = run
        self._next_ns = self._sent = 0
        self._before = [0] * AGAIN  # numbers of samples learnt from, as of the newest messages

    def due(self, places: ScaleFieldLearner, now_ns: int) -> FieldUpdate | None:
        """The message that is due at this time [ns]."""
        if now_ns < self._next_ns or places.updates == 0:
            return None
        content = places.news(self._before[0], LEAST_NODES, MOST_NODES)
        self._before = [*self._before[1:], places.updates]
        self._next_ns = now_ns + FIELD_PERIOD_NS
        self._sent += 1
        return FieldUpdate(VERSION, self._sent, now_ns, content, self._run)
