"""A follower that estimates and predicts and commands nothing: for a first day on a real robot.

Somebody else moves the robot. Both steps of a session run in this one process: the leader's hand is the robot's own
measured position, and the models reach it as late as the settings say. What would have been rendered is there to be
seen, recorded and scored; what the follower would have done stays in here.

How well the force is predicted while it is felt is kept in a few sums.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import msgspec

from foretouch.identification.conditioning.kernel import CONTACT_FLOOR
from foretouch.link import FaultStage, ZenohLink
from foretouch.messages import PROCESS, LeaderState, ModelUpdate, Status, Telemetry
from foretouch.robot import Robot, RobotSample, RobotSpecification
from foretouch.session.frames import framed_robot
from foretouch.session.network.lease import own_epoch
from foretouch.session.processes.housekeeping import Housekeeper, StopFlag
from foretouch.session.processes.news import shadow_news
from foretouch.session.runners.live import ended_in_order
from foretouch.session.runners.loop_timer import LoopTimer, let_pass, steady
from foretouch.session.runners.warm_up import prepare
from foretouch.session.settings import NO_GRIP, SAMPLE_PERIOD, SessionSettings
from foretouch.session.steps import follower, leader
from foretouch.session.steps.counting import as_texts, fault_texts, follower_counts, leader_counts, link_counts

SCORED_AFTER = 1.5
"""Scoring begins so long after the first tick [s], as in a session's report."""

LONGEST_TICK = 0.1
"""A tick counts for the time since the one before, at most this [s]: longer, and nobody was looking."""


class ShadowScore:
    r"""Sums of squares over the ticks in contact, and over those in which contact was predicted; memory is flat.

    .. math:: e = 100 \sqrt{\operatorname{mean}_S (\hat F - F)^2} \Big/ \sqrt{\operatorname{mean}_C F^2}

    as in a session's report, with one difference: C is what the follower takes for contact while it happens, for the
    report's threshold is known at the end alone. S is C and the ticks whose prediction is above the contact floor.

    Attributes:
        contact_time: Time in contact that was scored [s].
    """

    __slots__ = ("_before_ns", "_began_ns", "_contact", "_delayed", "_felt", "_predicted", "_scored", "contact_time")

    def __init__(self) -> None:
        self._began_ns: int | None = None
        self._before_ns = 0
        self._contact = self._scored = 0
        self._felt = self._predicted = self._delayed = 0.0
        self.contact_time = 0.0

    def add(self, now_ns: int, force: float, predicted: float, delayed: float, in_contact: bool) -> None:
        """Take one tick.

        Args:
            now_ns: Monotonic clock [ns].
            force: Felt [N].
            predicted: By the newest model that had arrived [N].
            delayed: The newest that had arrived [N]; one that is no number counts as 0.
            in_contact: Whether the robot is.
        """
        if self._began_ns is None:
            self._began_ns = now_ns
        since, self._before_ns = (now_ns - self._before_ns) * 1e-9, now_ns
        if (now_ns - self._began_ns) * 1e-9 < SCORED_AFTER or not math.isfinite(force):
            return
        if in_contact:
            self._contact += 1
            self._felt += force * force
            self.contact_time += min(since, LONGEST_TICK)
        # Not "above": a prediction that is no number is an error without bound.
        if in_contact or not predicted <= CONTACT_FLOOR:
            self._scored += 1
            self._predicted += (predicted - force) ** 2
            self._delayed += ((delayed if math.isfinite(delayed) else 0.0) - force) ** 2

    @property
    def contact_force_rms(self) -> float:
        """[N]; NaN without contact."""
        return math.sqrt(self._felt / self._contact) if self._contact else math.nan

    @property
    def prediction_error_percent(self) -> float:
        """Of the predicted force; NaN without contact."""
        return self._error(self._predicted)

    @property
    def delayed_force_error_percent(self) -> float:
        """Of the delayed force; NaN without contact."""
        return self._error(self._delayed)

    def sentence(self, delay: float) -> str:
        """The figures in a line.

        Args:
            delay: At which the models came [s].
        """
        if not self.contact_time > 0.0:
            return f"nothing was touched after the first {SCORED_AFTER:g} s: there is nothing to compare"
        return (
            f"{self.contact_time:.1f} s in contact at {self.contact_force_rms:.2f} N RMS; the predicted force was "
            f"wrong by {self.prediction_error_percent:.1f} % of that, the force {delay:g} s late by "
            f"{self.delayed_force_error_percent:.1f} %"
        )

    def _error(self, squares: float) -> float:
        felt = self.contact_force_rms
        return 100.0 * math.sqrt(squares / self._scored) / felt if felt > 0.0 else math.nan


SHADOW_CHANNELS = ("settings", "stop", "emergency", "hello")
"""What the link of a shadow receives: no commands."""

NAME = "shadow"
"""Of the leader inside, and of the session's operator in what is recorded."""


@dataclass(slots=True)
class State:
    """What a shadow remembers from tick to tick; updated in place.

    Attributes:
        following: The follower's step.
        leading: The leader's, in an open loop.
        returned: What is on its way from the first to the second.
        score: How well the force was predicted so far.
    """

    following: follower.State
    leading: leader.State
    returned: FaultStage[ModelUpdate | Telemetry]
    score: ShadowScore = field(default_factory=ShadowScore)


