"""The follower's step: takes commands and sensor samples; gives a robot position, telemetry and models.

The order is: which leader commands, which commands are fresh, whether the sensors are valid, learning, and last,
whatever was commanded, the robot's limits (`foretouch.session.safety.safety`). An exception in the earlier stages is
counted and reported, and the last stage runs all the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Held, Kernel
from foretouch.identification import ContactMap, Estimator, Learner, SensorState, SensorWatch
from foretouch.identification.conditioning.kernel import CONTACT_FLOOR
from foretouch.link import SequenceCounter
from foretouch.messages import VERSION, Command, FieldUpdate, FixtureBelief, ModelUpdate, Status, Telemetry
from foretouch.quantities.pose import Vector, dot, norm, subtract
from foretouch.robot import RobotSample, RobotSpecification
from foretouch.session.network.freshness import Arrival, Freshness
from foretouch.session.network.lease import ControlLease, number_of
from foretouch.session.network.model_sender import ModelSender
from foretouch.session.network.playout import NOWHERE, Playout
from foretouch.session.safety.force_guard import first_touch
from foretouch.session.safety.safety import STATES, Safety
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.steps import tick as stages
from foretouch.session.steps.axis import ProbeOnAxis
from foretouch.session.steps.hearing import NOT_ADMITTED, Hearing, felt_command, hear, note_felt, obey
from foretouch.session.steps.sensing import Failures, calibrated, safety_limits

# Constants used in every tick: a member of an enumeration costs more to look up than to compare.
GOOD = SensorState.GOOD
FRESH, FUTURE = int(Arrival.FRESH), int(Arrival.FUTURE)
LEAST_SPEED = 1e-3  # Below this, the way on which a robot met something is that to the newest command [m/s]
OF_ROBOT = ("tool_mass", "gravity", "moved_mass", "largest_offset")  # What a tick knows of the robot's specification
HOLDING, RETREATING, TOO_SLOW = int(Status.HOLDING), int(Status.RETREATING), int(Status.TOO_SLOW)


note_felt_entry, felt_entry = Kernel(note_felt, "(Hearing, i8)"), Kernel(felt_command, "i8(Hearing)")


class State(Held):
    """State of the follower, updated in place in each tick; what it hears is a record (`Hearing`).

    Args:
        specification: Specification of the robot, as calibrated: its tool is compensated in the force.
        learner: Learns from its samples.
        memory: State of what is compiled beside the learner's, one record (`foretouch.session.steps.tick.Follower`).
        watch: Watches its sensors.
        safety: Limits what it is told.
        probe: Its probe, on an axis or in space.
        hearing: An array of one `Hearing`.
        settings: Session settings.

    Attributes:
        run: Epoch of this process.
        start_ns: Clock at the first tick that had a command, None before it.
        held_ticks: Ticks in which the robot was held for want of a fresh command, since there was the first.
        guards: Whether this side's settings guard first touches.
        guarded: Whether they are guarded: by these, or because a command of this leader asks for it.
        released_tick: Number of the first telemetry behind the newest release, 0 before the first release.
        went: Velocity that was commanded when the robot met something [m/s]; empty while nothing is in its way.
        before_release: Number of commands refused because their leader did not know of it.
    """

    run: int
    guards: bool
    guarded: bool
    released_tick: int
    before_release: int

    def __init__(
        self,
        specification: RobotSpecification,
        learner: Learner,
        memory: NDArray[np.void],
        watch: SensorWatch,
        safety: Safety,
        probe: ProbeOnAxis,
        hearing: NDArray[np.void],
        settings: SessionSettings,
    ) -> None:
        super().__init__(hearing)
        self.specification, self.learner, self.memory, self.watch = specification, learner, memory, watch
        self.safety, self.probe, self.playout = safety, probe, Playout(memory["playing"][0])
        self.sender = ModelSender(round(1e9 / settings.model_rate), self.run, sendings=hearing["sendings"][0])
        self.freshness = Freshness(settings.queueing_allowance, SAMPLE_PERIOD, judgings=hearing["judgings"][0])
        self.lease, self.commands = ControlLease(leases=hearing["leases"][0]), SequenceCounter()
        self.tick = self.held_ticks = self.faulty_ticks = 0
        self.start_ns: int | None = None
        self.failures = Failures()
        self.went: Vector | tuple[()] = ()
        for kernel in (hear, obey, note_felt_entry, felt_entry):
            kernel.entry  # noqa: B018  # asked for, it is compiled or loaded: nothing of that in the loop

    def sensor_force(self, sample: RobotSample) -> float:
        """Sensor force less weight and inertia of the tool, which are no contact, and its calibrated zero [N]."""
        zero: float = self.memory["zero"].item()
        return sample.sensor_force - self.specification.tool_force(sample.acceleration) - zero

    @property
    def states(self) -> stages.States:
        """The records of a tick."""
        return self.memory, self.learner.conditioner.memory, self.learner.learning

    def feel_plainly(self, force: float) -> None:
        """Take a sensor force [N] as the contact force, less the offset as far as known, without conditioning."""
        last, offset = self.learner.sample, self.learner.conditioner.force_offset
        felt = force - offset if math.isfinite(offset) else force
        self.learner.sample = last._replace(velocity=0.0, force=felt, in_contact=felt > CONTACT_FLOOR)


class Inputs(NamedTuple):
    """Inputs of a tick, on an axis or in space.

    Attributes:
        commands: Commands that have arrived since the last tick.
        sample: Sample of the robot's sensors: a `RobotSample`, or a `SpatialSample`.
        period_ns: Time since the last tick began [ns].
        compute_ns: Computing time of the last tick [ns].
        stop: Why an emergency stop was requested; empty while none was.
        release: Whether the end of an emergency stop is requested at the robot, or a repair of the sensors reported.
        ended: Whether the session is over: the robot is left as after a long silence.
        beliefs: In space, beliefs of the fixture's pose that have arrived since the last tick.
    """

    commands: list[Command]
    sample: Any
    period_ns: int
    compute_ns: int
    stop: str = ""
    release: bool = False
    ended: bool = False
    beliefs: Sequence[FixtureBelief] = ()


class Outputs(NamedTuple):
    """Position for the robot [m], telemetry for all subscribers, and what is for the leader when it is due."""

    desired_position: Any
    telemetry: Telemetry
    model: ModelUpdate | None
    field: FieldUpdate | None


def start(
    specification: RobotSpecification,
    settings: SessionSettings,
    estimator: Estimator | None = None,
    *,
    run: int = 1,
    probe: ProbeOnAxis | None = None,
) -> State:
    """State before the first tick, with the settings' estimator or another, as process `run` of this side.

    In space there is a `probe` of its own, and the robot weighs its tool out. Raises as `calibrated` does.
    """
    known, probe = calibrated(specification, settings), ProbeOnAxis() if probe is None else probe
    specification, force = known.specification, specification.sensor_range
    learner = Learner(
        settings.make_estimator() if estimator is None else estimator,
        force_offset=None if known.zero is None else 0.0,
        offset_error=known.contact_floor,  # it may have drifted since it was calibrated
        contact_floor=known.contact_floor,
        sensor_lag=known.sensor_lag,
        places=probe.places,
    )
    limits = safety_limits(settings, specification)
    period, of_robot = specification.sample_period, {name: getattr(specification, name) for name in OF_ROBOT}
    touch = first_touch(settings.approach_speed, settings.guarded_force, period)
    memory = stages.Follower.new(zero=known.zero or 0.0, compliance=known.compliance, touch=touch, **of_robot)
    felt_room, guards = 1 + round(known.sensor_lag / SAMPLE_PERIOD), settings.guards(simulated=specification.simulated)
    watch = SensorWatch(
        (-force, force),
        moving_mass=specification.moved_mass,
        contact_floor=known.contact_floor,
        memory=memory["watch"][0],
    )
    safety = Safety(limits, period, memory=memory["safety"][0])
    hearing = Hearing.new(run=run, guards=guards, felt_room=felt_room)
    state = State(specification, learner, memory, watch, safety, probe, hearing, settings)
    state.probe.join(state, settings)
    for stage in (*state.probe.alone, stages.feel_alone, state.probe.whole):
        _ = stage and stage.entry  # which compiles or loads it: nothing of that in the loop
    return state


def step(state: State, inputs: Inputs, now_ns: int) -> tuple[State, Outputs]:
    """One tick of the follower, at a time of its monotonic clock [ns]; the state is updated in place and returned.

    Learning begins with the first command: no operator is active before, and a recording from the first command on
    holds all that was learnt from.
    """
    safety, sender, probe, sample = state.safety, state.sender, state.probe, inputs.sample
    probe.hear(state, inputs, now_ns)
    _hear(state, inputs.commands, now_ns)
    if sample.held or state.went:
        _stand(state, sample)
    heard_ns = state.freshness.newest_ns
    heard = -1 if heard_ns is None or inputs.ended else heard_ns
    times_ns, acted = (now_ns, heard, inputs.period_ns, state.start_ns or 0), None
    if state.start_ns is not None and not (inputs.stop or inputs.release or safety.stop_reason):
        acted = _at_once(state, inputs, times_ns)
    if acted is None:
        acted = _one_by_one(state, inputs, times_ns)
    applied = state.playout.applied
    (desired, status), validity, (tip, force, held_back, velocity, felt, in_contact) = acted
    safety.status = STATES[status]
    if validity:
        state.faulty_ticks += 1
    if heard_ns is not None and (HOLDING <= status <= RETREATING or status == TOO_SLOW):
        state.held_ticks += 1
    sensors = state.watch.state if validity == state.watch.state else SensorState(validity)
    model = None if state.start_ns is None else _due(state, sensors, applied, now_ns)
    state.tick += 1
    commanded, space, model, materials = probe.finish(state, inputs, desired, model, now_ns)
    telemetry = Telemetry(
        VERSION, state.tick, now_ns, applied, desired, tip, velocity, force, felt, probe.exact_force(sample),
        in_contact, sample.clipped, sender.sequence, inputs.period_ns, inputs.compute_ns, held_back, safety.status,
        sensors, state.lease.epoch, state.run, space,
    )  # fmt: skip
    return state, Outputs(commanded, telemetry, model, materials)


def _stand(state: State, sample: Any) -> None:
    """Stand where a robot stands that has met something, until a command leads back from there."""
    try:
        tip = state.probe.tip(state, sample)
        ahead = subtract(tuple(state.records["asked"][0].tolist()), tip if isinstance(tip, tuple) else (tip, 0.0, 0.0))
        if not state.went:
            velocity = state.probe.commanded_velocity(state)
            state.went = velocity if norm(velocity) > LEAST_SPEED else ahead
        leads_back = not dot(ahead, state.went) > 0.0
        state.memory["obstructed"] = not leads_back
        if not leads_back and sample.held:
            state.probe.stand(state)
        elif leads_back and not sample.held:
            state.went = ()
    except Exception as error:
        state.failures.note("what it has met", error)


def _hear(state: State, commands: list[Command], now_ns: int) -> None:
    """Take the commands that have come."""
    try:
        for command in commands:
            _take(state, command, now_ns)
    except Exception as error:
        state.failures.note("its commands", error)


def _at_once(state: State, inputs: Inputs, times_ns: stages.Times) -> stages.Acted | None:
    """A tick in one compiled call; None where that cannot be."""
    learner, probe = state.learner, state.probe
    tick, estimator = probe.whole, learner.estimator
    if tick is None or type(estimator) is not ContactMap or not state.failures.learns:
        return None
    where = None if learner.places is None else learner.places.states
    # What is compiled raises only where an argument cannot be converted, as where the robot shows what is no number:
    # then nothing has been written, and which stage that stops is found one by one.
    try:
        given = probe.given(state, inputs.sample)
        acted, probe.told, (done, news) = tick.entry(
            state.states, estimator.states, where, given, times_ns, state.guarded
        )
    except Exception:
        return None
    if state.watch.taken(acted[1]) is GOOD:
        try:
            learner.taken(estimator, done, news)
            note_felt_entry.entry(state.records[0], state.playout.applied)
        except Exception as error:
            state.failures.stop_learning("its learning", error)
    return acted  # type: ignore[no-any-return]


def _one_by_one(state: State, inputs: Inputs, times_ns: stages.Times) -> stages.Acted:
    """The same stage by stage: an exception in learning is noted, and what comes after it runs all the same."""
    record, probe = state.memory[0], state.probe
    given, position = probe.given(state, inputs.sample), math.nan
    try:
        position = state.playout.advance()  # NaN while no leader has sent a position
    except Exception as error:
        state.failures.note("its commands", error)
    if state.start_ns is None and state.playout.applied:
        state.start_ns = times_ns[0]
    desired = probe.sense(state, given, times_ns[0], position)
    good = record.validity == GOOD
    if good and state.start_ns is not None:
        _learn(state, (times_ns[0] - state.start_ns) * 1e-9, float(record.position), float(record.force))
    felt, _ = stages.feel_alone.entry(state.states)
    if not _stop_or_release(state, inputs, felt, not good):
        desired = math.nan
    return probe.allow(state, given, times_ns, state.guarded, desired, state.safety.stop_reason != "")


def _learn(state: State, time: float, position: float, force: float) -> None:
    """Learn from a sample; where learning has ended, feel the force that safety needs."""
    learner = state.learner
    if state.failures.learns:
        try:
            learner.update(time, position, force)
            note_felt_entry.entry(state.records[0], state.playout.applied)
            return
        except Exception as error:
            state.failures.stop_learning("its learning", error)
    if learner.sample.time != time:
        try:
            learner.feel(time, position, force)
        except Exception as error:
            state.failures.note("its conditioning", error)
            state.feel_plainly(force)


def _due(state: State, sensors: SensorState, applied: int, now_ns: int) -> ModelUpdate | None:
    """The model that is due; the estimator is told now and then how late its models are used."""
    if not state.failures.learns:
        return None
    try:
        delay = state.sender.round_trip.applied(applied, now_ns)
        if delay is not None:
            state.learner.estimator.expect_delay(delay)
        # The state of the material is that of the newest sample that was learnt from, whatever is commanded since.
        felt = felt_entry.entry(state.records[0])
        state.sender.remembers = state.guarded
        return state.sender.due(state.learner, sensors, felt, state.lease.epoch, now_ns)
    except Exception as error:
        state.failures.stop_learning("its learning", error)
        return None


def _take(state: State, command: Command, now_ns: int) -> None:
    """Obey a command if its leader has control and it is fresh."""
    lease, record, playings = state.lease, state.records[0], state.memory["playing"][0]
    sequence, epoch = command.sequence, lease.epoch
    asks = command.epoch, sequence, command.time_ns, command.telemetry_sequence, command.run
    heard = hear.entry(record, playings, (number_of(command.holder), *asks), now_ns)
    if heard == NOT_ADMITTED:
        return
    if lease.epoch != epoch or lease.holder != command.holder:  # another leader
        lease.holder = command.holder
        state.commands.restart()
    if heard != FUTURE:
        state.commands.is_newest(sequence)
    if heard == FRESH:
        position, place = state.probe.wanted(command), command.place if len(command.place) == 3 else NOWHERE
        asked = command.place if len(command.place) == 3 else (command.position, 0.0, 0.0)
        obey.entry(record, playings, sequence, position, place, asked, command.acknowledged_model, command.guarded)


def _stop_or_release(state: State, inputs: Inputs, felt: float, faulty: bool) -> bool:
    """Apply requests at the robot; return whether the commands hold."""
    safety, released = state.safety, False
    if inputs.stop:
        safety.stop(inputs.stop)
    elif inputs.release and faulty:
        state.watch.reset()  # a stop stays: the robot's force is known from the next samples on
        released = True
    elif inputs.release and safety.stop_reason:
        released = safety.release(state.learner.sample.velocity, felt)
    if released:
        state.released_tick = state.tick + 1  # the number of this tick's telemetry, the first to report it
    if released or safety.stop_reason:
        state.playout.forget()
        return False
    return True
