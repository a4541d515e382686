"""The leader's step, compiled: what it decides when a model comes and in each tick, over one record.

`foretouch.session.steps.leader` calls these functions one by one, for in space, and where a law is in Python, something
comes between them. `tick` is all of them along a line, for callers without Python.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Kernel, Record, compiled, kernel
from foretouch.models import predictor_kernel as prediction
from foretouch.models.contact_map.kernel import UNTOUCHED
from foretouch.models.contact_map.layout import HEADER, MEMORY, SIZE, Map
from foretouch.models.contact_map.wire import expand
from foretouch.models.law_kernel import MAP, NO_NUMBERS, NOTHING, PARAMETERS, form_of_wire
from foretouch.models.predictor_kernel import FourNumbers, Prediction
from foretouch.quantities import LARGEST_POSITION
from foretouch.rendering import proxy, whole
from foretouch.rendering.energy import Account
from foretouch.rendering.surfaces.line import Line
from foretouch.rendering.tick import FARTHEST, Rendering
from foretouch.rendering.whole import Ticked
from foretouch.session.steps.follower_view import View, take_model, take_telemetry

_adopt, _catch_up = prediction.adopt.function, prediction.catch_up.function
_form_of_wire, _expand = form_of_wire.function, expand.function
_take_model, _take_telemetry = take_model.function, take_telemetry.function

SAME_SURFACE = 1e-3  # Largest distance of surfaces found by two processes that count as the same surface [m]


class Shown(Record):
    """What a tick along a line came to; the fields of `foretouch.messages.LeaderState` of the same names."""

    rendered_force: float  # for the hand, negative where it draws it in [N]
    position: float = math.nan  # of the proxy, which the follower is to go to [m]; NaN until they are coupled
    engaged: bool  # whether hand and proxy are coupled
    clipped: bool  # whether a limit changed the force
    mediated_force: float  # as models are let in [N]
    step_by_models: float  # part of its newest change that is due to models [N]
    rendered_share: float = 1.0  # share of the hand's motion that the proxy takes part in until the next tick
    energy: float  # of the account [J]
    energy_bound: float  # how far it may be below zero [J]
    late_energy: float  # work beyond it that is due to late ticks [J]
    velocity: float  # of the proxy [m/s]
    predicted_force: float  # of the model [N]
    jump: float  # change of that by a new model [N]
    standard_deviation: float = math.nan  # of that, NaN where it is not known [N]


class ReceivedModel(Record):
    """A `foretouch.messages.ModelUpdate` as it came; the fields of these names."""

    run: int
    sequence: int
    epoch: int
    command_sequence: int
    law: int  # place in `foretouch.models.law_kernel.LAW_NAMES`, negative where there is none of its name
    parameters: Annotated[NDArray[Any], float, PARAMETERS]
    parameter_count: int
    state: Annotated[NDArray[Any], float, MEMORY]
    state_count: int
    surface: float  # [m]
    valid: bool
    map: Annotated[NDArray[Any], np.float32, SIZE]
    map_count: int  # numbers of the map, negative where its bytes are no numbers
    maps: Annotated[NDArray[Any], Map, 1]  # what they come to


class Leader(Record):
    """A leader: what it renders with, what it knows of its follower, and its counts."""

    renderings: Annotated[NDArray[Any], Rendering, 1]
    accounts: Annotated[NDArray[Any], Account, 1]
    predictions: Annotated[NDArray[Any], Prediction, 1]
    views: Annotated[NDArray[Any], View, 1]
    guarded: bool  # whether the follower is asked to guard the first touch
    inherits: bool  # whether the model is of a follower's process that is gone, and its successor knows less yet
    lets_go: bool  # whether the hand is let go in the next tick, for another process has taken the follower's place
    refused: int  # number of models that could not be used, whatever they claimed
    sequence: int  # of the newest command, 0 before the first
    start_ns: int = -1  # clock at the first tick, negative before it
    newest_ns: int = -1  # clock at the newest tick, negative before the first
    time: float = -math.inf  # of the newest tick that was rendered [s]
    axis: Line  # the plane that a hand along a line presses
    received: ReceivedModel
    shown: Shown


@compiled
def renew(leader: Leader, has_model: bool) -> None:
    """Start again with another follower process: it is elsewhere, and knows nothing yet."""
    prediction.disown(leader.predictions[0])
    leader.inherits, leader.lets_go = has_model, True
    if leader.renderings[0].setup.closed_loop:
        proxy.leave(leader.renderings[0].proxy)


KEPT, NOTHING_RENDERED, REFUSED, ADOPTED = range(4)
"""What is done with a model that came: the one before is kept; it says that none is valid, and nothing is rendered; it
is refused, and nothing rendered nor acknowledged, for the follower must not assume that its surface is known; or it is
rendered from now on."""


@compiled
def judge(leader: Leader, valid: bool, usable: bool, surface: float, sequence: int) -> int:
    """What is done with a model that claims to be valid, can be evaluated, has a surface [m], and a number."""
    p = leader.predictions[0]
    if leader.inherits and not (valid and leader.views[0].has_relearnt):
        if valid and abs(surface - p.surface) < SAME_SURFACE:
            p.message = sequence  # its surface is known here
        return KEPT
    if not valid:
        return NOTHING_RENDERED
    leader.inherits = False
    if usable and abs(surface) <= LARGEST_POSITION:
        return ADOPTED
    leader.refused += 1
    return REFUSED


@compiled
def begin_tick(leader: Leader, now_ns: int, period_ns: int) -> tuple[float, float, float]:
    """Begin a tick at a time of the leader's clock, this time after the last one really began [ns].

    Returns:
        Time since the first tick; since the last one really began; and on the grid of ticks [s].
    """
    if leader.start_ns < 0:
        leader.start_ns = now_ns
    measured = period_ns * 1e-9
    even = measured if leader.newest_ns < 0 else (now_ns - leader.newest_ns) * 1e-9
    leader.newest_ns = now_ns
    leader.sequence += 1
    return (now_ns - leader.start_ns) * 1e-9, measured, even


@compiled
def decide(leader: Leader, stopping: bool, clutched: bool) -> tuple[bool, bool]:
    """Whether the hand is uncoupled and feels nothing in this tick; and whether the coupling is to be changed."""
    r, view = leader.renderings[0], leader.views[0]
    lets_go, leader.lets_go = leader.lets_go, False
    free = stopping or view.stopped or not view.in_control
    # A renewed hand is let go for a tick, so that the force leaves as models do.
    return free, r.setup.closed_loop and not (free or lets_go) and (clutched or not r.proxy.engaged)


@compiled
def couple(leader: Leader, hand: float, clutched: bool) -> None:
    """Couple a hand [m] where it was left, at first where the follower is; a pressed clutch lets it go."""
    r = leader.renderings[0]
    if clutched:
        r.proxy.engaged = False
        return
    position = leader.views[0].position if math.isnan(r.proxy.position) else r.proxy.position
    if math.isfinite(position):
        whole.engage(r, leader.predictions[0], hand, position)


@compiled
def _hear(leader: Leader) -> None:
    """Start again, where a message has shown that another process has taken the follower's place."""
    view = leader.views[0]
    if view.renewed:
        view.renewed = False
        renew(leader, leader.predictions[0].law.kind != NOTHING)


