"""Whatever raises in a follower's loop, on a line and in space: it is told, and no robot is left pressing."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

import pytest
from step_links import Spoken, Ticks

from foretouch.core import Kernel
from foretouch.errors import SideError
from foretouch.identification import KelvinVoigtRLS, Learner, ScaleFieldLearner
from foretouch.identification.conditioning.conditioner import Conditioner
from foretouch.messages import Status
from foretouch.robot import Robot, SpatialRobot, SpatialSample, make_robot
from foretouch.session import Process, SessionSettings, StopFlag, run_follower
from foretouch.session.network.model_sender import FieldSender, ModelSender
from foretouch.session.network.playout import Playout
from foretouch.session.runners import live
from foretouch.session.safety.kernel import REST_FORCE
from foretouch.session.spatial import make_scene, make_spatial_robot, probe
from foretouch.session.spatial.probe import ProbeInSpace
from foretouch.session.steps import tick as stages
from foretouch.session.steps.axis import ProbeOnAxis
from foretouch.session.steps.hearing import hear
from foretouch.session.steps.sensing import Failures

LINE = SessionSettings(material="hunt-crossley", first_touch="guarded", approach_speed=0.05, guarded_force=10.0)
SCENE = SessionSettings(scene="plane", displacement=0.0, turn=0.0, fusion="none")
CEILING = 15.0


class Broken:
    """A method that raises once it has been called while the robot pressed, for so many calls or for ever."""

    def __init__(self, method: Callable[..., Any], presses: Callable[[], bool], times: float) -> None:
        self.method, self.presses, self.times = method, presses, times
        self.raised = 0

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        if self.raised < self.times and (self.raised or self.presses()):
            self.raised += 1
            raise ZeroDivisionError("a plug-in\nfailed\x1b[2J")
        return self.method(*arguments, **named)


class Session:
    """A follower's loop that is driven into something, at a clock that runs as fast as it can."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, settings: SessionSettings) -> None:
        self.patch, self.settings = monkeypatch, settings
        self.robot: Robot | SpatialRobot
        if settings.scene:
            scene = make_scene(settings.scene)
            self.robot = make_spatial_robot(settings, scene)
            x, y, z = self.robot.read().exact_place
            for tick in range(400):  # down to a centimetre over the surface
                self.robot.exchange((x, y, z - 1e-4 * tick))
            self.place: Callable[[float], Any] = lambda now: (x, y, max(0.01 - 0.03 * now, -0.006))
        else:
            line = make_robot(settings.material, seed=0)
            self.robot, surface = line, line.surface
            self.place = lambda now: min(0.02 * now, surface + 0.008)
        self.force, self.largest = 0.0, 0.0
        self.forces: list[float] = []
        exchange = self.robot.exchange

        def noted(desired: Any) -> Any:
            sample = exchange(desired)
            exact = sample.exact_force
            self.force = sum(part**2 for part in exact) ** 0.5 if isinstance(exact, tuple) else exact
            self.largest = max(self.largest, self.force)
            self.forces.append(self.force)
            return sample

        self.robot.exchange = noted  # type: ignore[method-assign, assignment]
        self.said: list[str] = []
        self.link = Spoken(self.place)
        self.ran: dict[str, Any] = {}
        monkeypatch.setattr(live, "LoopTimer", self.timer)
        monkeypatch.setattr(live, "link_counts", lambda *_: {})
        monkeypatch.setattr(live, "steady", nullcontext)  # to look for garbage first is for loops in real time

    def timer(self, period: float) -> Ticks:
        """The loop begins, and the leader with it: before, compiled code was loaded for as long as that took."""
        ticks = Ticks(period)
        self.link.now = self.link.begun = ticks.woke_ns
        return ticks

    def presses(self) -> bool:
        return self.force > 2.0

    def broken(self, owner: Any, name: str, times: float = float("inf")) -> Broken:
        """A stage of the tick is broken whether it is called alone or within the whole."""
        stage, of_class = isinstance(owner, Kernel), isinstance(owner, type)
        made = Broken(owner.entry if stage else getattr(owner, name), self.presses, times)
        made_of_class = (lambda *given, **named: made(*given, **named)) if of_class else made
        self.patch.setattr(owner, "_entry" if stage else name, made_of_class)
        for whole in WHOLES if stage or name in ("touch_at", "advance") else ():
            self.patch.setattr(whole, "_entry", Broken(whole.entry, self.presses, times))
        return made

    def run(self, seconds: float = 1.4, stop: StopFlag | None = None) -> dict[str, str | int]:
        link: Any = self.link
        process = Process(link, stop or StopFlag(), self.said.append)
        return run_follower(process, self.robot, self.settings, description={}, duration=seconds)


