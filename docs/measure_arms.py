"""Measure sessions with the arms of the package beside the plain robot: the blocks of `docs/arms.md`.

- `line`, `speed`: how well a session goes with each, and how long it takes.
- `grips`: whether a session stays stable in a closed loop, with each grip and over both networks.
- `scenes`: how well a session in a scene goes with each.
- `links`: how hard a link presses on something that stands in its way.
- `weight`: what a calibration of the sensor at the wrist leaves of the tool's weight.
- `ceilings`: how hard the probe presses, whatever is commanded and whatever fails, by SEEDS seeds, 200 without.

Usage: `.venv/bin/python docs/measure_arms.py [TABLE ...] [SEEDS]`, without names for all. On two cores `line`
takes about eight minutes, `links` two, `weight` some seconds, and `ceilings` 20 s for a seed.
"""

from __future__ import annotations

import itertools
import math
import statistics
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from joblib import Parallel, delayed
from measured_blocks import chosen, fill
from measuring import figure, table

from foretouch.devices import GRIPS
from foretouch.identification import fit_tool_load
from foretouch.link import Faults, FaultStage
from foretouch.messages import VERSION, Command
from foretouch.report import session_figures
from foretouch.robot import (
    SENSOR_FAULTS,
    ArticulatedArm,
    FaultySpatialSensor,
    GantryArm,
    SensorFault,
    SpatialRobot,
    read_arm,
)
from foretouch.robot.arms import Obstacle
from foretouch.robot.arms.body import Body
from foretouch.robot.arms.sensing.wrist_sensor import WristSensor
from foretouch.robot.gantry_arm import LEAST_STEPS
from foretouch.session import SessionSettings
from foretouch.session.runners.simulated import simulate
from foretouch.session.safety.safety import SafetyLimits
from foretouch.session.spatial import make_scene
from foretouch.session.spatial.probe import ProbeInSpace
from foretouch.session.steps import follower
from foretouch.settings import ARMS, SIMULATED

PAGE = Path(__file__).parent / "arms.md"

SEEDS = range(410, 418)
"""Nothing was chosen on these."""

ROBOTS = (SIMULATED, *ARMS)
MATERIALS = ("hunt-crossley", "kelvin-voigt", "foam-measured")
LENGTH = 20.0  # Of a session whose time is taken [s]


class Went(NamedTuple):
    """How a session went."""

    error: float | None  # of the prediction at equal command [%]; None where there is no score
    there: float | None  # of the same model at the robot's place [%]
    held: bool  # whether the robot held although nothing stood in its way


def went(robot: str, material: str, scene: str, seed: int) -> Went:
    """A session of 20 s."""
    settings = SessionSettings(robot=robot, material=material, scene=scene, seed=seed)
    figures = session_figures(simulate(settings, duration=20.0, say=lambda _: None).log)
    held = "obstructed" in figures["safety"]["statuses"]
    return Went(figures["prediction_error_percent"], figures["equal_position"]["prediction_error_percent"], held)


def errors(what: str, places: Sequence[tuple[str, str]], seeds: Sequence[int]) -> str:
    """A table of medians and worst cases by robot and place, with the ratio of the medians to those of the plain robot.

    A place is a material and a scene, the line where that is empty.
    """
    cases = list(itertools.product(ROBOTS, places, seeds))
    each = Parallel(n_jobs=JOBS)(delayed(went)(robot, *place, seed) for robot, place, seed in cases)
    found, rows, plain = dict(zip(cases, each, strict=True)), [], {}
    for robot, place in itertools.product(ROBOTS, places):
        several = [found[robot, place, seed] for seed in seeds]
        known = [(one.error, one.there) for one in several if one.error is not None and one.there is not None]
        error, there = zip(*known, strict=True)
        median = statistics.median(error)
        plain.setdefault(place, median)
        rows.append(
            [
                f"`{robot}`",
                place[1] or place[0],
                str(len(known)),
                f"{figure(median)} / {figure(max(error))}",
                f"{median / plain[place]:.2f}",
                f"{figure(statistics.median(there))} / {figure(max(there))}",
                str(sum(one.held for one in several)),
            ]
        )
    heads = ("`--robot`", what, "Sessions with a score", "Prediction error [%]", "To that of `simulated`")
    return table((*heads, "At the robot's place [%]", "Held for nothing"), rows)


