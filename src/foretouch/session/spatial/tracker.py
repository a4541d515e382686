"""The tracker's step: takes images, touches and slides; gives the believed pose of the fixture.

It stands beside the camera, at the follower, in a process of its own: the filter takes longer than a tick of the loops.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from foretouch.identification.shape_learner import SLOPE_DEVIATION, SLOWEST, WEAKEST
from foretouch.messages import VERSION, CameraImage, FixtureBelief, FollowerSpace, Telemetry
from foretouch.quantities import Pose
from foretouch.quantities.pose import norm, scaled
from foretouch.session.spatial.sliding import Sliding
from foretouch.vision import ContactSeen, FixtureFilter, FusionSettings, ImageSeen, SlideSeen, TouchedSurface, Verdict

TOUCH_DEVIATION = 2e-4
"""Standard deviation of where a touch puts the surface along its normal [m]: encoders, sensor noise, softness."""

SLIDE_PERIOD = 0.05  # Time between two slides that are taken [s]
SLIDE_DEVIATION = SLOPE_DEVIATION / math.sqrt(SLIDE_PERIOD / 0.01)
"""Standard deviation of each: they tell as much in a second as the slopes of a shape, of which there are 100."""

FIRST_TICKS = 100  # Largest tick number at a tracker's first contact with the follower for which it has missed no touch
REMEMBERED = 3000  # Number of ticks whose times are remembered: images come late

SECOND = 1e-9
SENDING_PERIOD = 0.03  # Time after which the belief is sent again, for its uncertainty grows [s]


@dataclass(slots=True)
class State:
    """State of the tracker; updated in place.

    Attributes:
        times: The follower's clock by its ticks [ns].
        sliding: Motion of the probe, and the force on it.
        ticked: Time of the newest tick [ns].
        slid: Time of the newest slide that was taken [ns].
        touch_tick: Tick of the newest touch that was taken.
        gone: Runs of the follower processes before the current one.
        pose_seen: Pose in the newest image that showed the board.
        sent: Time of the newest belief [s].
    """

    filter: FixtureFilter
    uses_images: bool
    uses_touches: bool
    times: OrderedDict[int, int] = field(default_factory=OrderedDict)
    sliding: Sliding = field(default_factory=Sliding)
    ticked: int = 0
    slid: int = 0
    touch_tick: int = 0
    run: int = 0
    epoch: int = 1
    gone: set[int] = field(default_factory=set)
    pose_seen: tuple[float, ...] = ()
    sequence: int = 0
    sent: float = -math.inf
    images: int = 0
    contacts: int = 0
    refused: int = 0


def counts(state: State) -> dict[str, int]:
    """Numbers of images and touches used and refused."""
    return {"images_used": state.images, "contacts_used": state.contacts, "seen_refused": state.refused}


def start(
    touched: TouchedSurface,
    pose: Sequence[float],
    fusion: str = "full",
    *,
    view: tuple[float, float, float] = (0.0, 0.0, 0.0),
    time: float = 0.0,
    epoch: int = 1,
) -> State:
    """State before the first image.

    Args:
        touched: The surface in the fixture's frame.
        pose: Pose of the fixture that is believed at first: a position [m] and a rotation vector [rad].
        fusion: As `SessionSettings.fusion`.
        view: Direction in which the camera looks, in the world; of no length where it is not known.
        time: Time by the follower's clock [s].
        epoch: Epoch of this process.
    """
    believed = Pose.from_rotation_vector(pose[3:], pose[:3])
    known = FixtureFilter(touched, believed, time, FusionSettings(view=view))
    return State(known, fusion in ("full", "image"), fusion in ("full", "contact"), epoch=epoch)


def step(state: State, ticks: Sequence[Telemetry], images: Sequence[CameraImage], now_ns: int) -> FixtureBelief | None:
    """Take ticks and images since the last call, at the follower's newest time [ns]; a belief, where one is due."""
    news = False
    for tick in ticks:
        news = _take_tick(state, tick) or news
    for image in images:
        news = _take_image(state, image) or news
    now = now_ns * SECOND
    if not news and now - state.sent < SENDING_PERIOD:
        return None
    state.sent = now
    state.sequence += 1
    known = state.filter.state(now)
    pose = (*known.pose.translation.tolist(), *known.pose.rotation_vector().tolist())
    covariance, age = tuple(known.pose_covariance.ravel().tolist()), max(now - known.image_time, 0.0)
    counted = state.images, state.contacts, state.refused
    told = known.sentence(now), state.run, state.epoch
    return FixtureBelief(VERSION, state.sequence, now_ns, pose, covariance, age, *counted, *told)


