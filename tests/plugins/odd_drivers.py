"""Drivers that are too slow, give no position, cannot be opened, or do not say where their surface is."""

from __future__ import annotations

DEVICE = """
import math, threading, time

from foretouch.devices import Device, ScriptedOperator


class Odd(ScriptedOperator):
    def __init__(self, name, reach):
        super().__init__(*reach)
        self.name, self.ticks = name, 0

    def read(self, now_ns):
        self.ticks += 1
        here = super().read(now_ns)
        if self.name == "slow":
            time.sleep(3e-3)
        if self.name == "hung" and self.ticks > 5000:
            threading.Event().wait()
        if self.name == "blind" and 1500 < self.ticks <= 4500:
            return math.nan
        return here


def slow(settings, reach):
    return Odd("slow", reach)


def blind(settings, reach):
    return Odd("blind", reach)


def hung(settings, reach):
    return Odd("hung", reach)


def stuck(settings, reach):
    threading.Event().wait()


def cant(settings, reach):
    raise OSError("no device at /dev/lever0")
"""

ROBOT = """
import time

from foretouch.robot import Robot, RobotSample, RobotSpecification


class Probe(Robot):
    def __init__(self, pause=0.0):
        self.pause = pause
        self.specification = RobotSpecification(
            sample_period=1e-3, force_limit=10.0, encoder_resolution=1e-6, encoder_noise=0.0, tool_mass=0.0,
            gravity=0.0, sensor_noise=0.02, accelerometer_noise=0.0, sensor_bandwidth=500.0,
            workspace=(-0.02, 0.03), simulated=True,
        )
        self._told = self._place = 0.0
        self.reads = 0

    def read(self):
        self.reads += 1
        force = min(500.0 * max(self._place - 0.01, 0.0), 10.0) + 1e-4 * (self.reads % 7)
        return RobotSample(self._place, force, 0.0, force, self._place, self._told, False)

    def exchange(self, desired_position):
        time.sleep(self.pause)
        low, high = self.specification.workspace
        if abs(desired_position) < float("inf"):
            self._told = min(max(desired_position, low), high)
        self._place += min(max(self._told - self._place, -1e-4), 1e-4)
        return self.read()


def probe(settings):
    return Probe()


def slow(settings):
    return Probe(pause=8e-3)
"""
