"""The operator's hand and the robot's probe on an axis; `foretouch.session.spatial` has those in space.

They give the steps of leader and follower the coordinate along the outward normal of what is touched, which grows into
the material. On an axis that is the machine's own count: what is pressed is a plane whose normal is the axis.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, TypeAlias

from foretouch.core import Kernel
from foretouch.identification import ScaleFieldLearner, SensorState
from foretouch.messages import Command, FieldUpdate, FollowerSpace, LeaderSpace, Message, ModelUpdate
from foretouch.quantities.pose import Vector
from foretouch.rendering import Renderer
from foretouch.rendering.renderer import ContactFrame
from foretouch.rendering.surfaces.line import Coordinates
from foretouch.rendering.whole import Now
from foretouch.session.steps import tick as stages
from foretouch.session.steps.follower_view import FollowerView

if TYPE_CHECKING:
    from foretouch.session.settings import SessionSettings
    from foretouch.session.steps.follower import Inputs, State
    from foretouch.session.steps.leader import Inputs as LeaderInputs


Arrived: TypeAlias = tuple[Coordinates, ContactFrame | None, float | None]
"""Coordinates of the hand; the frame of the contact, None for that of a line; and the force for the hand along the
normal [N], None where the tick is still to be done."""

Told: TypeAlias = tuple[tuple[float, ...], float, LeaderSpace | None]
"""The proxy's place in the world [m], which the follower is to go to, none on an axis, nor while unknown; standard
deviation of the predicted force [N]; and what there is to record in space."""


class HandOnAxis:
    """A hand with one degree of freedom: what it presses is a plane whose normal is the axis, wherever models say.

    Attributes:
        axes: Number of degrees of freedom.
        offset: Coordinate of the believed surface, from which models count [m].
    """

    axes = 1
    offset = 0.0

    def take(self, message: Message, renderer: Renderer, view: FollowerView) -> None:
        """Take a message of the follower about the surface, if it is the newest."""

    def come_to(self, inputs: LeaderInputs, renderer: Renderer, view: FollowerView, now: Now) -> Arrived:
        """Take the position of the hand, and what is recorded of it; in space, do the tick unless something waits."""
        return (inputs.position, inputs.exact_position, inputs.intended_position), None, None  # type: ignore[return-value]

    def adopt(self, model: ModelUpdate, renderer: Renderer) -> None:
        """Take note of a model that is rendered from now on."""

    def go_on(self, renderer: Renderer) -> None:
        """Go on with the law that there is, where no model came."""

    def finish(self, renderer: Renderer) -> Told:
        """What there is to tell of a rendered tick."""
        return (), renderer.predicted[3], None


Finished: TypeAlias = tuple[Any, FollowerSpace | None, ModelUpdate | None, FieldUpdate | None]
"""Position for the robot [m], what there is to tell in space, and the model and the field that are due."""


class ProbeOnAxis:
    """A probe with one degree of freedom: what it presses is a plane whose normal is the axis, felt by touching.

    A tick is one of `whole`, or `sense`, learning and `allow`.

    Attributes:
        whole: A tick in one compiled call, in which a contact map learns; None where that cannot be.
        alone: What is called where that cannot be.
        places: Learns how the material varies over the surface; None on an axis.
        told: What compiled code said beside what every tick comes to.
    """

    places: ScaleFieldLearner | None = None
    told: Any = None
    alone: tuple[Kernel[..., Any], ...] = stages.sense_alone, stages.allow_alone
    whole: Kernel[..., Any] | None = stages.tick_at_once

    def join(self, state: State, settings: SessionSettings) -> None:
        """Become the probe of a follower before its first tick."""

    def hear(self, state: State, inputs: Inputs, now_ns: int) -> None:
        """Take what is believed of the surface."""

    def wanted(self, command: Command) -> float:
        """Position of a command [m]; NaN for none."""
        return command.position

    def given(self, state: State, sample: Any) -> Any:
        """What compiled code is given of a tick, beside what all of them need."""
        return sample[:8]

    def exact_force(self, sample: Any) -> float:
        """The simulator's own contact force [N]."""
        return sample.exact_force  # type: ignore[no-any-return]

    def sense(self, state: State, given: Any, now_ns: int, position: float) -> float:
        """Watch the sensors; the coordinate for a played position [m]."""
        record = state.memory[0]
        try:
            state.watch.taken(stages.sense_alone.entry(state.states, given, now_ns))
        except Exception as error:
            state.failures.note("its sensors", error)
            record.validity, record.position, record.force = SensorState.NOT_FINITE, given[0], math.nan
        return position

    def allow(self, state: State, given: Any, *asked: Any) -> stages.Acted:
        """The last stages: `foretouch.session.steps.tick.allow_on_axis`."""
        acted: stages.Acted = stages.allow_alone.entry(state.states, given[0], *asked)
        return acted

    def finish(
        self, state: State, inputs: Inputs, coordinate: float, model: ModelUpdate | None, now_ns: int
    ) -> Finished:
        """What a tick comes to, with the robot's coordinate [m]."""
        return coordinate, None, model, None

    def tip(self, state: State, sample: Any) -> Any:
        """Measured position of the tip [m]: p = x - F / k, with the encoders' x and the compliance 1 / k."""
        offset, force = state.learner.conditioner.force_offset, state.sensor_force(sample)
        give = state.memory["compliance"].item() * (force - offset if math.isfinite(offset) else force)
        return sample.position - give if give != 0.0 and math.isfinite(give) else sample.position

    def commanded_velocity(self, state: State) -> Vector:
        """Velocity that the robot is commanded [m/s]."""
        return state.safety.path["velocity"][0, 0].item(), 0.0, 0.0

    def stand(self, state: State) -> None:
        """Begin again where the robot is, at rest."""
        state.safety.memories["motion"]["position"] = math.nan

    def back_off(self, state: State, sample: Any, position: Any, way: float) -> Any:
        """Retreat so far [m] from the robot's commanded position, according to the force in its sample alone."""
        force = state.sensor_force(sample)
        if math.isfinite(force):
            state.feel_plainly(force)
        state.safety.go_on_from(position - way)
        return position - way