class Inputs(NamedTuple):
    """What a tick is given.

    Attributes:
        sample: What the robot's sensors show.
        period_ns: Since the last tick began [ns].
        compute_ns: That the last tick's computing took, of both sides [ns].
        release: Whether somebody at the robot says that the sensors are mended.
    """

    sample: RobotSample
    period_ns: int
    compute_ns: int
    release: bool = False


class Outputs(NamedTuple):
    """What a tick gives: all that a session's two sides say, and nothing for the robot."""

    record: LeaderState
    telemetry: Telemetry
    model: ModelUpdate | None


def shadow_settings(settings: SessionSettings) -> SessionSettings:
    """The settings with nobody's hand in them: none commands, feels the force, or has a clutch, scales or a frame.

    Args:
        settings: Of the session.
    """
    return replace(
        settings,
        position_delay=0.0,
        grip=NO_GRIP,
        clutch="",
        largest_stiffness=0.0,
        position_scale=1.0,
        force_scale=1.0,
        leader_frame="0,1",
        first_touch="follow",
        baseline="none",
    )


def start(specification: RobotSpecification, settings: SessionSettings, *, epoch: int = 1, run: int = 1) -> State:
    """State before the first tick.

    Args:
        specification: Of the robot.
        settings: Of the session, as `shadow_settings` leaves them.
        epoch: Of the leader inside (`foretouch.session.network.lease.own_epoch`).
        run: Epoch of this process.
    """
    return State(
        follower.start(specification, settings, run=run),
        leader.start(settings, holder=NAME, epoch=epoch),
        FaultStage(settings.return_faults),
    )


def step(state: State, inputs: Inputs, now_ns: int) -> tuple[State, Outputs]:
    """One tick: the leader at the robot's own position, then the follower, which applies that command at once.

    At equal command both are at the same position, so that what is compared there is the force alone, and a predicted
    force is as old as the model that it comes from.

    Args:
        state: Updated in place and returned.
        inputs: Of this tick.
        now_ns: Monotonic clock [ns].
    """
    sample, period_ns, compute_ns, release = inputs
    arrived = state.returned.pop_due(now_ns)
    models = [message for message in arrived if type(message) is ModelUpdate]
    telemetry = [message for message in arrived if type(message) is Telemetry]
    hand = follower.tip(state.following, sample)
    state.leading, led = leader.step(
        state.leading, leader.Inputs(hand, models, telemetry, period_ns, compute_ns), now_ns
    )
    state.following, acted = follower.step(
        state.following,
        follower.Inputs([led.command], sample, period_ns, compute_ns, release=release),
        now_ns,
    )
    state.following.released_tick = 0  # nothing is obeyed here: nobody has to know that sensors were mended
    # The robot was told nothing; and what the safety layer would have done about it is no news.
    said = msgspec.structs.replace(acted.telemetry, desired_position=math.nan, status=Status.SHADOW)
    state.returned.push(now_ns, said)
    if acted.model is not None:
        state.returned.push(now_ns, acted.model)
    if not said.validity:
        state.score.add(now_ns, said.force, led.record.predicted_force, led.record.delayed_force, said.in_contact)
    return state, Outputs(led.record, said, acted.model)


def run_shadow(
    link: ZenohLink,
    robot: Robot,
    settings: SessionSettings,
    *,
    stop: StopFlag,
    say: Callable[[str], None],
    description: dict[str, str],
    duration: float | None = None,
    parent: int | None = None,
) -> dict[str, str | int | float]:
    """Watch a robot until a `Stop` arrives, `stop` is set, or `duration` [s] is over; then say how well it went.

    An emergency stop stops nothing here, and who asks for one is told so. The console's force delay is taken, and
    scoring begins anew with it.

    Args:
        link: With `SHADOW_CHANNELS`.
        robot: That somebody else moves; it is given no position. It counts as the settings' follower frame says.
        settings: Of the session; what is the hand's among them is left out.
        stop: Looked at in every tick.
        say: Prints one line for people.
        description: Further texts for the `Hello` messages.
        duration: [s], None for no end.
        parent: Process whose end ends this one.

    Returns:
        Why it ended, as ``ended``, how well it went, and what was counted, by name.
    """
    settings = shadow_settings(settings)
    if never_begun := prepare(settings, stop, say, parent):
        return {"ended": never_begun}
    robot = framed_robot(robot, settings.frames[1])
    epoch = own_epoch()
    state = start(robot.specification, settings, epoch=epoch, run=epoch)
    texts = settings.as_text() | {"operator": NAME} | description
    asked, changed_ns = "", 0

    def news() -> str:
        return shadow_news(state.following, asked)

    def describe() -> dict[str, str]:
        counts = leader_counts(state.leading) | follower_counts(state.following) | link_counts("follower", link)
        told = {PROCESS: str(epoch), "control": "nobody", "trouble": news()}
        return texts | fault_texts(state.returned, "force_delay", changed_ns) | told | as_texts(counts)

    house = Housekeeper(link, "follower", describe, stop, say, parent, lambda _: news(), release=robot.close)
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
            # Taken only where it is there: a signal may come at any moment, and is not to be lost.
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
            inputs = Inputs(sample, timer.woke_ns - woke if woke else 0, compute, release)
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
    figures = {
        "force_delay_s": delay,
        "contact_time_s": score.contact_time,
        "contact_force_rms_N": score.contact_force_rms,
        "prediction_error_percent": score.prediction_error_percent,
        "delayed_force_error_percent": score.delayed_force_error_percent,
    }
    return {"ended": stop.reason} | figures | follower_counts(state.following) | link_counts("follower", link)