WHOLES = ProbeOnAxis.whole, ProbeInSpace.whole
LEARNING: list[tuple[Any, str]] = [(KelvinVoigtRLS, "update"), (Learner, "taken"), (ModelSender, "due")]
"""What has ended once it failed; the others are tried again."""

PLUG_IN = dataclasses.replace(LINE, model="kelvin-voigt", estimator="rls")
"""An estimator of Python, with the compiled stages around it."""

ON_A_LINE: list[tuple[Any, str]] = [(hear, ""), (Playout, "advance"), (stages.sense_alone, ""), *LEARNING]
IN_SPACE = [(Learner, "taken"), (ProbeInSpace, "wanted"), (Playout, "advance"), (FieldSender, "due")]
RARELY_IN_SPACE = [(ScaleFieldLearner, "touch_at"), (ProbeInSpace, "_with_fixture")]


@pytest.mark.parametrize(
    ("settings", "owner", "name"),
    [
        *((PLUG_IN if stage[0] is KelvinVoigtRLS else LINE, *stage) for stage in ON_A_LINE),
        (PLUG_IN, Learner, "update"),
        *((SCENE, *stage) for stage in IN_SPACE),
        *(pytest.param(SCENE, *stage, marks=pytest.mark.long) for stage in RARELY_IN_SPACE),
    ],
)
def test_an_exception_before_safety_is_counted_and_told_and_safety_goes_on(
    monkeypatch: pytest.MonkeyPatch, settings: SessionSettings, owner: Any, name: str
) -> None:
    session = Session(monkeypatch, settings)
    broken = session.broken(owner, name)
    ran = session.run()
    assert ran["step_failures"] == broken.raised > 0
    assert ran["ended"] == "the duration is over"
    assert session.link.telemetry[-1].sequence > 1300  # the loop went on
    assert session.largest < CEILING
    assert session.force < REST_FORCE + 0.1  # it ended unloaded
    if settings is SCENE:
        return
    if owner is stages.sense_alone:
        assert session.link.telemetry[-1].status == Status.SENSOR_FAULT
    learns = (owner, name) not in [*LEARNING, (Learner, "update")]
    assert (broken.raised > 1) is learns
    told = session.link.said[-2].values  # type: ignore[attr-defined]  # the last hello
    (trouble,) = [text for text in told if "the follower has a fault" in text]
    assert "ZeroDivisionError raised in its " in trouble
    assert r"(a plug-in failed\x1b[2J)" in trouble
    assert ("nothing more is learnt" in trouble) is not learns


@pytest.mark.parametrize("shows", [None, pytest.param(math.nan, marks=pytest.mark.long)], ids=["no number", "watch"])
def test_where_the_judge_of_the_sensors_raises_the_robot_goes_out_as_it_came(
    monkeypatch: pytest.MonkeyPatch, shows: float | None
) -> None:
    session = Session(monkeypatch, LINE)
    if shows is None:
        exchange, bad = session.robot.exchange, False

        def dumb(desired: Any) -> Any:
            nonlocal bad
            sample, bad = exchange(desired), bad or session.presses()
            return sample._replace(sensor_force=shows) if bad else sample

        session.robot.exchange = dumb  # type: ignore[method-assign, assignment]
        assert int(session.run(2.0)["step_failures"]) > 500
    else:
        broken = session.broken(stages.sense_alone, "")
        session.run(2.0)
        assert broken.raised > 500
    faulty = [telemetry for telemetry in session.link.telemetry if telemetry.status == Status.SENSOR_FAULT]
    assert faulty[0].exact_force > 1.9
    assert faulty[400].exact_force > 0.7  # for half a second it holds its place, and foam gives way
    assert all(telemetry.exact_force == 0.0 for telemetry in faulty[1000:])
    assert session.largest < 2.1
    assert len(session.forces) < 3000  # and the session's end does not wait for a force that nobody can see


