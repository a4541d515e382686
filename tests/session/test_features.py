"""Every cell of the table "Features by scene": where the page says yes, a short session shows it; else it is refused.

The sessions begin just above the surface, over a network that is quick, and without images.
"""

from __future__ import annotations

import importlib
import math
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from foretouch.devices import Device, RestingOperator, SpatialDevice
from foretouch.errors import ForetouchError
from foretouch.messages import SessionLog, Status
from foretouch.plugins import all_plugins
from foretouch.quantities import SensorCalibration
from foretouch.recordings import write_calibration
from foretouch.report import session_report
from foretouch.robot import SENSOR_FAULTS, GantryArm, MovedRobot, MovedSpatialRobot, make_material, make_robot
from foretouch.session import SessionSettings, make_operator, replay_under, simulate
from foretouch.session.operators import mounted_operator, mounted_robot
from foretouch.session.runners import simulated
from foretouch.session.runners.driven import Tick
from foretouch.session.runners.shadow import Shadow
from foretouch.session.settings import shadow_settings
from foretouch.session.spatial import make_spatial_operator
from foretouch.session.spatial.making import SpatialWorld
from foretouch.session.spatial.scenes import MIDDLE, _above, make_specimen
from foretouch.settings import UNKNOWN

PAGE = Path(__file__).parents[2] / "docs" / "scenes.md"
SURFACE, CLEARANCE, DEPTH = 0.010, 0.002, 0.003  # along a line, and how high and deep a hand goes [m]
QUICK = {"position_delay": 0.005, "force_delay": 0.01, "material": "hunt-crossley"}
STILL = {"fusion": "contact", "displacement": 0.0, "turn": 0.0}
MS = 1_000_000
STIFFNESS = 4000.0  # of the arm between encoder and tip [N/m]


def table() -> dict[tuple[str, str], str]:
    """Cells of the table of the page, by feature and scene."""
    text = PAGE.read_text().partition("## Features by scene")[2].partition("\n## ")[0]
    rows = [[cell.strip() for cell in line.strip("|\n ").split("|")] for line in text.splitlines() if line[:1] == "|"]
    head, _, *body = rows
    return {(row[0], scene): cell for row in body for scene, cell in zip(head[1:], row[1:], strict=True)}


CELLS = table()


def depth_at(time: float) -> float:
    """Depth of the hand: down to 3 mm within 0.4 s, and twice a second up and down again [m]."""
    if time < 0.4:
        return -CLEARANCE + (CLEARANCE + DEPTH) * 0.5 * (1.0 - math.cos(math.pi * time / 0.4))
    return DEPTH - 0.5 * (DEPTH + CLEARANCE) * (1.0 - math.cos(4.0 * math.pi * (time - 0.4)))


class Line(Device):
    """A hand that presses along a line."""

    name, closed_loop = "press", False

    def read(self, now_ns: int) -> float:
        return SURFACE + depth_at(now_ns * 1e-9)

    def render(self, force: float) -> float:
        return force

    @property
    def intention(self) -> float:
        return math.nan


class Space(SpatialDevice):
    """A hand that presses straight down on a scene."""

    name = "press"

    def __init__(self, top: tuple[float, float, float]) -> None:
        self.top = top

    def read(self, now_ns: int) -> tuple[float, float, float]:
        x, y, z = self.top
        return x, y, z - depth_at(now_ns * 1e-9)


