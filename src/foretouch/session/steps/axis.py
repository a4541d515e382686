"""The operator's hand and the robot's probe on an axis; `foretouch.session.spatial` has those in space.

They give the steps of leader and follower the coordinate along the outward normal of what is touched, which grows into
the material. On an axis that is the machine's own count: what is pressed is a plane whose normal is the axis.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

from foretouch.core import Kernel
from foretouch.identification import ContactMap, Estimator, MaterialFieldLearner
from foretouch.messages import Command, FieldUpdate, FollowerSpace, LeaderSpace, Message, ModelUpdate
from foretouch.models import ContactModel
from foretouch.rendering import Renderer
from foretouch.rendering.renderer import ContactFrame
from foretouch.robot import RobotSample
from foretouch.session.safety.kernel import limit
from foretouch.session.steps import tick as stages
from foretouch.session.steps.follower_view import FollowerView

if TYPE_CHECKING:
    from foretouch.session.settings import SessionSettings
    from foretouch.session.steps.follower import Inputs, State
    from foretouch.session.steps.leader import Inputs as LeaderInputs


Arrived: TypeAlias = tuple[float, float, float, ContactFrame | None]
"""Coordinates [m] of the hand, NaN where it is unknown, of its exact position and of its intended one; and the frame of
the contact, None for that of a line."""

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

    def come_to(self, inputs: LeaderInputs, renderer: Renderer, view: FollowerView) -> Arrived:
        """Take the position of the hand, and what is recorded of it."""
        return inputs.position, inputs.exact_position, inputs.intended_position, None  # type: ignore[return-value]

    def law(self) -> ContactModel | None:
        """The law where the hand is; None where the follower's model is all that is known."""
        return None

    def go_on(self, renderer: Renderer) -> None:
        """Take the law where the hand is now, where no model came."""

    def finish(self, renderer: Renderer) -> Told:
        """What there is to tell of a rendered tick."""
        return (), renderer.predicted[3], None


Measured: TypeAlias = tuple[float, float, bool]
"""Position along the normal [m], the simulator's own contact force [N], and whether the robot clipped a command."""

Finished: TypeAlias = tuple[Any, FollowerSpace | None, ModelUpdate | None, FieldUpdate | None]
"""Position for the robot [m], what there is to tell in space, and the model and the field that are due."""


class ProbeOnAxis:
    """A probe with one degree of freedom: what it presses is a plane whose normal is the axis, felt by touching.

    A tick is `at_once`, or `arrive`, `go` and `limit` with the stages of `foretouch.session.steps.tick` between them.

    Attributes:
        whole: Ticks in one compiled call, by what they learn.
    """

    whole: Mapping[type[Estimator], Kernel[..., Any]] = {
        ContactMap: stages.tick_at_once,
        MaterialFieldLearner: stages.tick_in_field,
    }

    def join(self, state: State, settings: SessionSettings) -> None:
        """Become the probe of a follower before its first tick."""
        self._limit = limit.entry

    def hear(self, state: State, inputs: Inputs, now_ns: int) -> None:
        """Take what is believed of the surface."""

    def at_once(
        self, tick: Callable[..., Any], states: Any, state: State, inputs: Inputs, asked: Any
    ) -> tuple[stages.Done, Measured]:
        """A tick in one compiled call with these states, at times, as commanded; and what the robot shows."""
        sample = inputs.sample
        return tick(*states, sample, *asked), (sample.position, sample.exact_force, sample.clipped)

    def arrive(self, state: State, inputs: Inputs) -> RobotSample:
        """Take what the robot shows; returns it along the normal."""
        return inputs.sample  # type: ignore[no-any-return]

    def go(self, state: State, position: float) -> float:
        """The coordinate that is wanted where a position is played [m]; NaN for none."""
        return position

    def wanted(self, command: Command) -> float:
        """Position of a command [m]; NaN for none."""
        return command.position

    def limit(self, state: State, inputs: Inputs, aim: float) -> float:
        """Learn what there is beside the law, and limit the motion to an aim: the robot's coordinate [m]."""
        return self._limit(state.safety.memories)

    def finish(
        self, state: State, inputs: Inputs, coordinate: float, model: ModelUpdate | None, now_ns: int
    ) -> Finished:
        """What a tick comes to, with the robot's coordinate [m]."""
        return coordinate, None, model, None

    def tip(self, state: State, sample: Any) -> Any:
        """Measured position of the tip [m]: p = x - F / k, with the encoders' x and the compliance 1 / k."""
        offset, force = state.learner.conditioner.force_offset, state.sensor_force(sample)
        give = state.compliance * (force - offset if math.isfinite(offset) else force)
        return sample.position - give if give != 0.0 and math.isfinite(give) else sample.position

    def back_off(self, state: State, sample: Any, position: Any, way: float) -> Any:
        """Retreat so far [m] from the robot's commanded position, according to the force in its sample alone."""
        force = state.sensor_force(sample)
        if math.isfinite(force):
            state.feel_plainly(force)
        state.safety.go_on_from(position - way)
        return position - way
