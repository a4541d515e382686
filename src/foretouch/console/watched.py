"""Newest messages of a session at a console, their senders and their ages."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from types import MappingProxyType

from foretouch.console.history import History, Lateness, Losses, LossTrace, Window
from foretouch.console.models_seen import ModelsSeen, ModelTrace
from foretouch.console.space_state import SpaceState
from foretouch.devices import GRIPS, INTENDED_FORCE
from foretouch.messages import Hello, LeaderSpace, LeaderState, Message, ModelUpdate, Telemetry
from foretouch.quantities import Rows
from foretouch.rendering.limits import LEAST_FORCE, OWED, REDUCED_BELOW, UNPAID, Withheld, due_force
from foretouch.settings import NO_BASELINE, NO_GRIP

SILENT, GONE = 0.3, 1.0
"""A side that sends every millisecond is silent when nothing has come for this time [s]; after the second one another
leader than the one shown is shown [s]."""
SURFACE, PRESS_DEPTH = 0.012, 0.01
"""Surface position and depth of presses [m] until the session sends its values."""
DEEPEST, SMALLEST_SCALE = 1.2, 1e-3
"""Reach of the handle below the surface, in press depths; a bound on the position scale."""
NOWHERE = LeaderSpace(*(math.nan,) * len(LeaderSpace.__struct_fields__))  # what is known in space along a line
SUPERVISOR_SILENT = 3.0
"""The supervisor, which can start the sides again with another choice, speaks twice a second; it is gone when nothing
has come for this time [s]."""
LARGEST_RADIUS = 0.02  # Of a probe [m]
MODEL_SHARE = 0.5  # Fraction of the press depth at which models are compared
MODELS = 256  # Newest models whose time is kept: some seconds of them
MOST_SPEAKERS = 16  # Largest number of leaders and roles that are distinguished


class Watched:
    """The newest message of each kind, and of several leaders that of the one that the robot obeys.

    One thread calls `take`, which costs some microseconds; others read.

    Attributes:
        history: The last seconds of the leader that is shown.
        leader: Its newest state.
        telemetry: The newest of the robot's side.
        model: The newest model.
        space: Messages of a session in three dimensions.
        trouble: Text of the robot's side on itself since its newest status, "" for none.
        settings: Texts of all roles on the session, by name; those that only one role knows are read by `reported`.
        received: Time of the newest message [s]; minus infinity before the first.
        lateness: Lateness of the loops of both sides.
        withheld: Reason that the shown leader withholds the model's force or a part of it, "" where it does not.
        given: Ratio of the rendered force to the force due in the newest tick in contact, 0 to 1.
    """

    def __init__(self) -> None:
        self.history = History()
        self.leader: LeaderState | None = None
        self.telemetry: Telemetry | None = None
        self.model: ModelUpdate | None = None
        self.space = SpaceState()
        self.trouble = ""
        self.settings: Mapping[str, str] = MappingProxyType({})
        self.received = -math.inf
        self.lateness = Lateness()
        self.withheld, self.given = "", 1.0
        self._models = ModelsSeen()
        self._made = [(0, 0)] * MODELS  # number and follower's time of the newest models [ns]
        self._losses = Losses()
        self._withheld = Withheld(REDUCED_BELOW)
        self._leader_received = self._telemetry_received = self._supervisor_received = -math.inf
        self._recorder_received = math.nan
        self._leaders: dict[int, float] = {}
        self._hellos: dict[tuple[str, str], dict[str, str]] = {}
        self._texts: dict[str, dict[str, str]] = {}

    def take(self, message: Message, now: float) -> None:
        """Take note of one message that has arrived now [s]."""
        self.received = now
        match message:
            case LeaderState():
                self._take_leader(message, now)
            case Telemetry():
                if self.status not in (None, message.status):
                    self.trouble = ""
                self.history.add_telemetry(message)
                self.lateness.take("follower", message.period_ns)
                self.telemetry, self._telemetry_received = message, now
                self.space.take(message, now)
            case ModelUpdate():
                self.model = message
                self._models.add(message)
                self._made[message.sequence % len(self._made)] = message.sequence, message.time_ns
            case Hello():
                self._take_hello(message, now)
            case _:
                self.space.take(message, now)

    def at_once(self) -> Watched:
        """Copy of the state received until now, which does not change later: one picture shows one moment."""
        moment = copy.copy(self)
        moment.space = copy.copy(self.space)
        return moment

    def silent(self, now: float) -> bool:
        """Whether messages of the session were received once, and none for `GONE` seconds."""
        return GONE < now - self.received < math.inf

    def leader_silence(self, now: float) -> float:
        """Time since the last message of the leader that is shown [s]; infinite before the first."""
        return now - self._leader_received

    def robot_silence(self, now: float) -> float:
        """Time since the last message of the robot's side [s]; infinite before the first."""
        return now - self._telemetry_received

    def recorder_silence(self, now: float) -> float:
        """Time since the last message of the recorder [s]; NaN before the first."""
        return now - self._recorder_received

    def leaders(self, now: float) -> int:
        """Number of leaders that send."""
        return sum(now - received < SILENT for received in tuple(self._leaders.values()))

    def supervised(self, now: float) -> bool:
        """Whether a process is there that starts the sides again with another choice."""
        return now - self._supervisor_received < SUPERVISOR_SILENT

    def reported(self, role: str, name: str) -> str:
        """The last text of one role under a name, whatever others send under it; "" for none."""
        return self._texts.get(role, {}).get(name, "")

    @property
    def insecure(self) -> bool:
        """Whether any side reports that nothing is encrypted or authenticated; reports of others do not revoke it."""
        return any(texts.get("insecure") == "yes" for texts in self._texts.values())

    # What is drawn over time; a recording that is played has the same.

    def window(self, seconds: float) -> Window:
        """Forces, energy and delay of the last seconds."""
        return self.history.window(seconds, newest=0 if self.leader is None else self.leader.sequence)

    def model_trace(self, seconds: float) -> ModelTrace:
        """Models of the last seconds, compared at `model_depth`."""
        now = 0.0 if self.leader is None else self.leader.time_ns * 1e-9
        return self._models.trace(self.model_depth, seconds, now)

    def loss_trace(self, seconds: float, now: float) -> LossTrace:
        """Losses of the last seconds before a moment [s]."""
        return self._losses.trace(now, seconds)

    @property
    def model_age(self) -> float:
        """Age of the model that is felt, by the robot's side's clock [s]; NaN without one."""
        number = 0 if self.leader is None else self.leader.model_sequence
        kept, made_ns = self._made[number % len(self._made)]
        if self.telemetry is None or number == 0 or kept != number:
            return math.nan
        return max((self.telemetry.time_ns - made_ns) * 1e-9, 0.0)

    def rows(self) -> tuple[Rows, Rows]:
        """Ticks of the leader and the follower, the last seconds of both, from which the stages of the loop follow."""
        return self.history.rows(0 if self.leader is None else self.leader.sequence)

    @property
    def model_depth(self) -> float:
        """Depth [m] at which models are compared: half the press depth."""
        return MODEL_SHARE * max(self.setting("press_depth", PRESS_DEPTH), 1e-4)

    @property
    def status(self) -> int | None:
        """State of the robot: a `Status`; None before its first telemetry."""
        return None if self.telemetry is None else self.telemetry.status

    @property
    def surface(self) -> float:
        """Position of the surface [m], as well as it is known."""
        model = self.model
        if model is not None and model.valid and math.isfinite(model.surface):
            return model.surface
        return self.setting("surface", SURFACE)

    @property
    def robot_position(self) -> float:
        """Position of the robot as last received by the operator's side [m]; NaN before."""
        if self.leader is not None:
            position = self.history.follower_position(self.leader.telemetry_sequence)
            if math.isfinite(position):
                return position
        return math.nan if self.telemetry is None else self.telemetry.position

    @property
    def probe_position(self) -> float:
        """Position of the operator's probe [m]: the robot's while they are not coupled, 0 before either is known."""
        own, robot = math.nan if self.leader is None else self.leader.position, self.robot_position
        return own if math.isfinite(own) else robot if math.isfinite(robot) else 0.0

    @property
    def leader_space(self) -> LeaderSpace:
        """What the leader that is shown says in space; all NaN along a line."""
        return NOWHERE if self.leader is None else self.leader.space or NOWHERE

    @property
    def telemetry_sequence(self) -> int:
        """Sequence of the newest telemetry that the leader had; 0 before the first."""
        return 0 if self.leader is None else self.leader.telemetry_sequence

    @property
    def joints(self) -> tuple[float, ...]:
        """Positions of the robot's joints as received last [rad]; empty where it tells of none, and along a line."""
        return () if self.telemetry is None or self.telemetry.space is None else self.telemetry.space.joints

    @property
    def operator(self) -> str:
        """Operator that moves the leader's hand: only the operator ``browser`` uses a handle."""
        return self.settings.get("operator", "browser")

    @property
    def probe_radius(self) -> float:
        """Radius of the sphere that touches [m]; 0 for a point."""
        return min(max(self.setting("probe_radius", 0.0), 0.0), LARGEST_RADIUS)

    @property
    def grip(self) -> str:
        """Grip of the hand on the device that the force moves; empty where the force moves nothing."""
        grip = self.settings.get("grip", NO_GRIP)
        return "" if grip == NO_GRIP else grip

    @property
    def scale(self) -> float:
        """Probe's motion for the hand's."""
        return max(self.setting("position_scale", 1.0), SMALLEST_SCALE)

    @property
    def hand_ahead(self) -> float:
        """Depth of the hand beyond the probe, in the probe's lengths [m]; NaN where no force moves it."""
        if self.leader is None or not self.grip:
            return math.nan
        return self.scale * self.leader.hand_position - self.leader.position

    @property
    def deepest(self) -> float:
        """Bound of the handle [m]: a hand that the force moves has to want more than it gets."""
        grip = GRIPS.get(self.grip)
        more = 0.0 if grip is None else self.scale * INTENDED_FORCE / grip.stiffness
        return self.surface + DEEPEST * (self.setting("press_depth", PRESS_DEPTH) + more)

    def setting(self, name: str, otherwise: float) -> float:
        """A number among the session's settings, or another where there is none."""
        try:
            value = float(self.settings.get(name, otherwise))
        except ValueError:
            return otherwise
        return value if math.isfinite(value) else otherwise

    def _take_leader(self, state: LeaderState, now: float) -> None:
        if state.epoch not in self._leaders:
            speaking = {epoch: received for epoch, received in self._leaders.items() if now - received < GONE}
            self._leaders = speaking if len(speaking) < MOST_SPEAKERS else {}
        self._leaders[state.epoch] = now
        if self.leader is not None and state.epoch != self.leader.epoch:
            obeyed = self.telemetry is not None and self.telemetry.epoch == state.epoch
            if not obeyed and self.leader_silence(now) < GONE:
                return
            self.history = History()  # each leader counts its commands from 1
            self._withheld = Withheld(REDUCED_BELOW)
        self.history.add_leader(state)
        self.lateness.take("leader", state.period_ns)
        self._models.adopt(state.time_ns * 1e-9, state.model_sequence)
        self.leader, self._leader_received = state, now
        self.space.take(state, now)
        felt = self.grip or self.settings.get("felt") == "yes"
        baseline = self.settings.get("baseline", NO_BASELINE) != NO_BASELINE
        if baseline or not (felt and state.engaged and math.isfinite(state.hand_position)):
            self.withheld, self._withheld = "", Withheld(REDUCED_BELOW)
            return
        due = due_force(state.predicted_force, max(self.setting("force_scale", 1.0), 0.0))
        if due >= LEAST_FORCE:
            self.given = max(state.rendered_force, 0.0) / due
        withheld = self._withheld.update(due, state.rendered_force, state.energy, state.time_ns)
        self.withheld = (OWED if self._withheld.owed else UNPAID) if withheld else ""

    def _take_hello(self, hello: Hello, now: float) -> None:
        """Keep the texts of each; the newest counts, but of several leaders the one in control."""
        texts = self._texts[hello.role] = hello.texts
        match hello.role:
            case "follower":
                self.trouble = texts.get("trouble", "")
            case "recorder":
                self._recorder_received = now
            case "supervisor":
                self._supervisor_received = now
        self._losses.take(hello.role, texts, now)
        speaker = (hello.role, texts.get("leader", ""))
        self._hellos.pop(speaker, None)
        if len(self._hellos) >= MOST_SPEAKERS:
            self._hellos.pop(next(iter(self._hellos)))
        self._hellos[speaker] = texts
        in_control = self._hellos.get(("leader", self.reported("follower", "control")), {})
        settings: dict[str, str] = {}
        for reported in (*self._hellos.values(), in_control):
            settings |= reported
        self.settings = MappingProxyType(settings)
