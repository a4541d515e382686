"""The leader's knowledge of the follower: which process answers, which leader it obeys, and its state."""

from __future__ import annotations

import math
from typing import Annotated, Any

from numpy.typing import NDArray

from foretouch.core import Held, Record, compiled, kernel
from foretouch.link import SequenceCounter
from foretouch.messages import ModelUpdate, Status, Telemetry

STOPPED, SHADOW = int(Status.STOPPED), int(Status.SHADOW)
"""States of the robot as encoded in messages."""

AS_DEEP = 5e-4  # Tolerance of depth [m] within which a robot has been as deep as one before, and so has felt the same

MOST_OF_FORMER = 200
"""Number of messages from a process taken to be gone, with none from its successor, that show that it is not gone: its
messages only came later."""

MOST_FORMER = 4096  # Largest number of processes remembered as gone; the oldest are forgotten first

TOUCHED_ENOUGH = 3000
"""Ticks of contact after which a process knows more than one that is gone: the material may be another."""


class View(Record):
    """What a `FollowerView` knows; its attributes are described there."""

    epoch: int  # of this leader
    run: int
    newest_model: int  # number of the newest of this process, 0 before the first
    newest_telemetry: int
    in_control: bool = True
    had_control: bool
    stopped: bool
    shadows: bool
    touching: bool
    renewed: bool  # another process has taken the follower's place since that was asked
    has_relearnt: bool = True
    position: float = math.nan
    force: float
    deepest: float = -math.inf  # position of this process [m]
    to_relearn: float = -math.inf  # that of those before [m]
    touched: int  # ticks of contact of this process
    of_former: int  # messages in a row of one that is taken to be gone
    gone: int  # processes that have been followed by another
    former: Annotated[NDArray[Any], int, MOST_FORMER] = -1  # type: ignore[assignment]  # the newest of them, a ring


@compiled
def _place_of(view: View, run: int) -> int:
    """Place of a process among those that are gone; negative where it is not."""
    for place in range(min(view.gone, MOST_FORMER)):
        if view.former[place] == run:
            return place
    return -1


@compiled
def _is_current(view: View, run: int) -> bool:
    """Whether a message of this process counts; it may be the first of another one than before."""
    if run == view.run:
        view.of_former = 0
        return True
    place = _place_of(view, run)
    if place >= 0:
        view.of_former += 1
        if view.of_former < MOST_OF_FORMER:
            return False
        view.former[place] = -1
    view.renewed = view.run != 0
    view.to_relearn = max(view.to_relearn, view.deepest)
    view.deepest, view.touched = -math.inf, 0
    view.has_relearnt = view.run == 0
    view.former[view.gone % MOST_FORMER] = view.run
    view.gone += 1
    view.of_former = view.newest_model = view.newest_telemetry = 0
    view.run, view.position = run, math.nan
    return True


@kernel("b1(View, i8, i8, i8, i8, f8, f8, f8, b1)")
def take_telemetry(
    view: View,
    run: int,
    sequence: int,
    epoch: int,
    status: int,
    position: float,
    desired_position: float,
    force: float,
    in_contact: bool,
) -> bool:
    """Take the fields of this name of a `Telemetry`, if it is the newest; whether its process is the present one."""
    if not _is_current(view, run):
        return False
    if sequence <= view.newest_telemetry:
        return True
    view.newest_telemetry = sequence
    ours = epoch == view.epoch
    if ours:
        view.had_control = True
    view.in_control = ours or epoch == 0
    view.stopped, view.shadows = status == STOPPED, status == SHADOW
    view.position, view.force, view.touching = desired_position, force, in_contact
    if in_contact:
        view.touched += 1
    if position > view.deepest:
        view.deepest = position
    if not view.has_relearnt:
        felt = view.deepest >= view.to_relearn - AS_DEEP
        view.has_relearnt = felt or view.touched >= TOUCHED_ENOUGH
    return True


@kernel("UniTuple(b1, 2)(View, i8, i8, i8)")
def take_model(view: View, run: int, sequence: int, epoch: int) -> tuple[bool, bool]:
    """Take the fields of this name of a `ModelUpdate`: whether its process is the present one, and it is for us."""
    if not _is_current(view, run):
        return False, False
    newest = sequence > view.newest_model
    if newest:
        view.newest_model = sequence
    return True, newest and (epoch == 0 or epoch == view.epoch)


class FollowerView(Held):
    """Separates messages for this leader from late ones, and from those of a past follower or for another leader.

    A follower's process counts its messages from 1. With another process, which its epoch shows, counting begins anew;
    messages of a process that another has followed are left out, however late they come.

    Args:
        epoch: Epoch of this leader.

    Attributes:
        run: Epoch of the follower's process, 0 before the first message.
        models: Counts arriving models.
        telemetry: Counts arriving telemetry.
        renewed: Whether another process has taken the follower's place since this was set to False.
        in_control: Whether the follower obeys this leader, or none yet.
        had_control: Whether it has ever obeyed this leader.
        stopped: Whether its emergency stop is latched.
        shadows: Whether it only watches a robot that is moved from elsewhere: it commands nothing, and obeys no leader.
        position: Its commanded position in the newest telemetry [m]; NaN before the first.
        force: Force that it felt then [N].
        touching: Whether that was contact.
        has_relearnt: Whether this process has felt what the one before had: its robot has been as deep, or has touched
            for 3 s. True for the first process.
    """

    run: int
    newest_model: int
    newest_telemetry: int
    in_control: bool
    had_control: bool
    stopped: bool
    shadows: bool
    touching: bool
    renewed: bool
    has_relearnt: bool
    position: float
    force: float

    def __init__(self, epoch: int) -> None:
        super().__init__(View.new(epoch=epoch))
        self._telemetry, self._model = take_telemetry.entry, take_model.entry
        self.models, self.telemetry = SequenceCounter(), SequenceCounter()

    def take_telemetry(self, telemetry: Telemetry) -> None:
        """Take a telemetry message, if it is the newest."""
        run, t = self.run, telemetry
        current = self._telemetry(
            self.records[0], t.run, t.sequence, t.epoch, t.status, t.position, t.desired_position, t.force, t.in_contact
        )
        self._count(self.telemetry, t, current, run)

    def is_for_us(self, model: ModelUpdate) -> bool:
        """Whether a model is the newest, and learnt from commands of this leader, or of none."""
        run = self.run
        current, ours = self._model(self.records[0], model.run, model.sequence, model.epoch)
        self._count(self.models, model, current, run)
        return ours

    def take_renewed(self) -> bool:
        """Whether another process has taken the follower's place since the last call."""
        renewed, self.renewed = self.renewed, False
        return renewed

    def _count(self, counter: SequenceCounter, message: Telemetry | ModelUpdate, current: bool, run: int) -> None:
        """Count a message of the present process, which before it was the one of this run."""
        if self.run != run:
            self.models.restart()
            self.telemetry.restart()
        if current:
            counter.is_newest(message.sequence)
