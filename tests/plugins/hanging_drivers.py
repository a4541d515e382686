"""Drivers whose calls do not come back, as modules of packages that are made for a test."""

from __future__ import annotations

DEVICE = """
import ctypes, threading, time

from foretouch.devices import Device


class Hung(Device):
    closed_loop = False
    real_time = False

    def __init__(self, call):
        self.name, self.reads = call, 0

    def read(self, now_ns):
        self.reads += 1
        if self.name == "read" and self.reads > 2000:
            threading.Event().wait()
        if self.name == "held" and self.reads > 2000:
            ctypes.PyDLL(None).sleep(1000)  # as a binding in C that keeps the interpreter
        return 0.0

    def render(self, force):
        return 0.0

    def close(self):
        if self.name == "close":
            threading.Event().wait()


def read(settings, reach):
    return Hung("read")


def held(settings, reach):
    return Hung("held")


def close(settings, reach):
    return Hung("close")
"""

ROBOT = """
import threading

from foretouch.robot import make_robot


def stuck(settings):
    robot = make_robot("hunt-crossley", seed=1)
    move, left = robot.exchange, [1000]

    def exchange(desired):
        sample = move(desired)
        if left[0] < 1000 or sample.exact_force > 0.5:  # from the first press on: then there is a leader
            left[0] -= 1
        if left[0] < 0:
            threading.Event().wait()
        return sample

    robot.exchange = exchange
    return robot
"""