def line() -> str:
    """Along a line, by material."""
    return errors("Material", [(material, "") for material in MATERIALS], SEEDS)


def scenes() -> str:
    """On the hill, where the plain robot is a gantry."""
    return errors("Scene", [("hunt-crossley", "hill")], SEEDS)


def looped(robot: str, grip: str, material: str, network: tuple[float, float]) -> dict[str, Any]:
    """Figures of a session in which the force moves a hand."""
    there, back = network
    settings = SessionSettings(
        robot=robot, grip=grip, material=material, position_delay=there, force_delay=back, seed=SEEDS[0]
    )
    return session_figures(simulate(settings, duration=12.0, say=lambda _: None).log)


def grips() -> str:
    """The account of energy, and the largest forces, by arm and grip: the worst of materials and networks."""
    rows = []
    for robot, grip in itertools.product(ROBOTS, GRIPS):
        cases = itertools.product(MATERIALS, NETWORKS)
        found = Parallel(n_jobs=JOBS)(delayed(looped)(robot, grip, *case) for case in cases)
        hands = [one["hand"] for one in found]
        rows.append(
            [
                f"`{robot}`",
                grip,
                str(len(found)),
                str(sum(one["stable"] is True for one in found)),
                str(sum(hand["certificate_holds"] for hand in hands)),
                figure(max(one["energy_used_percent"] for one in found)),
                figure(max(hand["peak_force_hand_N"] for hand in hands)),
                figure(max(hand["peak_force_robot_N"] for hand in hands)),
                str(sum(bool(one["safety"]["statuses"]) for one in found)),
            ]
        )
    heads = (
        "`--robot`",
        "Grip",
        "Sessions",
        "Stable",
        "Certificate kept",
        "Used of its bound [%]",
        "Peak at the hand [N]",
    )
    return table((*heads, "Peak at the robot [N]", "Robot held in"), rows)


NETWORKS = ((0.08, 0.3), (1.0, 1.0))
"""Delays of the position and of the force [s]."""


