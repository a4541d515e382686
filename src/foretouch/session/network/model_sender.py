"""Sending of models by the follower, as often as the bytes allow, and the leader's acknowledgement of them."""

from __future__ import annotations

import math
from typing import Annotated, Any

from numpy.typing import NDArray

from foretouch.core import Held, Kernel, Record, compiled
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
from foretouch.session.network.round_trip import ROOM, RoundTrip, Trip, note_sent

SURFACE_CHANGE = 1e-4  # Motion of a surface since the last model above which one is sent at once [m]

BYTE_RATE, LARGEST_BURST = 43e3, 3e3
"""Byte rate of the models [byte/s], and bytes that may be sent at once after a silence: with the one that may exceed
it, no second holds more than 50 kB. A model that does not fit waits, and is sent as it is by then."""

ERRORS_PERIOD_NS = 500_000_000  # Time between two computations of the parameters' standard errors [ns]
CHANGE_TOLD_NS = 2_000_000_000  # Time for which models report that the material has changed [ns]


class Sending(Record):
    """State of a `ModelSender`."""

    period_ns: int  # between two models while nothing changes [ns]
    sequence: int  # of the newest model sent, 0 before the first
    sent_ns: int  # when it was sent [ns]
    had_model: bool  # whether it was a valid one
    surface: float  # its surface [m]
    allowance: float  # bytes that could have been sent beside it
    allowed: float  # bytes that may be sent now
    changed: bool  # something has, since the newest one, that is worth a model at once
    changes: int  # of the material, as the estimator has found
    changed_ns: int = -1  # when the newest was found; negative before the first [ns]
    remembers: bool  # whether surfaces are remembered until the leader is known to have them
    since: int  # oldest model whose surface is remembered
    models: Annotated[NDArray[Any], int, ROOM] = -1  # type: ignore[assignment]  # whose surface is remembered
    surfaces: Annotated[NDArray[Any], float, ROOM]  # theirs, NaN of one that was not valid [m]
    trip: Trip


@compiled
def surface_of(sending: Sending, model: int) -> float:
    """See `ModelSender.surface_of`."""
    at = model % ROOM
    return float(sending.surfaces[at]) if model >= sending.since and sending.models[at] == model else math.nan


@compiled
def _is_changed(sending: Sending, changes: int, surface: float, stays: bool, now_ns: int) -> bool:
    before, sending.changes = sending.changes, changes
    if changes > before:
        sending.changed_ns = now_ns
        return True
    if sending.sequence == 0:
        return True
    if math.isnan(surface):
        return bool(sending.had_model)
    if not sending.had_model:
        return stays
    return not stays or abs(surface - sending.surface) > SURFACE_CHANGE


@compiled
def is_due(sending: Sending, changes: int, surface: float, stays: bool, now_ns: int) -> bool:
    """Whether a model is to be sent in this tick: it is time, or something has changed, and the bytes allow it.

    That is asked in every tick, and packs no map for the answer.

    Args:
        sending: Written.
        changes: Number of changes of the material that were found.
        surface: Surface of the model that there is now [m], NaN without one.
        stays: Whether there is a valid model; of a contact map, which stays valid until its estimator begins anew,
            whether there was one.
        now_ns: Time of this tick [ns].
    """
    sending.changed = _is_changed(sending, changes, surface, stays, now_ns) or sending.changed
    since_ns = now_ns - sending.sent_ns
    if not sending.changed and since_ns < sending.period_ns:
        return False
    more = sending.allowance + BYTE_RATE * since_ns * 1e-9
    sending.allowed = LARGEST_BURST if sending.sequence == 0 else min(more, LARGEST_BURST)
    return bool(sending.allowed > 0.0)


@compiled
def begin_sending(sending: Sending, surface: float, has_model: bool, now_ns: int) -> int:
    """Send the model that there is: its number."""
    sending.sent_ns, sending.changed = now_ns, False
    sending.surface, sending.had_model = surface, has_model
    sending.sequence += 1
    return int(sending.sequence)