class Place:
    """Where a feature is tried: a line or a scene, with the machines that press there."""

    def __init__(self, scene: str, folder: Path) -> None:
        self.scene, self.folder = scene, folder

    def settings(self, **changes: Any) -> SessionSettings:
        own = {"scene": self.scene} | STILL if self.scene else {}
        if self.scene == UNKNOWN:
            own |= {"fusion": "none", "specimen": "plane"}  # its touches show the shape
        return SessionSettings(**QUICK | own | changes)

    @property
    def top(self) -> tuple[float, float, float]:
        """The surface where it is pressed, in the world [m]."""
        scene = make_specimen(self.settings())
        x, y, z = _above(scene, *MIDDLE[:2], 0.0)
        return x + scene.nominal[0], y, z

    def robot(self, settings: SessionSettings, start: tuple[float, float, float] | None = None) -> Any:
        """The simulated arm, near the surface."""
        if not self.scene:
            arm = make_robot(settings.material, seed=settings.seed)
            for tick in range(400):
                arm.exchange((SURFACE - CLEARANCE) * min(tick / 300, 1.0))
            arm.mj_data.time = 0.0  # a session takes a fresh one
            return mounted_robot(settings, arm)
        scene, (x, y, z) = make_specimen(settings), start or self.top
        world = SpatialWorld(scene, make_material(settings.material), displacement=0.0, turn=0.0, bump=0.0, seed=0)
        arm = GantryArm(world.touch, world.fixture, seed=settings.seed, start=(x, y, z + CLEARANCE), substeps=4)
        return mounted_robot(settings, arm)

    def hand(self, settings: SessionSettings, *, moves: bool = True) -> Any:
        hand = Space(self.top) if self.scene else Line()
        if not moves:
            place = hand.read(0)
            hand.read = lambda now_ns: place  # type: ignore[method-assign]
        return mounted_operator(settings, hand)

    def run(self, seconds: float = 1.2, operator: Any = None, robot: Any = None, **changes: Any) -> SessionLog:
        settings = self.settings(**changes)
        operator = operator or self.hand(settings)
        return simulate(settings, duration=seconds, operator=operator, robot=robot or self.robot(settings)).log


BECOMES = {"threshold-switching": "hunt-crossley", "continuous-switching": "linearised-continuous-switching"}
"""Laws that estimators of others send where the material or the sample needs it."""


def law(name: str) -> Callable[[Place], None]:
    def check(place: Place) -> None:
        log = place.run(model=name)
        assert {model.law for model in log.models if model.valid} <= {name, BECOMES.get(name)}
        late = log.leader[800:]
        assert late["predicted_force"].max() > 0.2
        assert late["rendered_force"].max() > 0.2

    return check


def materials_that_remember(place: Place) -> None:
    follower = place.run(0.9, material="sponge", model="contact-map").follower
    position, force = follower["position"], follower["exact_force"]
    for deep in (0.0005, 0.001):  # pressed again to as deep as before, it gives less force
        here = np.abs(position - position[force > 0.0].max() + deep) < 1e-4
        down, up = here & (np.gradient(position) > 0.0), here & (np.gradient(position) < 0.0)
        assert force[up].mean() < 0.9 * force[down].mean()


def sensor_faults(place: Place) -> None:
    for kind in SENSOR_FAULTS:
        begin, operator = 0.4, None
        if kind == "offset-step":  # one is known where nothing is touched, and the robot is still
            begin, operator = 1.0, place.hand(place.settings(), moves=False)
        follower = place.run(begin + 0.3, sensor_fault=f"{kind}:{begin}", operator=operator).follower
        begun = round(1000 * begin)
        assert not follower["validity"][: begun - 5].any(), kind
        found = np.flatnonzero(follower["validity"])
        assert found.size, kind
        assert found[0] < begun + 200, kind
        assert Status.SENSOR_FAULT in follower["status"], kind


def shadow(place: Place) -> None:
    settings = shadow_settings(place.settings())
    if place.scene:
        hand = Space(place.top)
        robot: Any = MovedSpatialRobot(place.robot(settings), lambda time: hand.read(round(time * 1e9)))
    else:
        robot = MovedRobot(place.robot(settings), lambda time: SURFACE + depth_at(time))
    watched, messages = Shadow(robot, settings, 1), []
    for tick in range(1200):
        watched.pass_time(min(tick, 1))
        messages += watched.tick(Tick(tick * MS, MS))
    log = SessionLog.from_messages(messages, settings.as_text())
    assert set(log.follower["status"].tolist()) == {Status.SHADOW}
    assert np.isnan(log.follower["desired_position"]).all()
    assert log.leader["predicted_force"][800:].max() > 0.2