def _take_tick(state: State, tick: Telemetry) -> bool:
    """Remember when a tick was; take the touch that it tells of, if that is new."""
    space = tick.space
    if space is None or tick.run in state.gone:
        return False
    if tick.run != state.run:  # what was felt before this tracker began, or before another process did, is no news
        state.gone.add(state.run)
        state.run, state.touch_tick = tick.run, space.touch_tick if state.times or tick.sequence > FIRST_TICKS else 0
        state.times.clear()
        state.sliding, state.ticked, state.slid = Sliding(), 0, 0
    state.times[tick.sequence] = tick.time_ns
    while len(state.times) > REMEMBERED:
        state.times.popitem(last=False)
    moved = _take_slide(state, tick, space)
    if space.touch_tick <= state.touch_tick:
        return moved
    state.touch_tick = space.touch_tick
    if not state.uses_touches:
        return False
    seen = ContactSeen(
        state.times.get(space.touch_tick, tick.time_ns) * SECOND,
        (space.touch_x, space.touch_y, space.touch_z),
        TOUCH_DEVIATION,
    )
    return _count(state, state.filter.update(seen), image=False)


def _take_slide(state: State, tick: Telemetry, space: FollowerSpace) -> bool:
    """Take where the probe slides, now and then; whether the pose may be another by that."""
    seconds = (tick.time_ns - state.ticked) * SECOND
    if seconds <= 0.0:  # an older one, that came later
        return False
    sliding, state.ticked = state.sliding, tick.time_ns
    sliding.take((space.place_x, space.place_y, space.place_z), (space.force_x, space.force_y, space.force_z), seconds)
    good = tick.in_contact and tick.validity == 0 and norm(sliding.force) > WEAKEST and sliding.across() > SLOWEST
    if not (good and state.uses_touches) or (tick.time_ns - state.slid) * SECOND < SLIDE_PERIOD:
        return False
    state.slid = tick.time_ns
    force = scaled(sliding.force, 1.0 / norm(sliding.force))
    motion = scaled(sliding.velocity, 1.0 / norm(sliding.velocity))
    seen = SlideSeen(tick.time_ns * SECOND, sliding.point, force, motion, SLIDE_DEVIATION)
    return state.filter.update(seen) in (Verdict.USED, Verdict.REOPENED)


def _take_image(state: State, image: CameraImage) -> bool:
    time_ns = state.times.get(image.tick)
    if not state.uses_images or time_ns is None or len(image.pose) != 6 or len(image.covariance) != 36:
        return False
    again, state.pose_seen = image.pose == state.pose_seen, image.pose
    if again or image.run != state.run:  # to the last bit: a stream that stands still
        state.refused += 1
        return False
    pose = Pose.from_rotation_vector(image.pose[3:], image.pose[:3])
    seen = ImageSeen(time_ns * SECOND, pose, np.reshape(image.covariance, (6, 6)))
    return _count(state, state.filter.update(seen), image=True)


def _count(state: State, verdict: Verdict, *, image: bool) -> bool:
    used = verdict in (Verdict.USED, Verdict.REOPENED)
    state.refused += not used
    state.images += used and image
    state.contacts += used and not image
    return used
