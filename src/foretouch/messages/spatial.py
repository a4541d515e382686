"""Messages that sessions in three dimensions have beside the others; a session along a line sends none of them.

Vectors are in the world's frame, one field a component. A pose is a place [m] and a rotation vector [rad]. In such a
session the positions and forces of `Telemetry`, `LeaderState` and `ModelUpdate` are those along the surface's normal.
"""

from __future__ import annotations

import math
from typing import Annotated

import msgspec

from foretouch.messages.schema import Count, Message, Text

POSE_NUMBERS = 6
CAMERA_NUMBERS = 15

Field = Annotated[bytes, msgspec.Meta(max_length=32_768)]
LARGEST_JPEG = 45_000
"""[bytes]: with everything else that a `CameraImage` may hold it is less than `foretouch.messages.LARGEST_MESSAGE`."""

Jpeg = Annotated[bytes, msgspec.Meta(max_length=LARGEST_JPEG)]
Pose = Annotated[tuple[float, ...], msgspec.Meta(max_length=POSE_NUMBERS)]
Covariance = Annotated[tuple[float, ...], msgspec.Meta(max_length=POSE_NUMBERS**2)]
Camera = Annotated[tuple[float, ...], msgspec.Meta(max_length=CAMERA_NUMBERS)]


class FollowerSpace(Message, frozen=True, array_like=True, gc=False):
    """Follower to all that watch, every follower tick, beside the `Telemetry` of the same sequence.

    Attributes:
        place_x: Position of the probe's tip, from the encoders [m].
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
        run: Epoch of the follower's process.
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
    run: Count = 0


class LeaderSpace(Message, frozen=True, array_like=True, gc=False):
    """Leader to all that watch, every leader tick, beside the `LeaderState` of the same sequence.

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
        energy: Energy that the hand has put into the force, in all directions: see `LeaderState` [J].
        energy_bound: Most energy that it may have given out [J].
        epoch: Epoch of this leader's process.
        late_energy: Energy that late ticks and missing positions have taken beside it, never positive [J].
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
    energy: float
    energy_bound: float
    epoch: Count = 0
    late_energy: float = 0.0


class FieldUpdate(Message, frozen=True, array_like=True, gc=False):
    """Follower to leader, some times a second while it changes: the materials learnt over the surface.

    Attributes:
        content: A `foretouch.models.MaterialField` as it packs itself.
        run: Epoch of the follower's process.
    """

    content: Field
    run: Count = 0


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