def frames(place: Place) -> None:
    frame = "0.4,0.1,-0.2,0.1,-0.3,1.5" if place.scene else "0.1,-1"
    plain, framed = place.run(0.8), place.run(0.8, leader_frame=frame, follower_frame=frame)
    assert framed.settings["leader_frame"] == frame
    for side, name in (("follower", "force"), ("follower", "position"), ("leader", "position")):
        # A height field's closest point may be on either side of an edge by rounding alone.
        # On any mesh the zero of the force is a mean over blocks of air, which rounding may let end a tick apart.
        tolerance = 0.05 if place.scene in ("hill", "phantom") else 1e-3 if place.scene else 1e-9
        np.testing.assert_allclose(getattr(framed, side)[name], getattr(plain, side)[name], atol=tolerance)
    assert plain.follower["force"].max() > 0.2
    assert framed.leader["rendered_force"].max() > 0.2


def baselines(place: Place) -> None:
    log = place.run(0.8, baseline="delayed")
    assert log.leader["rendered_force"].max() > 0.2
    np.testing.assert_allclose(log.leader["rendered_force"], log.leader["delayed_force"], atol=0.2)


def recorded_operator(place: Place) -> None:
    settings = place.settings(operator="recorded")
    if not place.scene:
        operator: Any = make_operator(settings, say=pytest.fail)
        log = place.run(1.9, operator=operator)
    else:
        scene = make_specimen(settings)
        recorded = make_spatial_operator(settings, scene, scene.nominal)
        recorded.read(0)
        x, y, z = recorded.read(4_500 * MS)

        class Later(SpatialDevice):  # the measured motion begins after 4.5 s
            name = recorded.name

            def read(self, now_ns: int) -> tuple[float, float, float]:
                return recorded.read(now_ns + 4_500 * MS)

        log = place.run(1.2, operator=Later(), robot=place.robot(settings, (x, y, z - CLEARANCE)))
    assert log.settings["operator"] == "recorded"
    assert log.follower["exact_force"].max() > 0.2


def replay(place: Place) -> None:
    settings = place.settings()
    log = simulate(settings, duration=0.3).log
    again = replay_under(log, settings)
    for side in ("leader", "follower"):
        one, other = getattr(log, side), getattr(again, side)
        names = [name for name in one.dtype.names if name != "compute_ns"]
        for name in names:
            np.testing.assert_array_equal(one[name], other[name])


def calibration(place: Place) -> None:
    path = place.folder / "sensor.toml"
    write_calibration(path, SensorCalibration(series_stiffness=STIFFNESS))
    tip, encoder = place.run(0.6, calibration=str(path)).follower, place.run(0.6).follower
    pressed = tip["exact_force"] > 0.3
    give = (encoder["position"] - tip["position"])[pressed][:20]  # later the robot goes deeper by as much
    np.testing.assert_allclose(give, tip["exact_force"][pressed][:20] / STIFFNESS, atol=5e-5)


def grips(place: Place) -> None:
    log = place.run(1.2, grip="soft")
    leader = log.leader[300:]
    assert np.isfinite(leader["exact_hand_position"]).all()
    assert leader["rendered_force"].max() > 0.1
    assert np.abs(leader["intended_position"] - leader["exact_hand_position"]).max() > 1e-4


def first_touch(place: Place) -> None:
    guarded = place.run(1.0, first_touch="guarded", guarded_force=0.5, force_delay=0.1).follower
    follows = place.run(1.0, first_touch="follow", guarded_force=0.5, force_delay=0.1).follower
    assert guarded["guarded"].any()
    assert not follows["guarded"].any()


POINTS = "[foretouch.robots]\narm = lab:arm\n[foretouch.devices]\npress = lab:press\nodd = lab:odd\n"
MADE: dict[str, Any] = {}
"""Machines that a package brings, made for a test."""