@pytest.mark.parametrize("settings", [LINE, SCENE], ids=["line", "scene"])
def test_a_session_that_ends_while_its_force_sensor_is_dead_leaves_no_robot_pressing(
    monkeypatch: pytest.MonkeyPatch, settings: SessionSettings
) -> None:
    session = Session(monkeypatch, settings)
    stop, exchange, dead = StopFlag(), session.robot.exchange, 0

    def dying(desired: Any) -> Any:
        nonlocal dead
        sample = exchange(desired)
        dead += 1 if dead or session.presses() else 0
        if dead == 150:
            stop.set("the session was ended")
        if isinstance(sample, SpatialSample):
            return sample._replace(force=(0.0, 0.0, 0.0)) if dead else sample
        return sample._replace(sensor_force=0.0) if dead else sample

    session.robot.exchange = dying  # type: ignore[method-assign, assignment]
    session.run(stop=stop)
    assert session.link.telemetry[-1].status == Status.SENSOR_FAULT
    assert session.largest > 2.0
    assert session.force == 0.0


def test_where_conditioning_raises_too_the_plain_force_is_felt(monkeypatch: pytest.MonkeyPatch) -> None:
    session = Session(monkeypatch, PLUG_IN)
    session.broken(Conditioner, "update")
    ran = session.run(2.0)
    assert ran["step_failures"] > 500
    assert 0.0 < session.largest < CEILING
    telemetry = session.link.telemetry
    pressed = [one for one in telemetry if one.status != Status.UNLOADING][-300:]
    assert telemetry[-1].status == Status.UNLOADING
    assert all(telemetry.in_contact and 1.0 < telemetry.force < CEILING for telemetry in pressed)
    assert session.force < REST_FORCE + 0.1


@pytest.mark.parametrize("settings", [LINE, SCENE], ids=["line", "scene"])
@pytest.mark.parametrize("times", [1, pytest.param(3, marks=pytest.mark.long), float("inf")])
@pytest.mark.first
def test_a_robot_whose_exchange_raises_is_unloaded_if_it_takes_the_next(
    monkeypatch: pytest.MonkeyPatch, settings: SessionSettings, times: float
) -> None:
    monkeypatch.setattr(live, "LEAVING", 1.0 if times < float("inf") else 0.2)
    session = Session(monkeypatch, settings)
    session.broken(session.robot, "exchange", times)
    with pytest.raises(SideError, match="the follower failed: ZeroDivisionError"):
        session.run()
    deaf = [line for line in session.said if "takes no commands any more" in line]
    if times < float("inf"):
        assert session.force < REST_FORCE + 0.1
        assert deaf == []
    else:
        assert session.force > 2.0  # nobody could
        assert len(deaf) == 1


FOR_EVER = float("inf")


@pytest.mark.parametrize(
    ("settings", "owner", "name", "times"),
    [
        (LINE, stages.allow_alone, "", FOR_EVER),
        (SCENE, probe.allow_alone, "", FOR_EVER),
        pytest.param(SCENE, probe.sense_alone, "", FOR_EVER, marks=pytest.mark.long),
        pytest.param(SCENE, ProbeInSpace, "_report", FOR_EVER, marks=pytest.mark.long),
        (LINE, Spoken, "publish", 1),
        (LINE, Spoken, "publish", FOR_EVER),
    ],
)
def test_where_the_loop_itself_must_end_the_robot_is_unloaded_first(
    monkeypatch: pytest.MonkeyPatch, settings: SessionSettings, owner: Any, name: str, times: float
) -> None:
    session = Session(monkeypatch, settings)
    session.broken(session.link if owner is Spoken else owner, name, times)
    silent = owner is Spoken and times > 1  # nobody can be told then
    with pytest.raises(
        (SideError, ZeroDivisionError) if silent else SideError, match=None if silent else "the follower failed: Z"
    ):
        session.run()
    assert session.largest > 2.0
    assert session.force < REST_FORCE + 0.1
    assert session.largest < CEILING


def test_what_cannot_say_what_it_is_is_told_all_the_same() -> None:
    class Mute(Exception):
        def __str__(self) -> str:
            raise ValueError

    failures = Failures()
    failures.note("its sensors", Mute())
    failures.note("its sensors", ValueError("later"))
    assert (failures.count, failures.sentence, failures.learns) == (2, "Mute raised in its sensors", True)
    failures.stop_learning("its learning", ValueError("x" * 1000))
    assert failures.sentence.startswith("ValueError raised in its learning (xxx")
    assert len(failures.sentence) < 300
    assert not failures.learns
