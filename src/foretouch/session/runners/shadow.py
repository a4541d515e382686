"""A follower that estimates and predicts and commands nothing: for a first day on a real robot.

A person or another program moves the robot. Both steps of a session run in this one process: the leader's hand is the
robot's measured position, and the models reach it with the delay of the settings. The force that would have been
rendered can be seen, recorded and scored.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import NamedTuple

import msgspec

from foretouch.identification.conditioning.kernel import CONTACT_FLOOR
from foretouch.link import FaultStage
from foretouch.messages import PROCESS, LeaderState, ModelUpdate, Status, Telemetry
from foretouch.robot import Robot, RobotSample, RobotSpecification
from foretouch.session.frames import framed_robot
from foretouch.session.network.lease import own_epoch
from foretouch.session.runners.housekeeping import Housekeeper, Process
from foretouch.session.runners.live import ended_in_order
from foretouch.session.runners.loop_timer import LoopTimer, let_pass, steady
from foretouch.session.runners.news import shadow_news
from foretouch.session.runners.warm_up import prepare
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings, shadow_settings
from foretouch.session.steps import follower, leader
from foretouch.session.steps.counting import as_texts, fault_texts, follower_counts, leader_counts, link_counts

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


SHADOW_CHANNELS = ("settings", "stop", "emergency", "hello")
"""Channels that a shadow's link receives: no commands."""

NAME = "shadow"  # Name of the leader inside, and of the session's operator in the recording


@dataclass(slots=True)
class State:
    """Both steps, messages on their way from follower to leader, and the score; updated in place in each tick."""

    following: follower.State
    leading: leader.State
    returned: FaultStage[ModelUpdate | Telemetry]
    score: ShadowScore = field(default_factory=ShadowScore)


class Outputs(NamedTuple):
    """Outputs of a tick: all messages of a session's two sides, and nothing for the robot."""

    record: LeaderState
    telemetry: Telemetry
    model: ModelUpdate | None


def start(specification: RobotSpecification, settings: SessionSettings, *, epoch: int = 1, run: int = 1) -> State:
    """State before the first tick, with settings of `shadow_settings`, the leader's epoch and the follower's run."""
    return State(
        follower.start(specification, settings, run=run),
        leader.start(settings, holder=NAME, epoch=epoch),
        FaultStage(settings.return_faults),
    )


def step(state: State, inputs: follower.Inputs[RobotSample], now_ns: int) -> tuple[State, Outputs]:
    """One tick [ns]: the leader at the measured position of the robot, then the follower, which applies it at once.

    Both are at the same position, so that only the forces are compared, and a predicted force is as old as its model.
    The inputs are the follower's, without commands.
    """
    arrived = state.returned.pop_due(now_ns)
    models = [message for message in arrived if type(message) is ModelUpdate]
    telemetry = [message for message in arrived if type(message) is Telemetry]
    hand = follower.tip(state.following, inputs.sample)
    _, led = leader.step(
        state.leading, leader.Inputs(hand, models, telemetry, inputs.period_ns, inputs.compute_ns), now_ns
    )
    _, acted = follower.step(state.following, inputs._replace(commands=[led.command]), now_ns)
    state.following.released_tick = 0  # no command is obeyed here, so a repair of the sensors need not be announced
    # The robot was commanded nothing, so the safety layer's reaction is not reported.
    reported = msgspec.structs.replace(acted.telemetry, desired_position=math.nan, status=Status.SHADOW)
    state.returned.push(now_ns, reported)
    if acted.model is not None:
        state.returned.push(now_ns, acted.model)
    if not reported.validity:
        state.score.add(
            now_ns, reported.force, led.record.predicted_force, led.record.delayed_force, reported.in_contact
        )
    return state, Outputs(led.record, reported, acted.model)


def run_shadow(
    process: Process,
    robot: Robot,
    settings: SessionSettings,
    *,
    description: dict[str, str],
    duration: float | None = None,
) -> dict[str, str | int | float]:
    """Watch a robot until a `Stop` arrives, a stop is requested, or `duration` [s] is over; then report the score.

    An emergency stop stops nothing here, and a request for one is answered so. The console's force delay is applied,
    and scoring begins anew with it.

    Args:
        process: Its link has `SHADOW_CHANNELS`.
        robot: Robot moved from elsewhere; no position is commanded. It counts as the settings' follower frame says.
        settings: Session settings; those of the hand are left out.
        description: Further texts for the `Hello` messages.
        duration: Duration [s], None for no end.

    Returns:
        Reason for the end, as ``ended``, the score, and the counters, by name.
    """
    link, stop, say, parent = process
    settings = shadow_settings(settings)
    if never_begun := prepare(settings, stop, say, parent):
        return {"ended": never_begun}
    robot = framed_robot(robot, settings.follower_frame)
    epoch = own_epoch()
    state = start(robot.specification, settings, epoch=epoch, run=epoch)
    texts = settings.as_text() | {"operator": NAME} | description
    asked, changed_ns = "", 0

    def news() -> str:
        return shadow_news(state.following, asked)

    def describe() -> dict[str, str]:
        counts = leader_counts(state.leading) | follower_counts(state.following) | link_counts("follower", link)
        reported = {PROCESS: str(epoch), "control": "nobody", "trouble": news()}
        return texts | fault_texts(state.returned, "force_delay", changed_ns) | reported | as_texts(counts)

    house = Housekeeper(process, "follower", describe, lambda _: news(), release=robot.close)
    house.start()
    loop = house.loop
    timer = LoopTimer(SAMPLE_PERIOD)
    sample = robot.read()

    def exchange() -> None:
        nonlocal sample
        sample = robot.exchange(math.nan)

    woke, compute = 0, 0
    end = None if duration is None else time.monotonic_ns() + round(duration * 1e9)
    with ended_in_order(house, stop), steady():
        while not stop.reason:
            now, periods = timer.wait()
            loop.ticked = now
            let_pass(exchange, periods, simulated=robot.specification.simulated)
            if link.inboxes["settings"]:
                chosen = link.take("settings")[-1][1]
                state.returned.change(
                    delay=chosen.force_delay, jitter=chosen.jitter, loss=chosen.loss, outage=chosen.outage
                )
                state.score, changed_ns = ShadowScore(), now
            # Cleared only if set: a signal may come at any moment and must not be lost.
            if release := stop.release:
                asked, stop.release = "", False
            for _, message in link.take("emergency"):
                asked = message.reason or "no reason given"
            if stop.emergency:
                asked, stop.emergency = stop.emergency, ""
            if link.inboxes["stop"]:
                stop.set(link.take("stop")[-1][1].reason)
            if end is not None and now >= end:
                stop.set("the duration is over")
            period = timer.woke_ns - woke if woke else 0
            inputs = follower.Inputs([], sample, period, compute, release=release)
            woke = timer.woke_ns
            began = time.perf_counter_ns()
            state, outputs = step(state, inputs, now)
            compute = time.perf_counter_ns() - began
            link.publish(outputs.record)
            link.publish(outputs.telemetry)
            if outputs.model is not None:
                link.publish(outputs.model)
    score, delay = state.score, state.returned.delay
    say(f"shadow: {score.sentence(delay)}")
    figures = {"force_delay_s": delay} | score.figures()
    return {"ended": stop.reason} | figures | follower_counts(state.following) | link_counts("follower", link)