def plug_ins(place: Place) -> None:
    log = place.run(0.5)
    source = "from test_features import MADE\n" + "".join(
        f"def {name}(*_): return MADE[{name!r}]\n" for name in ("arm", "press", "odd")
    )
    info = place.folder / "lab-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: lab\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(POINTS)
    (place.folder / "lab.py").write_text(source)
    importlib.invalidate_caches()
    all_plugins.cache_clear()
    settings = place.settings()
    MADE.update(arm=place.robot(settings), press=place.hand(settings))
    MADE["odd"] = RestingOperator() if place.scene else Space((0.0, 0.0, 0.0))
    again = simulate(place.settings(robot="arm", operator="press"), duration=0.5).log
    np.testing.assert_array_equal(again.follower["force"], log.follower["force"])
    with pytest.raises(ForetouchError, match=r"operator = 'odd': moves (along one axis|in three dimensions), and "):
        simulate(place.settings(operator="odd"), duration=0.1)


def clutch(place: Place) -> None:
    log = place.run(0.9, grip="normal", clutch="0.4:0.6")
    engaged = log.leader["engaged"]
    assert engaged[100:380].all()
    assert not engaged[450:550].any()
    assert engaged[-1]


def network_faults(place: Place) -> None:
    log = place.run(0.8, loss=0.2, jitter=0.004, duplicate=0.1, reorder=0.1)
    assert sum(value for name, value in log.counts.items() if "lost" in name) > 50
    assert log.follower["exact_force"].max() > 0.2


def session_reports(place: Place) -> None:
    report = session_report(place.run(2.0))
    assert report.to_dict()["status"] == "ok"
    assert "prediction" in str(report)


FEATURES: dict[str, Callable[[Place], None]] = {
    "contact map": law("contact-map"),
    "Kelvin-Voigt": law("kelvin-voigt"),
    "Hunt-Crossley": law("hunt-crossley"),
    "threshold switching": law("threshold-switching"),
    "continuous switching": law("continuous-switching"),
    "materials that remember": materials_that_remember,
    "sensor faults": sensor_faults,
    "shadow": shadow,
    "frames": frames,
    "baselines": baselines,
    "recorded operator": recorded_operator,
    "replay": replay,
    "calibration": calibration,
    "grips": grips,
    "first touch": first_touch,
    "plug-ins": plug_ins,
    "clutch": clutch,
    "network faults": network_faults,
    "session reports": session_reports,
}


@pytest.fixture(scope="session")
def mesh(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A tile of 80 mm about the middle of the specimens, as a file."""
    x, y, _ = MIDDLE
    corners = [(x + 0.04 * a, y + 0.04 * b, 0.0) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    lines = [f"v {a} {b} {c}" for a, b, c in corners] + ["f 1 2 3", "f 1 3 4"]
    path = tmp_path_factory.mktemp("mesh") / "tile.obj"
    path.write_text("\n".join(lines) + "\n")
    return str(path)


@pytest.fixture
def packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of packages of this test alone."""
    monkeypatch.syspath_prepend(str(tmp_path))
    yield tmp_path
    sys.modules.pop("lab", None)
    all_plugins.cache_clear()


@pytest.fixture(autouse=True)
def _compiled_on_the_way(monkeypatch: pytest.MonkeyPatch) -> None:
    """In simulated time nothing depends on whether code was compiled before."""
    monkeypatch.setattr(simulated, "warm_up_once", lambda settings: None)


@pytest.mark.parametrize(
    ("feature", "scene"), [pytest.param(*cell, marks=[pytest.mark.long] * (cell[1] != "line")) for cell in CELLS]
)
def test_the_feature_is_there_or_refused_as_the_page_says(
    feature: str, scene: str, request: pytest.FixtureRequest, packages: Path
) -> None:
    name = {"line": "", "mesh": ""}.get(scene, scene)
    place = Place(request.getfixturevalue("mesh") if scene == "mesh" else name, packages)
    cell, check = CELLS[feature, scene], FEATURES[feature]
    if cell == "yes":
        check(place)
        return
    sentence = cell.removeprefix("no: ")
    assert sentence != cell, f"a cell says yes, or no: and why; and not {cell!r}"
    with pytest.raises(ForetouchError, match=re.escape(sentence)) as refused:
        check(place)
    assert "\n" not in str(refused.value)


def test_the_page_has_every_feature_that_is_tried() -> None:
    assert {feature for feature, _ in CELLS} == set(FEATURES)
