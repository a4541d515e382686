"""What both sides say of themselves in every tick, and the other messages that sessions in three dimensions have.

In such a session the positions and forces of `Telemetry`, `LeaderState` and `ModelUpdate` are those along the surface's
normal, and what there is in space is a record within. Its vectors are in the world's frame, one field a component. A
pose is a place [m] and a rotation vector [rad].
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import msgspec

from foretouch.messages.schema import Count, Message, Text

POSE_NUMBERS = 6
CAMERA_NUMBERS = 15

MOST_JOINTS = 7
"""Joints of a robot that are told of: one of more is not drawn."""

Field = Annotated[bytes, msgspec.Meta(max_length=32_768)]
LARGEST_JPEG = 45_000
"""[bytes]: with everything else that a `CameraImage` may hold it is less than `foretouch.messages.LARGEST_MESSAGE`."""

Jpeg = Annotated[bytes, msgspec.Meta(max_length=LARGEST_JPEG)]
Pose = Annotated[tuple[float, ...], msgspec.Meta(max_length=POSE_NUMBERS)]
Covariance = Annotated[tuple[float, ...], msgspec.Meta(max_length=POSE_NUMBERS**2)]
Camera = Annotated[tuple[float, ...], msgspec.Meta(max_length=CAMERA_NUMBERS)]


class FollowerSpace(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True, gc=False):
    """What a `Telemetry` says in space.

    Attributes:
        place_x: Position of the probe's tip, of a sphere its centre, from the encoders [m].
        place_y: [m].
        place_z: [m].
        desired_x: Commanded position of the robot [m].
        desired_y: [m].
        desired_z: [m].
        force_x: Contact force on the probe: the sensor's less tool and offset [N].
        force_y: [N].
        force_z: [N].
        normal_x: Outward normal of the believed surface under the probe.
        normal_y: The same.
        normal_z: The same.
        depth: Depth of the probe in the believed surface [m], negative outside.
        fixture_x: Position of the fixture as the follower believes it [m].
        fixture_y: [m].
        fixture_z: [m].
        fixture_rx: Rotation of the fixture as the follower believes it [rad].
        fixture_ry: [rad].
        fixture_rz: [rad].
        exact_x: Position of a simulated fixture [m]; NaN on a robot.
        exact_y: [m].
        exact_z: [m].
        exact_rx: Rotation of a simulated fixture [rad].
        exact_ry: [rad].
        exact_rz: [rad].
        touch_x: Position of the surface at the beginning of the newest contact [m]; NaN before the first.
        touch_y: [m].
        touch_z: [m].
        touch_tick: `sequence` of the tick in which that contact began, 0 before the first.
        joint_1: Position of the first joint from the base of a robot that has some [rad], as its encoders count it; NaN
            where there is none, or more than `MOST_JOINTS` of them: for pictures alone.
        joint_2: The same of the next.
        joint_3: The same.
        joint_4: The same.
        joint_5: The same.
        joint_6: The same.
        joint_7: The same.
    """

    place_x: float
    place_y: float
    place_z: float
    desired_x: float
    desired_y: float
    desired_z: float
    force_x: float
    force_y: float
    force_z: float
    normal_x: float
    normal_y: float
    normal_z: float
    depth: float
    fixture_x: float
    fixture_y: float
    fixture_z: float
    fixture_rx: float
    fixture_ry: float
    fixture_rz: float
    exact_x: float = math.nan
    exact_y: float = math.nan
    exact_z: float = math.nan
    exact_rx: float = math.nan
    exact_ry: float = math.nan
    exact_rz: float = math.nan
    touch_x: float = math.nan
    touch_y: float = math.nan
    touch_z: float = math.nan
    touch_tick: Count = 0
    joint_1: float = math.nan
    joint_2: float = math.nan
    joint_3: float = math.nan
    joint_4: float = math.nan
    joint_5: float = math.nan
    joint_6: float = math.nan
    joint_7: float = math.nan

    @property
    def joints(self) -> tuple[float, ...]:
        """Positions of the joints that are known, from the base on [rad]."""
        every = self.joint_1, self.joint_2, self.joint_3, self.joint_4, self.joint_5, self.joint_6, self.joint_7
        return tuple(joint for joint in every if math.isfinite(joint))


class Telemetry(Message, frozen=True, array_like=True, gc=False):
    """Follower to all that watch, every follower tick. No renderer reads it.

    `sequence` counts follower ticks.

    Attributes:
        command_sequence: The command applied in this tick, 0 before the first.
        desired_position: Commanded position of the robot [m].
        position: Probe position from the encoders, at the tip where it is calibrated what gives way before it [m].
        velocity: Estimated from the positions, causally [m/s].
        sensor_force: Sensor force less weight and inertia of the tool, offset still in it unless it is calibrated [N].
        force: The same less the offset that the follower found in free air [N].
        exact_force: The simulator's own contact force [N]; NaN on a robot, where it is unknown.
        in_contact: The follower's own judgement.
        clipped: Whether the robot's force limit cut this tick's command.
        model_sequence: Newest model sent, 0 before the first.
        period_ns: Time since the last tick began [ns].
        compute_ns: Time that this tick's computing took [ns].
        guarded: Whether the first touch was guarded: the robot held back from its command or from its speed.
        status: State of the follower: a `Status`.
        validity: Validity of this tick's sensors: 0 if they can be believed, else a
            `foretouch.identification.SensorState`. What is not valid is not learnt from, and `velocity`, `force` and
            `in_contact` are those of the last sample that was.
        epoch: Epoch of the leader that is obeyed, 0 before the first.
        run: Epoch of the follower's own process: `sequence` counts from 1 in each.
        space: In three dimensions, what there is in space; None along a line.
    """

    command_sequence: Count
    desired_position: float
    position: float
    velocity: float
    sensor_force: float
    force: float
    exact_force: float
    in_contact: bool
    clipped: bool
    model_sequence: Count
    period_ns: Count
    compute_ns: Count
    guarded: bool = False
    status: Count = 0
    validity: Count = 0
    epoch: Count = 0
    run: Count = 0
    space: FollowerSpace | None = None


class LeaderSpace(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True, gc=False):
    """What a `LeaderState` says in space; its energies are those of all directions.

    Attributes:
        hand_x: Position of the hand, scaled and indexed into the world [m]; NaN before it is coupled.
        hand_y: [m].
        hand_z: [m].
        place_x: Commanded position of the follower [m].
        place_y: [m].
        place_z: [m].
        point_x: The proxy on the rendered surface [m].
        point_y: [m].
        point_z: [m].
        normal_x: Outward normal there.
        normal_y: The same.
        normal_z: The same.
        force_x: Force that the hand is given [N].
        force_y: [N].
        force_z: [N].
        depth: Depth of the hand in the rendered surface [m], negative outside.
        stiffness: Local stiffness that is rendered there [N/m]; NaN without a model.
        fixture_x: Position at which the fixture is rendered [m].
        fixture_y: [m].
        fixture_z: [m].
        fixture_rx: Rotation with which it is rendered [rad].
        fixture_ry: [rad].
        fixture_rz: [rad].
        fixture_deviation: Standard deviation of its position [m]; NaN while nothing is known.
        fixture_turn: Standard deviation of its turn [rad].
        fixture_age: Time since an image showed it, as the follower sent it, without the delay of that message [s].
        friction: Coefficient of friction that is rendered.
        scale: How many times as strong as the law the material is rendered there.
    """

    hand_x: float
    hand_y: float
    hand_z: float
    place_x: float
    place_y: float
    place_z: float
    point_x: float
    point_y: float
    point_z: float
    normal_x: float
    normal_y: float
    normal_z: float
    force_x: float
    force_y: float
    force_z: float
    depth: float
    stiffness: float
    fixture_x: float
    fixture_y: float
    fixture_z: float
    fixture_rx: float
    fixture_ry: float
    fixture_rz: float
    fixture_deviation: float
    fixture_turn: float
    fixture_age: float
    friction: float
    scale: float


class LeaderState(Message, frozen=True, array_like=True, gc=False):
    """Leader to all that watch, every leader tick; `sequence` is that of the tick's command.

    Two positions and two scales of force: the proxy is the commanded position and that at which the model is evaluated,
    in the follower's lengths and forces; the hand is where the operator is, in the device's.

    Attributes:
        position: Position of the proxy, as the command says [m].
        velocity: Velocity of the proxy, estimated causally [m/s].
        predicted_force: The newest model at the proxy's motion, before mediation, scale and clamps [N].
        rendered_force: Force that the hand is given, after everything [N].
        delayed_force: The newest telemetry's force that had arrived; recorded, never rendered [N].
        telemetry_sequence: That telemetry's sequence, 0 before the first.
        model_sequence: The newest model that had arrived, 0 before the first.
        model_jump: Predicted force less that of the model before, had it been kept, in the tick that adopted a model
            [N]; 0 in all other ticks.
        clipped: Whether a force or force-rate limit cut the rendered force.
        period_ns: Time since the last tick began [ns].
        compute_ns: Time that this tick's computing took [ns].
        standard_deviation: Standard deviation of the predicted force [N], NaN where the model carries no uncertainty.
        hand_position: Position of the operator's hand, as the device's encoder shows it [m].
        exact_hand_position: The same from the simulated hand, without the encoder's steps [m]; NaN on a device.
        intended_position: Position that the hand intends [m]; NaN where unknown.
        mediated_force: Force for the hand after mediation and scale, before the limits [N].
        update_step: Part of this tick's change of `mediated_force` that models made, and not motion [N].
        energy: Energy from the hand into the rendered force, up to this tick [J]: debts of the session are kept,
            surplus is forgiven at the loss of each contact.
        energy_bound: Most energy that it may have given out: see `foretouch.rendering.EnergyAccount` [J].
        rendered_share: Fraction of the hand's motion that the proxy follows: 1 where the device can carry the model,
            NaN where no model is rendered.
        engaged: Whether hand and proxy are coupled: no clutch is pressed, and the follower obeys this leader.
        epoch: Epoch of this leader's process, as in its commands.
        run: Epoch of the follower whose messages arrive, 0 before the first.
        late_energy: Energy that late ticks and missing positions have taken and not given back, never positive [J].
        space: In three dimensions, what there is in space; None along a line.
    """

    position: float
    velocity: float
    predicted_force: float
    rendered_force: float
    delayed_force: float
    telemetry_sequence: Count
    model_sequence: Count
    model_jump: float
    clipped: bool
    period_ns: Count
    compute_ns: Count
    standard_deviation: float = math.nan
    hand_position: float = math.nan
    exact_hand_position: float = math.nan
    intended_position: float = math.nan
    mediated_force: float = 0.0
    update_step: float = 0.0
    energy: float = 0.0
    energy_bound: float = 0.0
    rendered_share: float = 1.0
    engaged: bool = True
    epoch: Count = 0
    run: Count = 0
    late_energy: float = 0.0
    space: LeaderSpace | None = None


def fixture_of(space: FollowerSpace | LeaderSpace) -> tuple[float, ...]:
    """Pose of the fixture at one side: a position [m] and a rotation vector [rad]."""
    return (
        space.fixture_x, space.fixture_y, space.fixture_z, space.fixture_rx, space.fixture_ry, space.fixture_rz
    )  # fmt: skip


def _row(name: str, record: type[msgspec.Struct], state: type[Message], *of_state: str) -> Any:
    """Message class of what a state says in space: the fields of the record, and behind them these of the state."""
    fields = (*msgspec.structs.fields(record), *(one for one in msgspec.structs.fields(state) if one.name in of_state))
    described = [(one.name, one.type, one.default) for one in fields]
    about = {"__doc__": f"`{record.__name__}` as a message of its own."}
    return msgspec.defstruct(
        name, described, bases=(Message,), module=__name__, namespace=about, frozen=True, array_like=True, gc=False
    )


FollowerRow = _row("FollowerRow", FollowerSpace, Telemetry, "run")
"""What `Telemetry` says in space, as a message of its own: so it stands in recordings and in tables."""

LeaderRow = _row("LeaderRow", LeaderSpace, LeaderState, "energy", "energy_bound", "epoch", "late_energy")
"""The same of `LeaderState`."""


def in_space(message: Message) -> tuple[Message, ...]:
    """What a state says in space, as a `FollowerRow` or `LeaderRow`; nothing for what else there is."""
    if not isinstance(message, Telemetry | LeaderState) or message.space is None:
        return ()
    values = (*msgspec.structs.astuple(message)[:3], *msgspec.structs.astuple(message.space))
    if isinstance(message, Telemetry):
        return (FollowerRow(*values, message.run),)
    return (LeaderRow(*values, message.energy, message.energy_bound, message.epoch, message.late_energy),)


class FieldUpdate(Message, frozen=True, array_like=True, gc=False):
    """Follower to leader, ten times a second: how strong the material is, place by place, as far as there is news.

    Attributes:
        content: Nodes for `foretouch.models.ScaleField.take`.
        run: Epoch of the follower's process.
        shape: Nodes for `foretouch.models.ShapeField.take` of a surface that nobody knew; empty where one is known.
    """

    content: Field
    run: Count = 0
    shape: Field = b""


class CameraImage(Message, frozen=True, array_like=True, gc=False):
    """Camera to all that watch, and to the follower: one image and what it says of the fixture.

    Attributes:
        tick: `Telemetry.sequence` of the follower's tick that it shows; by it and no clock the image has its time.
        jpeg: The image, 45 kB at most; empty where the stream dropped it.
        pose: Pose of the fixture in the world, 6 numbers; empty where the image shows no board.
        covariance: Covariance of its error on the right (`foretouch.quantities.Pose`), 36 numbers, by row; or empty.
        markers: Number of the board's markers that were found.
        reason: Reason that there is no pose, a sentence; empty where there is one.
        camera: f_x, f_y, c_x, c_y [pixel], k1, k2, p1, p2, k3, and the camera's pose in the world.
        run: Epoch of the follower's process whose tick it is.
    """

    tick: Count
    jpeg: Jpeg
    pose: Pose
    covariance: Covariance
    markers: Count
    reason: Text
    camera: Camera
    run: Count = 0


class FixtureBelief(Message, frozen=True, array_like=True, gc=False):
    """Tracker to the follower, after every image and contact: where the fixture is.

    Attributes:
        pose: Pose of the fixture in the world, a position [m] and a rotation vector [rad].
        covariance: Covariance of its error on the right (`foretouch.quantities.Pose`) [m, rad], 36 numbers, row by row.
        image_age: Time since an image showed it [s]; infinite before the first.
        images: Number of images used since the start.
        contacts: Number of contacts used since the start.
        refused: Number of images and contacts refused since the start.
        reason: State of knowledge, a sentence for people.
        run: Epoch of the follower's process whose ticks it is made from.
        epoch: Epoch of the tracker's own process: its `sequence` counts from 1 in each.
    """

    pose: Pose
    covariance: Covariance
    image_age: float
    images: Count
    contacts: Count
    refused: Count
    reason: Text
    run: Count = 0
    epoch: Count = 1

    @property
    def deviation(self) -> tuple[float, ...]:
        """Standard deviation of each number of the pose [m, rad]; empty where no whole covariance was sent."""
        if len(self.covariance) != POSE_NUMBERS**2:
            return ()
        return tuple(math.sqrt(max(number, 0.0)) for number in self.covariance[:: POSE_NUMBERS + 1])