@compiled
def note_size(sending: Sending, size: int) -> None:
    """Count the bytes of the model that was just sent, and remember it."""
    sending.allowance = sending.allowed - size
    number = sending.sequence
    note_sent(sending.trip, number, sending.sent_ns)
    if sending.remembers:
        sending.since = sending.trip.current
        sending.models[number % ROOM] = number
        sending.surfaces[number % ROOM] = sending.surface if sending.had_model else math.nan


_surface_of, _is_due = Kernel(surface_of, "f8(Sending, i8)"), Kernel(is_due, "b1(Sending, i8, f8, b1, i8)")
_begin, _size = Kernel(begin_sending, "i8(Sending, f8, b1, i8)"), Kernel(note_size, "(Sending, i8)")


class ModelSender(Held):
    """Sends models on schedule, and at once when something has changed, as far as the bytes allow.

    Args:
        period_ns: Time between two models while nothing changes [ns].
        run: Epoch of this process.
        sendings: Array of one `Sending` that this one takes, part of another record; None for one of its own.

    Attributes:
        sequence: Sequence number of the newest model sent, 0 before the first.
        round_trip: Learns how late models are used.
        remembers: Whether surfaces are remembered until the leader is known to have them.
    """

    sequence: int
    remembers: bool
    changed_ns: int

    def __init__(self, period_ns: int, run: int, *, sendings: NDArray[Any] | None = None) -> None:
        super().__init__(Sending.new() if sendings is None else sendings)
        self.records[:] = Sending.new(period_ns=period_ns)
        self._run = run
        self._sent: LearntModel | None = None
        self._errors: tuple[float, ...] = ()
        self._errors_ns = -ERRORS_PERIOD_NS
        self.round_trip = RoundTrip(self.records["trip"])
        for kernel in (_surface_of, _is_due, _begin, _size):
            kernel.entry  # noqa: B018  # asked for, it is compiled or loaded: nothing of that in the loop

    def surface_of(self, model: int) -> float:
        """Surface of a model that a command acknowledges [m]; NaN if it had none, or none is remembered."""
        return _surface_of.entry(self.records[0], model)

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
        estimator, sent = learner.estimator, self._sent
        surface = learner.conditioner.surface - estimator.surface_correction
        was_map = sent is not None and isinstance(sent.model, ContactMapModel)
        stays = not math.isnan(surface) and (estimator.updates > 0 if was_map else estimator.has_model)
        if not _is_due.entry(self.records[0], estimator.changes, surface, stays, now_ns):
            return None
        self._sent = learnt = learner.learnt()
        model = learnt.model
        update = ModelUpdate(
            VERSION,
            _begin.entry(self.records[0], learnt.surface, model is not None, now_ns),
            now_ns,
            command_sequence,
            "" if model is None else model.law,
            () if model is None else model.parameters,
            learnt.state,
            learnt.surface,
            model is not None,
            self._reason(learnt, sensors, now_ns),
            estimator.name,
            model.map if isinstance(model, ContactMapModel) else b"",
            epoch,
            self._run,
            standard_errors=() if model is None else self._errors_of(model, estimator, now_ns),
        )
        _size.entry(self.records[0], len(encode(update)))
        return update

    def _errors_of(self, model: ContactModel, estimator: Estimator, now_ns: int) -> tuple[float, ...]:
        """Standard errors of a model's parameters: they change slowly, and asking for them takes as long as a step."""
        if now_ns - self._errors_ns >= ERRORS_PERIOD_NS or len(self._errors) not in (0, len(model.parameters)):
            result, self._errors_ns = estimator.standard_errors, now_ns
            known = {} if result is None else result
            errors = tuple(math.nan if (error := known.get(name)) is None else error for name in model.parameter_names)
            self._errors = errors if known else ()
        return self._errors

    def _reason(self, learnt: LearntModel, sensors: SensorState, now_ns: int) -> str:
        """State of the sensors if they fail; else of the learner, or for a while after a change that there was one.

        It is repeated, for a message may be lost.
        """
        if sensors is not SensorState.GOOD:
            return f"nothing is learnt: {SENSOR_SENTENCES[sensors]}"
        changed_ns = self.changed_ns
        if learnt.model is None or changed_ns < 0 or now_ns - changed_ns > CHANGE_TOLD_NS:
            return learnt.reason
        return f"the material changed {(now_ns - changed_ns) * 1e-9:.1f} s ago: it is learnt anew"


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
