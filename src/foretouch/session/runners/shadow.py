"""A follower that estimates and predicts and commands nothing: for a first day on a real robot.

A person or another program moves the robot. Both steps of a session run in this one process: the leader's hand is the
robot's measured position, and the models reach it with the delay of the settings. The force that would have been
rendered can be seen, recorded and scored.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import msgspec

from foretouch.identification import Estimator
from foretouch.identification.conditioning.kernel import CONTACT_FLOOR
from foretouch.messages import PROCESS, LeaderState, Message, Status, Telemetry
from foretouch.robot import Robot, SpatialRobot
from foretouch.session.network.lease import own_epoch
from foretouch.session.runners.driven import Driven, DrivenFollower, SpaceFollower, Tick, drive_follower, drive_leader
from foretouch.session.runners.housekeeping import Housekeeper, Process
from foretouch.session.runners.live import Loop
from foretouch.session.runners.news import shadow_news
from foretouch.session.runners.warm_up import prepare
from foretouch.session.settings import SessionSettings, shadow_settings

SCORED_AFTER = 1.5  # Time after the first tick at which scoring begins [s], as in a session's report
LONGEST_TICK = 0.1  # Longest time since the previous tick that a tick counts for [s]: beyond it, nothing was observed


class ShadowScore:
    r"""Sums of squares over the ticks in contact, and over those in which contact was predicted; memory is flat.

    .. math:: e = 100 \sqrt{\operatorname{mean}_S (\hat F - F)^2} \Big/ \sqrt{\operatorname{mean}_C F^2}

    as in a session's report, with one difference: C is what the follower takes for contact while it happens, for the
    report's threshold is known only at the end. S is C and the ticks whose prediction is above the contact floor.

    Attributes:
        contact_time: Scored time in contact [s].
    """

    __slots__ = ("_before_ns", "_began_ns", "_contact", "_delayed", "_felt", "_predicted", "_scored", "contact_time")

    def __init__(self) -> None:
        self._began_ns: int | None = None
        self._before_ns = 0
        self._contact = self._scored = 0
        self._felt = self._predicted = self._delayed = 0.0
        self.contact_time = 0.0

    def add(self, now_ns: int, force: float, predicted: float, delayed: float, in_contact: bool) -> None:
        """Take one tick [ns]: measured, predicted and delayed force [N]; a delayed force of NaN counts as 0."""
        if self._began_ns is None:
            self._began_ns = now_ns
        since, self._before_ns = (now_ns - self._before_ns) * 1e-9, now_ns
        if (now_ns - self._began_ns) * 1e-9 < SCORED_AFTER or not math.isfinite(force):
            return
        if in_contact:
            self._contact += 1
            self._felt += force * force
            self.contact_time += min(since, LONGEST_TICK)
        # Not "above": a NaN prediction is an error without bound.
        if in_contact or not predicted <= CONTACT_FLOOR:
            self._scored += 1
            self._predicted += (predicted - force) ** 2
            self._delayed += ((delayed if math.isfinite(delayed) else 0.0) - force) ** 2

    def figures(self) -> dict[str, float]:
        """Time [s] and RMS force [N] in contact, and errors of the predicted and the delayed force [%]; NaN without."""
        felt = math.sqrt(self._felt / self._contact) if self._contact else math.nan

        def error(squares: float) -> float:
            return 100.0 * math.sqrt(squares / self._scored) / felt if felt > 0.0 else math.nan

        return {
            "contact_time_s": self.contact_time,
            "contact_force_rms_N": felt,
            "prediction_error_percent": error(self._predicted),
            "delayed_force_error_percent": error(self._delayed),
        }

    def sentence(self, delay: float) -> str:
        """Figures in one line, for this delay of the models [s]."""
        if not self.contact_time > 0.0:
            return f"nothing was touched after the first {SCORED_AFTER:g} s: there is nothing to compare"
        seconds, felt, predicted, delayed = self.figures().values()
        return (
            f"{seconds:.1f} s in contact at {felt:.2f} N RMS; the predicted force was "
            f"wrong by {predicted:.1f} % of that, the force {delay:g} s late by {delayed:.1f} %"
        )


SHADOW_CHANNELS = ("settings", "stop", "emergency", "hello", *SpaceFollower.channels)
"""Channels that a shadow's link receives: no commands; the last is silent along a line."""

NAME = "shadow"  # Name of the leader inside, and of the session's operator in the recording


class ShadowHand:
    """The measured position of the robot's tip as that of the leader's hand, which feels nothing."""

    name = NAME
    closed_loop = False

    def __init__(self, follows: DrivenFollower) -> None:
        self._follows = follows

    def read(self, now_ns: int) -> Any:
        """Position of the tip [m]."""
        follows = self._follows
        return follows.state.probe.tip(follows.state, follows.sample)

    def render(self, force: Any) -> Any:
        """Nobody feels it."""
        return force


