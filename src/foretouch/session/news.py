"""What the sides say to people: one sentence while something is not as it should be."""

from __future__ import annotations

from collections.abc import Mapping

from foretouch.identification import SENSOR_SENTENCES, SensorState
from foretouch.messages import PROCESS, STATUS_SENTENCES, Status
from foretouch.session import follower
from foretouch.session.heard import Heard
from foretouch.session.lease import LEASE
from foretouch.session.waiting import release_command

__all__ = [
    "all_of",
    "connected",
    "failure_news",
    "follower_news",
    "follower_says",
    "leader_news",
    "over",
    "shadow_news",
]

LONGEST_SILENCE = 0.5
"""An operator is told that nothing comes of the follower after so long [s]."""


def follower_says(state: follower.State, contest: str) -> dict[str, str]:
    """What a follower's `Hello` says beside its settings: its process, who holds control, and what is amiss.

    Args:
        state: Of the follower.
        contest: Who else would command (`foretouch.session.contest.Contest`).
    """
    return {
        PROCESS: str(state.run),
        "control": state.lease.holder,
        "contest": contest,
        "trouble": follower_news(state),
        "stopped": state.safety.stop_reason,
    }


def all_of(*sentences: str) -> str:
    """Those that say something, as one."""
    return "; ".join(filter(None, sentences))


def connected(role: str, heard: Mapping[str, Mapping[str, str]]) -> str:
    """One sentence once the other side of a session has said hello; else ""."""
    other = "follower" if role == "leader" else "leader"
    if other not in heard:
        return ""
    texts = heard[other]
    if other == "leader":
        return f"connected: the leader is {texts.get('leader', 'without a name')}"
    robot, material = texts.get("robot", "without a name"), texts.get("material")
    pressed = f", it presses {material}" if robot == "simulated" and material else ""
    return f"connected: the follower's robot is {robot}{pressed}"


def over(state: follower.State) -> str:
    """One sentence about the robot once there is nothing more to say of it by `follower_news`."""
    return f"that is over: the robot {STATUS_SENTENCES[state.safety.status]}"


def follower_news(state: follower.State) -> str:
    """One sentence about the robot while it does not follow the commands that there were; else ""."""
    safety, watch = state.safety, state.watch
    if safety.stop_reason and watch.state is not SensorState.GOOD:
        why = f"nobody knows what it feels, and it goes out as it came: {SENSOR_SENTENCES[watch.state]}"
        return f"emergency stop ({safety.stop_reason}): {why}; once that is mended: {release_command()}"
    if safety.stop_reason:
        left = "unloads" if safety.pressing else "is unloaded"
        return f"emergency stop ({safety.stop_reason}): it {left}; to release it at rest: {release_command()}"
    if watch.state is not SensorState.GOOD:
        again = f"; once that is mended: {release_command()}"
        held = "the robot learns nothing, holds its place and then goes out as it came"
        return f"{held}: {SENSOR_SENTENCES[watch.state]}{again}"
    if safety.status in (Status.HOLDING, Status.UNLOADING, Status.RETREATING, Status.TOO_SLOW) and state.lease.epoch:
        return "; ".join(filter(None, (f"the robot {STATUS_SENTENCES[safety.status]}", failure_news(state))))
    return failure_news(state)


def failure_news(state: follower.State) -> str:
    """One sentence where something raised in the follower's step; else ""."""
    failures = state.failures
    if not failures.count:
        return ""
    goes_on = "it is kept safe" if failures.learns else "nothing more is learnt until it is started again"
    return f"the follower has a fault: {failures.sentence}; {goes_on}"


def leader_news(heard: Heard, follower_texts: Mapping[str, str], silence: float = 0.0, *, nowhere: bool = False) -> str:
    """One sentence for an operator whose commands are not obeyed, or who does not know whether they are; else "".

    Args:
        heard: Of the follower.
        follower_texts: What its newest `Hello` says.
        silence: Time since anything came of it [s].
        nowhere: Whether the operator's device gives no position.
    """
    if nowhere:
        return "the device gives no position: the last one is held"
    if heard.run and silence > LONGEST_SILENCE:
        return "nothing is heard of the follower: the hand still feels the newest model, not what the robot does now"
    if heard.shadows:
        return f"the robot {STATUS_SENTENCES[Status.SHADOW]}"
    if heard.in_control:
        return all_of(follower_texts.get("contest", ""), follower_texts.get("trouble", ""))
    other = follower_texts.get("control") or "another leader"
    if heard.had_control:
        return f"lost control to {other}: start this leader again to have it back"
    return f"{other} holds control: this leader has it after {LEASE:g} s of silence"


def shadow_news(state: follower.State, asked: str) -> str:
    """One sentence for who moves a robot that is only watched; else "".

    Args:
        state: Of the follower that watches.
        asked: Why an emergency stop was asked for; empty while none was.
    """
    if asked:
        return f"emergency stop ({asked}): nothing is commanded from here, so stop the robot where it is moved"
    if state.watch.state is not SensorState.GOOD:
        again = f"; once that is mended: {release_command()}"
        return f"nothing is learnt: {SENSOR_SENTENCES[state.watch.state]}{again}"
    return failure_news(state)
