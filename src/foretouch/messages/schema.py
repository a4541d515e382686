"""Every message, field by field. SI units; a field in nanoseconds says so in its name.

On the wire a message is a msgpack array whose first element is `VERSION`. Times are the sender's own monotonic
clock: nothing may compare them with the receiver's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import IntEnum
from typing import Annotated

import msgspec

from foretouch.quantities import brief_text

VERSION = 16
"""Version of the schema. It changes with every change of a field or a key; peers must agree."""

Count = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
Text = Annotated[str, msgspec.Meta(max_length=400)]
Numbers = Annotated[tuple[float, ...], msgspec.Meta(max_length=4096)]
Content = Annotated[bytes, msgspec.Meta(max_length=4096)]
LONGEST_NAME, LONGEST_VALUE, MOST_TEXTS = 64, 1024, 128
"""Characters of a name and of a value among the texts of a `Hello`, and how many texts one may have."""
Name = Annotated[str, msgspec.Meta(max_length=LONGEST_NAME)]
Value = Annotated[str, msgspec.Meta(max_length=LONGEST_VALUE)]
Names = Annotated[tuple[Name, ...], msgspec.Meta(max_length=MOST_TEXTS)]
Values = Annotated[tuple[Value, ...], msgspec.Meta(max_length=MOST_TEXTS)]
SIDES = ("leader", "follower")
"""The sides of a session: each has to understand the other."""
SPEAKERS = (*SIDES, "camera", "recorder", "supervisor", "doctor")
"""Roles that send hellos on a network. No other role is taken, so that storage by role is bounded."""
Speaker = Annotated[str, msgspec.Meta(pattern=rf"^({'|'.join(SPEAKERS)})\Z")]
Pose = Annotated[tuple[float, ...], msgspec.Meta(max_length=6)]
Place = Annotated[tuple[float, ...], msgspec.Meta(max_length=3)]
"""Position of a point in the world [m], or empty."""
FRICTION_NUMBERS = 8
"""Numbers of a `ModelUpdate` that tell of friction, where it is known."""
Chosen = Annotated[str, msgspec.Meta(max_length=64, pattern=r"^[A-Za-z0-9_.-]*\Z")]
"""Name of a material, an operator or a grip, or "": nothing that is a path or an option."""


class Status(IntEnum):
    """State of a follower; `STATUS_SENTENCES` has the sentence."""

    FOLLOWING = 0
    GUARDED = 1
    RETURNING = 2
    HOLDING = 3
    UNLOADING = 4
    RETREATING = 5
    STOPPED = 6
    SENSOR_FAULT = 7
    SHADOW = 8
    TOO_SLOW = 9
    OBSTRUCTED = 10


STATUS_SENTENCES = {
    Status.FOLLOWING: "follows the commands",
    Status.GUARDED: "touches what the leader does not know yet: holds back",
    Status.RETURNING: "goes slowly back to the commands",
    Status.HOLDING: "hears no fresh command: holds its place",
    Status.UNLOADING: "has heard no fresh command for long: goes back until it feels next to nothing, and stays",
    Status.RETREATING: "has heard no fresh command for long: goes out the way that it came",
    Status.STOPPED: "emergency stop: unloaded, until it is released at the follower",
    Status.SENSOR_FAULT: "its sensors are not to be trusted: learns nothing, holds, and then goes out as it came",
    Status.SHADOW: "learns and predicts, and commands nothing: somebody else moves the robot",
    Status.TOO_SLOW: "makes fewer than 500 ticks a second, too few to be safe: holds its place",
    Status.OBSTRUCTED: "has met something beside its probe: holds, and waits for a command that leads back from there",
}
"""Meaning of each `Status`, as the end of a sentence that begins with "The robot"."""

WITH_THE_COMMANDS = (Status.FOLLOWING, Status.GUARDED, Status.SHADOW)
"""Statuses in which the robot is where a command says, is reported as held back, or moves the command itself."""


class Message(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True, gc=False):
    """The fields of all messages: the version, the sender's running number and the sender's clock.

    Attributes:
        version: `VERSION` of the sender.
        sequence: Running number of this kind of message at the sender, from 1.
        time_ns: Sender's monotonic clock at the tick that made the message [ns].
    """

    version: Count
    sequence: Count
    time_ns: Count

    def __repr__(self) -> str:
        """At most ten lines, however much a map or an image holds."""
        return brief_text(type(self).__name__, zip(self.__struct_fields__, msgspec.structs.astuple(self), strict=True))


class Command(Message, frozen=True, array_like=True, gc=False):
    """Leader to follower, every leader tick: where the operator is.

    Attributes:
        position: Desired probe position [m].
        acknowledged_model: `sequence` of the newest model that the leader renders from, 0 before the first.
        guarded: Whether the first touch of a surface that the leader does not know is to be guarded.
        holder: Name of the leader, for people.
        epoch: Epoch of the leader's process: unique, and larger for one that was started later.
        place: Desired position of the probe in three dimensions, a sphere's centre; empty in a session along a line.
        telemetry_sequence: `sequence` of the newest telemetry that the leader had received, 0 before the first.
        run: Epoch of the follower's process that sent it, 0 before the first.
    """

    position: float
    acknowledged_model: Count
    guarded: bool = False
    holder: Name = ""
    epoch: Count = 0
    place: Place = ()
    telemetry_sequence: Count = 0
    run: Count = 0


class ModelUpdate(Message, frozen=True, array_like=True, gc=False):
    """Follower to leader, about 50 a second and at once on change: the identified contact model.

    Attributes:
        command_sequence: The command that the follower had applied when `state` was taken, 0 before the first.
        law: Name of the contact law, for example ``"linearised-continuous-switching"``.
        parameters: The law's numbers, in the order that the law declares.
        state: Memory of the material at `command_sequence`; empty for laws without memory.
        surface: Position of the undeformed surface [m].
        valid: Whether a force may be rendered from it.
        reason: One sentence: why it is not valid, or what there is to know.
        estimator: Name of the estimator that made it.
        map: Learnt quantities beside the parameters, as the law packs them; empty for laws that are their parameters.
        epoch: Epoch of the leader that sent `command_sequence`, 0 before the first.
        run: Epoch of the follower's own process: `sequence` counts from 1 in each.
        fixture: In three dimensions, the pose of the fixture in the world, a position [m] and a rotation vector [rad];
            `surface` is then how much deeper than its known shape the surface was felt [m]. Empty along a line.
        fixture_deviation: Standard deviation of each of these numbers, of the error on the pose's right.
        fixture_age: Time since an image showed it [s], infinite before the first.
        friction: Coefficient of Coulomb friction and of viscous friction [N s/m], and the standard deviation of each,
            empty while it is not known; then with its standard deviation each the stiffness with which the surface
            yields before it slides [N/m], and how much larger the coefficient is at rest [-]: 0 while not known.
        standard_errors: Standard error of each of `parameters`, NaN where undetermined; empty where none are given.
    """

    command_sequence: Count
    law: Text
    parameters: Numbers
    state: Numbers
    surface: float
    valid: bool
    reason: Text
    estimator: Text
    map: Content
    epoch: Count = 0
    run: Count = 0
    fixture: Pose = ()
    fixture_deviation: Pose = ()
    fixture_age: float = math.inf
    friction: Annotated[tuple[float, ...], msgspec.Meta(max_length=FRICTION_NUMBERS)] = ()
    standard_errors: Numbers = ()


class Handle(Message, frozen=True, array_like=True, gc=False):
    """Console to leader, on every mouse move: where the handle is and whether it is held.

    Attributes:
        position: Handle position [m], along the axis of the probe.
        held: True while the handle is dragged.
        clutched: True while the clutch is pressed: the hand moves and the follower stays.
        place: Position of the handle in the world, in a session in three dimensions; empty along a line.
    """

    position: float
    held: bool
    clutched: bool = False
    place: Place = ()


class Settings(Message, frozen=True, array_like=True, gc=False):
    """Console to both sides, latest wins: what is done to messages on top of the network.

    Jitter, loss and outage are done in either direction, as in `foretouch.link.Faults`.

    Attributes:
        position_delay: One-way delay of commands [s], 0 to 10.
        force_delay: One-way delay of models and telemetry [s], 0 to 10.
        jitter: Largest change of either delay, to either side [s], 0 to 10.
        loss: Fraction of messages lost, 0 to 0.9.
        outage: Length of an outage in every 10 s [s], 0 to 10.
    """

    position_delay: Annotated[float, msgspec.Meta(ge=0, le=10)]
    force_delay: Annotated[float, msgspec.Meta(ge=0, le=10)]
    jitter: Annotated[float, msgspec.Meta(ge=0, le=10)] = 0.0
    loss: Annotated[float, msgspec.Meta(ge=0, le=0.9)] = 0.0
    outage: Annotated[float, msgspec.Meta(ge=0, le=10)] = 0.0


class Choice(Message, frozen=True, array_like=True, gc=False):
    """Console to the process that supervises the others: settings to go on with, and whether to record.

    What is "" stays as it is. What cannot be had (an unknown name) is refused there and reported in its `Hello`.

    Attributes:
        material: Material that the simulated robot presses from now on.
        operator: Operator that moves the leader.
        grip: Grip of the hand on the device.
        record: ``"start"`` a new recording, ``"stop"`` the one that is written.
    """

    material: Chosen = ""
    operator: Chosen = ""
    grip: Chosen = ""
    record: Annotated[str, msgspec.Meta(pattern=r"^(start|stop)?\Z")] = ""


class Stop(Message, frozen=True, array_like=True, gc=False):
    """Anyone to all: end the session.

    Attributes:
        reason: One sentence.
        epoch: Epoch of the leader that sends it, 0 from others: a leader without control ends no session.
    """

    reason: Text
    epoch: Count = 0


class EmergencyStop(Message, frozen=True, array_like=True, gc=False):
    """Anyone to the follower, again and again until its telemetry says that it has stopped.

    The follower unloads and stays so until it is released there.

    Attributes:
        reason: One sentence.
        press: The same number in all that one press of a button makes, and in no other: what comes of it after the
            release causes no further stop. 0 for one without a number.
    """

    reason: Text
    press: Count = 0


class Hello(Message, frozen=True, array_like=True, gc=False):
    """All to all, twice a second: the sender's role, and the settings of the session.

    It begins alike in every version, with version, sequence, time and role, so that peers of different versions can
    tell each other so (`foretouch.messages.foreign_speaker`).

    Attributes:
        role: One of `SPEAKERS`; in recordings also ``"simulation"``.
        names: Names of the texts that follow, for example ``"material"``.
        values: The texts, one for each name.
    """

    role: Speaker
    names: Names
    values: Values

    @classmethod
    def of(cls, role: str, sequence: int, time_ns: int, texts: Mapping[str, str]) -> Hello:
        """One with these texts, cut where they are longer than a peer takes them."""
        kept = list(texts.items())[:MOST_TEXTS]
        names = tuple(name[:LONGEST_NAME] for name, _ in kept)
        return cls(VERSION, sequence, time_ns, role, names, tuple(value[:LONGEST_VALUE] for _, value in kept))

    @property
    def texts(self) -> dict[str, str]:
        """The texts by name."""
        return dict(zip(self.names, self.values, strict=False))


class LeaderPacket(Message, frozen=True, array_like=True, gc=False):
    """Leader to follower over a thin link, instead of all else: records of `foretouch.session.thin`.

    Attributes:
        content: One record behind another; `time_ns` is 0.
        sender: Name of the certificate that sent it, which the link of the receiver puts in: "" on the network, and
            where there are no certificates.
    """

    content: Content
    sender: Name = ""


class FollowerPacket(Message, frozen=True, array_like=True, gc=False):
    """Follower to leader over a thin link, instead of all else: records of `foretouch.session.thin`.

    Attributes:
        content: One record behind another; `time_ns` is 0.
    """

    content: Content


class SmallImage(Message, frozen=True, array_like=True, gc=False):
    """Camera to the follower beside it: a small image for the other end of a thin link.

    Attributes:
        content: Bytes of a `CameraImage`; `sequence` counts the small ones, and `time_ns` is 0.
    """

    content: Content