@kernel("(Leader, i8, i8, i8, i8, f8, f8, f8, b1)")
def hear(
    leader: Leader,
    run: int,
    sequence: int,
    epoch: int,
    status: int,
    position: float,
    desired_position: float,
    force: float,
    in_contact: bool,
) -> None:
    """Take the fields of these names of a `foretouch.messages.Telemetry`."""
    _take_telemetry(leader.views[0], run, sequence, epoch, status, position, desired_position, force, in_contact)
    _hear(leader)


@compiled
def _form(received: ReceivedModel) -> tuple[bool, int, FourNumbers]:
    """Whether it can be evaluated, its kind and its numbers; its map is written."""
    p, count = received.parameters, received.map_count
    usable, kind, numbers = _form_of_wire(received.law, (p[0], p[1], p[2], p[3], p[4], p[5]), received.parameter_count)
    if kind == MAP:
        sized = HEADER <= count <= SIZE
        usable = sized and _expand(received.map[:count], (p[0], p[1], p[2], p[3]), received.maps)
    else:
        usable = usable and count == 0
    return usable, kind, numbers


@kernel("i8(Leader)")
def adopt(leader: Leader) -> int:
    """Take the message in `Leader.received`, if it is for this leader; what was done with it: see `judge`."""
    received, done = leader.received, KEPT
    ours = _take_model(leader.views[0], received.run, received.sequence, received.epoch)[1]
    _hear(leader)
    if not ours:
        return done
    usable, kind, numbers = False, NOTHING, NO_NUMBERS
    if received.valid:
        usable, kind, numbers = _form(received)
    surface, sequence = received.surface, received.sequence
    done = judge(leader, received.valid, usable, surface, sequence)
    if done == ADOPTED:
        s, tick = received.state, received.command_sequence if received.state_count > 0 else -1
        state = (s[0], s[1], s[2], s[3], s[4], s[5]) if received.state_count == MEMORY else UNTOUCHED
        _adopt(leader.predictions, kind, numbers, received.maps, state, surface, tick, sequence, 0)
    elif done != KEPT:
        shown = sequence if done == NOTHING_RENDERED else 0
        at = surface if done == NOTHING_RENDERED else 0.0
        _adopt(leader.predictions, NOTHING, NO_NUMBERS, received.maps, UNTOUCHED, at, -1, shown, 0)
    return done