class Shadow(Driven):
    """A leader and a follower on a robot that is moved from elsewhere: its measured position is the leader's hand.

    Both are at the same position, so that only the forces are compared, and a predicted force is as old as its model:
    the messages that arrive are the follower's own. The leader's commands reach the follower at once, and the robot
    receives none.

    Args:
        robot: Robot moved from elsewhere; it counts as the settings' follower frame says.
        settings: Of `shadow_settings`.
        epoch: Epoch of this process.

    Attributes:
        follows: The follower.
        leads: The leader.
        score: Errors of the forces so far.
    """

    def __init__(self, robot: Robot | SpatialRobot, settings: SessionSettings, epoch: int) -> None:
        super().__init__(settings.return_faults)
        self.follows = drive_follower(robot, settings, epoch)
        hand: Any = type(NAME, (ShadowHand, settings.workspace.device), {})  # as the session's devices are
        self.leads = drive_leader(hand(self.follows), settings, NAME, epoch)
        self.channels, self._nowhere = self.follows.channels, settings.workspace.unknown
        self.score = ShadowScore()

    def counts(self) -> dict[str, int]:
        """See `Driven.counts`."""
        return self.leads.counts() | self.follows.counts()

    def pass_time(self, periods: int) -> None:
        """See `Driven.pass_time`; nothing is commanded."""
        self.follows.desired = self._nowhere
        self.follows.pass_time(periods)

    def act(self, due: list[Any], tick: Tick) -> list[Message]:
        """See `Driven.act`; the messages of both sides but the command, the leader's record and telemetry first."""
        follows = self.follows
        command, record = self.leads.act(due, tick)
        acted, *models = follows.act([command], tick)
        follows.state.released_tick = 0  # no command is obeyed here, so a repair of the sensors need not be announced
        assert isinstance(record, LeaderState)
        assert isinstance(acted, Telemetry)
        # The robot was commanded nothing, so the safety layer's reaction is not reported.
        telemetry = msgspec.structs.replace(acted, desired_position=math.nan, status=Status.SHADOW)
        for message in (telemetry, *models):
            self.arriving.push(tick.now_ns, message)
        if not telemetry.validity:
            predicted, delayed = record.predicted_force, record.delayed_force
            self.score.add(tick.now_ns, telemetry.force, predicted, delayed, telemetry.in_contact)
        return [record, telemetry, *models]


def run_shadow(
    process: Process,
    robot: Robot | SpatialRobot,
    settings: SessionSettings,
    *,
    description: dict[str, str],
    duration: float | None = None,
    keep: Callable[[Estimator], object] | None = None,
) -> dict[str, Any]:
    """Watch a robot until a `Stop` arrives, a stop is requested, or `duration` [s] is over; then report the score.

    An emergency stop stops nothing here, and a request for one is answered so. The console's force delay is applied,
    and scoring begins anew with it.

    Args:
        process: Its link has `SHADOW_CHANNELS`.
        robot: Robot moved from elsewhere; no position is commanded. It counts as the settings' follower frame says.
        settings: Session settings; those of the hand are left out.
        description: Further texts for the `Hello` messages.
        duration: Duration [s], None for no end.
        keep: Called with what has learnt, after an end in order.

    Returns:
        Reason for the end, as ``ended``, the score, and the counters, by name.
    """
    link, stop, say, parent, _ = process
    settings = shadow_settings(settings)
    if never_begun := prepare(settings, stop, say, parent):
        return {"ended": never_begun}
    epoch = own_epoch()
    shadow, asked = Shadow(robot, settings, epoch), ""

    def news() -> str:
        return shadow_news(shadow.follows.state, asked)

    def hear(now: int) -> tuple[str, bool]:
        nonlocal asked
        if loop.choose(now):
            shadow.score = ShadowScore()
        emergency, release = stop.take()
        if release:
            asked = ""
        for _, message in link.take("emergency"):
            asked = message.reason or "no reason given"
        asked = emergency or asked
        if link.inboxes["stop"]:
            stop.set(link.take("stop")[-1][1].reason)
        for channel in shadow.channels:
            shadow.follows.beliefs = [belief for _, belief in link.take(channel)]
        return "", release

    loop = Loop(process, "follower", shadow)
    texts = settings.as_text() | {"operator": NAME} | description

    def describe() -> dict[str, str]:
        return texts | loop.texts() | {PROCESS: str(epoch), "control": "nobody", "trouble": news()}

    house = Housekeeper(process, "follower", describe, lambda _: news(), release=robot.close)
    house.start()
    ran = loop.run(house, hear, duration)
    if keep is not None:
        keep(shadow.follows.state.learner.estimator)
    score, delay = shadow.score, shadow.arriving.delay
    say(f"shadow: {score.sentence(delay)}")
    return ran | {"force_delay_s": delay} | score.figures()