def speed() -> str:
    """How long a simulated millisecond takes, in free air; and how much faster than real time a session runs.

    In processor time: what else runs on the machine counts little then.
    """
    rows = []
    for name in ROBOTS:
        took = sorted(exchange_times(name))
        settings = SessionSettings(robot=name, material="hunt-crossley")
        simulate(settings, duration=0.0)  # loads once what a session needs
        begun = time.process_time()
        simulate(settings, duration=LENGTH)
        whole = LENGTH / (time.process_time() - begun)
        middle, late = took[len(took) // 2], took[int(0.99 * len(took))]
        rows.append([f"`{name}`", f"{1e6 * statistics.fmean(took):.0f}", f"{1e6 * middle:.0f}", f"{1e6 * late:.0f}"])
        rows[-1].append(f"{whole:.1f}")
    heads = ("`--robot`", "Mean of an exchange [us]", "Median [us]", "99 % [us]", "`simulate`, times real time")
    return table(heads, rows)


def exchange_times(name: str) -> list[float]:
    """Times of exchanges [s]."""

    plain = name == SIMULATED
    robot: SpatialRobot = GantryArm(nothing, seed=0) if plain else ArticulatedArm(read_arm(name), nothing, seed=0)
    took = []
    for k in range(5000):
        place = (0.0, 0.0, 0.05 - 1e-6 * k)
        begun = time.process_time()
        robot.exchange(place)
        took.append(time.process_time() - begun)
    return took


CEILING = SafetyLimits().force
STIFFNESSES = (1e3, 1e4, 1e5)
MS = 1_000_000


AWAY = (0.0, 0.0, -9.0)  # Where no link comes [m]


def nothing(*_: object) -> tuple[float, float, float]:
    """Free air."""
    return 0.0, 0.0, 0.0


class Met(NamedTuple):
    """What came of a link that met an obstacle."""

    peak: float  # largest force at the link [N]
    bound: float  # v sqrt(k m) [N]
    noticed: float  # time from the first touch until the arm noticed it [ms], infinite where it did not
    held: float  # force in the end [N]


class Crossing:
    """An arm whose tip crosses its box in a seeded direction, level, at the largest speed that a session lets it have.

    It begins at the one side, at rest.
    """

    def __init__(self, name: str, seed: int, obstacle: Obstacle) -> None:
        self.arm = ArticulatedArm(read_arm(name), nothing, seed=seed, obstacle=obstacle)
        numbers = np.random.default_rng(seed)
        turned, (_, highest) = numbers.uniform(0.0, 2.0 * math.pi), self.arm.reach
        half = 0.9 * min(highest[:2]) * np.array((math.cos(turned), math.sin(turned), 0.0))
        middle = np.array(self.arm.read().exact_place)
        self.numbers, self._from, self._way = numbers, middle - half, 2.0 * half
        speed = min(SafetyLimits().speed, self.arm.largest_speed)
        self.ticks = round(1e3 * float(np.linalg.norm(self._way)) / speed)
        for k in range(1500):
            self.arm.exchange(tuple(middle - half * min(k / 1e3, 1.0)))

    def go(self, tick: int) -> bool:
        """Go on for a tick; whether the arm says that it has met something."""
        return self.arm.exchange(tuple(self._from + self._way * min(tick / self.ticks, 1.0))).held


def met(name: str, stiffness: float, seed: int) -> Met:
    """A link that moves at least half as fast as the fastest meets a ball halfway."""
    ball = Obstacle(AWAY, 0.03, stiffness)
    free, places = Crossing(name, seed, ball), []
    for tick in range(free.ticks // 2 + 20):
        free.go(tick)
        places.append(ball.places())
    at = free.ticks // 2
    velocity = (places[at + 19] - places[at]) / 0.019
    speeds = np.linalg.norm(velocity, axis=1)
    ball = Obstacle(AWAY, 0.03, stiffness)
    crossing = Crossing(name, seed, ball)
    for link in free.numbers.permutation(np.flatnonzero(speeds > 0.5 * speeds.max())):
        place = places[at][link] + ball.distances()[link] * velocity[link] / speeds[link]
        ball.move(tuple(place.tolist()))
        if ball.clear:
            break
    else:
        return Met(0.0, 0.0, math.inf, 0.0)
    began, noticed, bound, forces = None, math.inf, 0.0, []
    for tick in range(crossing.ticks + 2000):
        says = crossing.go(tick)
        forces.append(float(ball.force.max()))
        if began is None and forces[-1] > 0.0:
            began, first = tick, int(ball.force.argmax())
            bound = float(speeds[first]) * math.sqrt(stiffness * ball.mass(crossing.arm.body, first))
        if says and began is not None:
            noticed = min(noticed, float(tick - began))
    return Met(max(forces), bound, noticed, statistics.fmean(forces[-200:]))


def links() -> str:
    """A table of the worst by arm and stiffness, and how often it was noticed."""
    rows = []
    for name in ARMS:
        for stiffness in STIFFNESSES:
            found = Parallel(n_jobs=2)(delayed(met)(name, stiffness, seed) for seed in LINK_SEEDS)
            found = [one for one in found if one.bound > 0.0]
            worst = max(found, key=lambda one: one.peak)
            seen = [one.noticed for one in found if math.isfinite(one.noticed)]
            rows.append(
                [
                    f"`{name}`",
                    f"{stiffness / 1e3:g}",
                    figure(worst.peak),
                    figure(worst.bound),
                    f"{len(seen)} of {len(found)}",
                    f"{max(seen):.0f}" if seen else "",
                    figure(max(one.held for one in found)),
                ]
            )
    heads = ("`--robot`", "Obstacle [kN/m]", "Peak [N]", "There v sqrt(k m) [N]", "Noticed", "After [ms]", "Held [N]")
    return table(heads, rows)


LINK_SEEDS = range(20, 23)


class Standing:
    """An arm that stands still in one pose after another, with its own kind of sensor at its wrist.

    Args:
        name: Of the arm.
        seed: Of poses and noise.
        piece: Which sensor of its kind it is; 0 is the one that the arm has in a session.
    """

    def __init__(self, name: str, seed: int, piece: int = 0) -> None:
        self.body, self._numbers = Body(read_arm(name), 1e-3 / LEAST_STEPS), np.random.default_rng(seed)
        self.sensor = WristSensor(1e-3 / LEAST_STEPS, seed=seed, piece=piece)

    def pose(self) -> tuple[np.ndarray, np.ndarray]:
        """Go to a random pose that its joints reach; the flange's matrix, and what the sensor shows: 100 samples."""
        limits, data = self.body.limits(), self.body.data
        self.body.stand(self._numbers.uniform(limits["low"], limits["high"]))
        data.qacc[:] = 0.0  # it stands still: `mj_inverse` then finds what holds it, and its sensors show the weight
        mujoco.mj_inverse(self.body.model, data)
        self.sensor.settle(data.sensordata[:6])
        rotation = np.array(self.body.sensor_rotation).reshape(3, 3)
        return rotation, np.array([self.sensor.read().copy() for _ in range(100)])

    def poses(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """So many of them: matrices, and the means of what is shown."""
        matrices, shown = zip(*[self.pose() for _ in range(count)], strict=True)
        return np.array(matrices), np.array([one.mean(axis=0) for one in shown])


class Left(NamedTuple):
    """What is left of the tool's weight where it was not calibrated, the largest of 50 poses."""

    force: float  # [N]
    torque: float  # [N m]


def left(name: str, piece: int = 0, poses: int = 12) -> Left:
    """Calibrate an arm in so many random poses, and look in 50 others, all with a cold sensor."""
    arm = Standing(name, 1000 + piece, piece)
    matrices, shown = arm.poses(poses)
    load = fit_tool_load(-matrices[:, 2, :], shown[:, :3], shown[:, 3:]).load
    assert load is not None
    there = [load.contact(wrench, matrix) for matrix, wrench in zip(*arm.poses(50), strict=True)]
    sizes = np.linalg.norm(np.reshape(there, (50, 2, 3)), axis=2).max(axis=0)
    return Left(*sizes.tolist())


PIECES = range(400, 430)
"""Sensors of their kind, on which nothing was chosen."""


def weight() -> str:
    """A table by arm with a sensor at its wrist: with the arm's own, and with others of its kind."""
    rows = []
    for name in (one for one in ARMS if read_arm(one).force == "wrist"):
        own, others = left(name), [left(name, piece) for piece in PIECES]
        forces, torques = [one.force for one in others], [one.torque for one in others]
        rows.append([f"`{name}`", f"{own.force:.3f}", f"{own.torque:.4f}"])
        rows[-1] += [f"{statistics.median(forces):.3f} / {max(forces):.3f}"]
        rows[-1] += [f"{statistics.median(torques):.4f} / {max(torques):.4f}"]
    heads = ("`--robot`", "Force [N]", "Torque [N m]", "30 other sensors: force [N]", "Their torque [N m]")
    return table(heads, rows)


class Pressed(NamedTuple):
    """What came of a hostile session."""

    force: float  # largest at the probe [N]
    later: float  # largest that is no first impact: later than 0.1 s after the contact began [N]
    bound: float  # the largest of an impact that pushes with the ceiling P meanwhile: P + sqrt(P^2 + k m v^2) [N]
    beyond: float  # largest force of a first impact over its own such bound, or over P where none was
    speed: float  # of the joints, as a share of their limit
    torque: float  # likewise
    change: float  # of the commanded joint speeds, or of the torques where these are commanded, likewise
    touched: bool
    singular: bool  # whether it touched in a pose so nearly singular that the arm slows down
    side: bool  # whether it touched where the box's side holds the tip back
    fault: bool  # whether the sensor failed while it touched


APART = 100
"""Milliseconds in which an impact is over; and in the air until what comes next is an impact of its own, no bounce."""

EDGE = 2e-3  # Distance from the side of a box within which the tip is held by it [m]


class Hostile:
    """A session whose commands and network are as bad as a seed makes them, over a stiff floor.

    Every other one begins at a side or a corner of the box, where commands lead beyond it and, at the side near its
    base, an arm is nearest to a singular pose.
    """

    def __init__(self, name: str, stiffness: float, seed: int) -> None:
        self.numbers, scene = np.random.default_rng(seed), make_scene("plane")
        self.stiffness, self.now, self.sequence = stiffness, 0, 0
        description, aside = read_arm(name), self.numbers.integers(-1, 2, 2) * int(self.numbers.random() < 0.5)
        low, high = description.reach[:, :2]
        x, y = np.where(aside < 0, low, np.where(aside > 0, high, 0.0)).tolist()
        self.arm = ArticulatedArm(description, self._floor, seed=seed, start=(x, y, 0.004))
        self.middle, self.began, self.left = np.array((x, y, 0.0)), -APART, -APART
        kinds = (*SENSOR_FAULTS, *[""] * len(SENSOR_FAULTS))
        kind, begin = str(self.numbers.choice(kinds)), self.numbers.uniform(0.5, 4.0)
        self.failing = (begin, begin) if not kind else (begin, begin + self.numbers.uniform(0.1, 2.0))
        self.robot: SpatialRobot = self.arm
        if kind:
            fault = SensorFault(kind, *self.failing)
            self.robot = FaultySpatialSensor(self.arm, fault, seed=seed)
        settings = SessionSettings(robot=name, scene="plane", seed=seed, first_touch="follow")
        self.state = follower.start(
            self.robot.specification, settings, probe=ProbeInSpace(scene.surface, scene.nominal)
        )
        bad = (
            Faults(0.0),
            Faults(0.05, jitter=0.05, loss=0.2, burst=10.0, seed=seed),
            Faults(0.0, outage=0.7, seed=seed),
        )
        self.network: FaultStage[Command] = FaultStage(bad[seed % len(bad)])
        self.sample = self.robot.read()

    def _floor(self, place: Any, velocity: Any, elapsed: float) -> tuple[float, float, float]:
        return 0.0, 0.0, max(-self.stiffness * place[2], 0.0)

    def tick(self, place: tuple[float, ...] | None) -> None:
        """One tick, with a command or without one."""
        self.now += MS
        if place is not None:
            self.sequence += 1
            late = self.now - (MS * 2000 if self.numbers.random() < 0.02 else 0)
            fields = {"holder": "enemy", "epoch": 1, "telemetry_sequence": self.state.tick, "run": 1}
            self.network.push(self.now, Command(VERSION, self.sequence, late, 0.0, 0, place=place, **fields))
        inputs = follower.Inputs(self.network.pop_due(self.now), self.sample, MS, 0)
        self.state, told = follower.step(self.state, inputs, self.now)
        self.sample = self.robot.exchange(told.desired_position)

    def _shares(self, before: Any) -> tuple[float, float, float]:
        """Speed, torque, and the change of what the joints are commanded, as shares of their limits."""
        body, commanded, period = self.arm.body, self.arm.control.commanded, 1.0 / self.arm.body.description.rate
        description = body.description
        by_torque = description.control == "impedance"
        changes = description.torque_rate if by_torque else description.joint_acceleration
        speeds = body.velocities if by_torque else commanded
        return (
            float((np.abs(speeds) / description.joint_speed).max()),
            float((np.abs(body.data.ctrl) / body.limits()["torque"]).max()),
            float((np.abs(commanded - before) / (changes * period)).max()),
        )

    def _happened(self, tick: int) -> tuple[bool, bool, bool, bool]:
        """What happens while it touches: see `Pressed`."""
        place, (low, high) = np.array(self.sample.exact_place), np.array(self.arm.reach)
        side = bool((np.minimum(place - low, high - place)[:2] < EDGE).any())
        begins, ends = self.failing
        return True, self.arm.speed_share < 1.0, side, begins <= 1e-3 * tick < ends

    def _impact(self, tick: int, force: float, sinks: float) -> tuple[float, bool]:
        """Bound of a first impact that begins now [N], else 0; and whether the force is still of one."""
        if force > 0.0:
            begins = tick - self.left > APART
            self.began, self.left = tick if begins else self.began, tick
            if begins:
                mass = self.arm.body.mass_along(np.array((0.0, 0.0, -1.0)))
                return CEILING + math.hypot(CEILING, max(sinks, 0.0) * math.sqrt(mass * self.stiffness)), True
        return 0.0, tick - self.began <= APART

    def run(self, seconds: float) -> Pressed:
        """Steps, ramps, silence and what is no number, into the floor and beyond the box's sides."""
        worst, before, bound = np.zeros(len(Pressed._fields)), self.arm.control.commanded.copy(), 0.0
        goal, speed, silent = np.array(self.sample.place), 1.0, 0
        place = goal.copy()
        for tick in range(round(seconds * 1e3)):
            if self.numbers.random() < 0.002:
                wide = 0.3 if self.numbers.random() < 0.2 else 0.02  # beyond the box, or over the floor
                goal, speed = (
                    self.middle + self.numbers.uniform((-1.0, -1.0, -0.05), (1.0, 1.0, 0.01)) * (wide, wide, 1.0),
                    10.0 ** self.numbers.uniform(-2.0, 2.0),
                )
            silent = int(self.numbers.uniform(60, 1500)) if self.numbers.random() < 3e-4 else max(silent - 1, 0)
            left = goal - place
            place = place + left * min(speed * 1e-3 / max(float(np.linalg.norm(left)), 1e-12), 1.0)
            told = (math.nan,) * 3 if self.numbers.random() < 0.01 else tuple(place.tolist())
            sinks = -float(self.arm.body.velocity[2])
            self.tick(None if silent else told)
            force = self.sample.exact_force[2]
            begun, first = self._impact(tick, force, sinks)
            bound = begun or bound
            beyond = force / max(bound, CEILING) if first else 0.0
            shares, before = self._shares(before), self.arm.control.commanded.copy()
            happened = self._happened(tick) if force > 0.0 else (False,) * 4
            worst = np.maximum(worst, (force, 0.0 if first else force, begun, beyond, *shares, *happened))
        return Pressed(*worst.tolist())


def pressed(name: str, stiffness: float, seed: int) -> Pressed:
    """A hostile session of 6 s."""
    return Hostile(name, stiffness, seed).run(6.0)


SESSIONS = "Sessions / touch / singular / side / fault"


def ceilings(seeds: int = 200) -> str:
    """A table of the largest by arm and stiffness."""
    rows = []
    for name in ARMS:
        for stiffness in STIFFNESSES:
            found = Parallel(n_jobs=JOBS)(delayed(pressed)(name, stiffness, seed) for seed in range(seeds))
            worst = Pressed(*np.max(np.array(found), axis=0).tolist())
            over, later = (sum(force > CEILING for force in column) for column in list(zip(*found, strict=True))[:2])
            happened = [sum(map(int, kind)) for kind in list(zip(*found, strict=True))[-4:]]
            shares = (worst.speed, worst.torque, worst.change)
            rows.append(
                [
                    f"`{name}`",
                    f"{stiffness / 1e3:g}",
                    " / ".join(map(str, (seeds, *happened))),
                    figure(worst.force),
                    str(over),
                    str(sum(one.beyond > 1.0 for one in found)),
                    figure(worst.later),
                    str(later),
                    *(f"{100.0 * share:.0f}" for share in shares),
                ]
            )
    heads = ("`--robot`", "Floor [kN/m]", SESSIONS, "Peak [N]", "Above 15 N in", "Beyond its bound in", "Later [N]")
    limits = ("Joint speed [%]", "Torque [%]", "Its change, or that of speed [%]")
    return table((*heads, "Above 15 N in", *limits), rows)


JOBS = 2
MEASURED = {
    "line": line,
    "grips": grips,
    "scenes": scenes,
    "speed": speed,
    "links": links,
    "weight": weight,
    "ceilings": ceilings,
}


if __name__ == "__main__":
    counts, names = (
        [int(one) for one in sys.argv[1:] if one.isdigit()],
        [one for one in sys.argv[1:] if not one.isdigit()],
    )
    for name in chosen(names, MEASURED):
        text = ceilings(*counts) if name == "ceilings" else MEASURED[name]()
        print(f"{name}\n\n{text}\n", flush=True)
        fill(PAGE, {name: text})
