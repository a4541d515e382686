"""The leader's knowledge of the follower: which process answers, which leader it obeys, and its state."""

from __future__ import annotations

import math

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


class FollowerView:
    """Separates messages for this leader from late ones, and from those of a past follower or for another leader.

    A follower's process counts its messages from 1. With another process, which its epoch shows, counting begins anew;
    messages of a process that another has followed are left out, however late they come.

    Args:
        epoch: Epoch of this leader.

    Attributes:
        run: Epoch of the follower's process, 0 before the first message.
        models: Counts arriving models.
        telemetry: Counts arriving telemetry.
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

    def __init__(self, epoch: int) -> None:
        self._epoch = epoch
        self._former: dict[int, None] = {}
        self._renewed = False
        self.run = 0
        self.models = SequenceCounter()
        self.telemetry = SequenceCounter()
        self.in_control = True
        self.had_control = False
        self.stopped = False
        self.shadows = False
        self.position = math.nan
        self.force = 0.0
        self.touching = False
        self.has_relearnt = True
        self._deepest = self._to_relearn = -math.inf
        self._touched = 0
        self._of_former = 0

    def take_telemetry(self, telemetry: Telemetry) -> None:
        """Take a telemetry message, if it is the newest."""
        if not self._is_current(telemetry.run) or not self.telemetry.is_newest(telemetry.sequence):
            return
        status, position = telemetry.status, telemetry.position
        ours = telemetry.epoch == self._epoch
        if ours:
            self.had_control = True
        self.in_control = ours or telemetry.epoch == 0
        self.stopped, self.shadows = status == STOPPED, status == SHADOW
        self.position, self.force = telemetry.desired_position, telemetry.force
        self.touching = touching = telemetry.in_contact
        if touching:
            self._touched += 1
        if position > self._deepest:
            self._deepest = position
        if not self.has_relearnt:
            felt = self._deepest >= self._to_relearn - AS_DEEP
            self.has_relearnt = felt or self._touched >= TOUCHED_ENOUGH

    def is_for_us(self, model: ModelUpdate) -> bool:
        """Whether a model is the newest, and learnt from commands of this leader, or of none."""
        newest = self._is_current(model.run) and self.models.is_newest(model.sequence)
        return newest and model.epoch in (0, self._epoch)

    def take_renewed(self) -> bool:
        """Whether another process has taken the follower's place since the last call."""
        renewed, self._renewed = self._renewed, False
        return renewed

    def _is_current(self, run: int) -> bool:
        if run == self.run:
            self._of_former = 0
            return True
        if run in self._former:
            self._of_former += 1
            if self._of_former < MOST_OF_FORMER:
                return False
        self._renewed = self.run != 0
        self._to_relearn = max(self._to_relearn, self._deepest)
        self._deepest, self._touched = -math.inf, 0
        self.has_relearnt = self.run == 0
        if len(self._former) >= MOST_FORMER:
            del self._former[next(iter(self._former))]
        self._former[self.run] = None
        self._former.pop(run, None)
        self._of_former = 0
        self.run = run
        self.models.restart()
        self.telemetry.restart()
        self.position = math.nan
        return True