@compiled
def _show(leader: Leader, ticked: Ticked) -> None:
    """Write down what a tick came to."""
    force, _, (position, engaged, clipped, mediated, step, share), (energy, bound, late), predicted, _ = ticked
    shown = leader.shown
    shown.rendered_force, shown.position, shown.engaged, shown.clipped = force, position, engaged, clipped
    shown.mediated_force, shown.step_by_models, shown.rendered_share = mediated, step, share
    shown.energy, shown.energy_bound, shown.late_energy = energy, bound, late
    shown.velocity, shown.predicted_force, shown.jump, shown.standard_deviation = predicted


@kernel("f8(Leader, i8, f8, i8, b1, b1)")
def tick(leader: Leader, now_ns: int, hand: float, period_ns: int, clutched: bool, stopping: bool) -> float:
    """A tick along a line, as `foretouch.session.steps.leader.step` says.

    Args:
        leader: Written; see `Leader.shown`.
        now_ns: Time of this tick by a monotonic clock [ns]; one that is not later than the last one changes no force.
        hand: Position of the operator's hand [m]; NaN where it is missing.
        period_ns: Time since the last tick really began [ns].
        clutched: Whether the clutch is pressed: the hand moves and the follower stays.
        stopping: Whether an emergency stop was requested here, and the follower has not yet confirmed it.

    Returns:
        The force for the hand [N].
    """
    time, period, _ = begin_tick(leader, now_ns, period_ns)
    free, couples = decide(leader, stopping, clutched)
    if couples:
        couple(leader, hand, clutched)
    if not time > leader.time:
        return float(leader.shown.rendered_force)
    leader.time = time
    _catch_up(leader.predictions)
    r, account, p = leader.renderings[0], leader.accounts[0], leader.predictions[0]
    place = hand if abs(hand) <= FARTHEST else math.nan, 0.0, 0.0
    _show(leader, whole.render(r, account, p, time, hand, period, free, place, leader.axis))
    return float(leader.shown.rendered_force)


renew_entry = Kernel(renew, "(Leader, b1)")
judge_entry = Kernel(judge, "i8(Leader, b1, b1, f8, i8)")
begin_entry = Kernel(begin_tick, "UniTuple(f8, 3)(Leader, i8, i8)")
decide_entry = Kernel(decide, "UniTuple(b1, 2)(Leader, b1, b1)")
couple_entry = Kernel(couple, "(Leader, f8, b1)")
ENTRIES: tuple[Kernel[..., Any], ...] = renew_entry, judge_entry, begin_entry, decide_entry, couple_entry
"""What Python calls."""
