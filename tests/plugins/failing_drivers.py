"""Drivers that fail against their promises, as modules of packages that are made for a test: by name, how they do."""

from __future__ import annotations

DEVICE = """
import ctypes, threading, time

from foretouch.devices import Device


class Failing(Device):
    closed_loop = False
    real_time = False

    def __init__(self, call):
        self.name, self.reads = call, 0

    def read(self, now_ns):
        self.reads += 1
        if self.name == "read" and self.reads > 2000:
            threading.Event().wait()
        if self.name == "torn" and self.reads > 2000:
            raise OSError("the cable is torn")
        if self.name == "held" and self.reads > 2000:
            ctypes.PyDLL(None).sleep(1000)  # as a binding in C that keeps the interpreter
        return 0.0

    def render(self, force):
        return 0.0

    def close(self):
        if self.name == "close":
            threading.Event().wait()


def read(settings, reach):
    return Failing("read")


def torn(settings, reach):
    return Failing("torn")


def held(settings, reach):
    return Failing("held")


def close(settings, reach):
    return Failing("close")
"""

ROBOT = """
import threading

from foretouch.robot import make_robot


def stuck(settings):
    return failing(threading.Event().wait)


def torn(settings):
    def fail():
        raise OSError("the drive is gone")

    return failing(fail)


def vanishing(settings):
    failed = []

    def fail():
        failed.append(1)
        if len(failed) > 1:
            threading.Event().wait()
        raise OSError("the drive is gone")

    return failing(fail, 1.5)  # a robot that presses unloads at last


def failing(fail, least_force=0.0):
    robot = make_robot("hunt-crossley", seed=1)
    move, left = robot.exchange, [1000]

    def exchange(desired):
        sample = move(desired)
        if left[0] < 1000 or sample.exact_force > 0.5:  # from the first press on: then there is a leader
            left[0] -= 1
        if left[0] < 0 and sample.exact_force >= least_force:
            fail()
        return sample

    robot.exchange = exchange
    return robot
"""
