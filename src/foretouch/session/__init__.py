"""Sessions: the steps of leader and follower, the two runners, the processes and their settings.

This is the only room with time, threads, processes and policy.
"""

from foretouch.session.frames import FramedDevice, FramedRobot, framed_device, framed_robot, inverse
from foretouch.session.housekeeping import Housekeeper, StopFlag, orphaned
from foretouch.session.live import FOLLOWER_CHANNELS, LEADER_CHANNELS, run_follower, run_leader, wait_for_hello
from foretouch.session.mediated import MediatedForce, mediate
from foretouch.session.operators import make_operator
from foretouch.session.processes import run_processes
from foretouch.session.recorder import RECORDER_CHANNELS, run_recorder
from foretouch.session.replay import Replay, replay
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.simulated import SimulatedSession, simulate

__all__ = [
    "FOLLOWER_CHANNELS",
    "LEADER_CHANNELS",
    "RECORDER_CHANNELS",
    "SAMPLE_PERIOD",
    "FramedDevice",
    "FramedRobot",
    "Housekeeper",
    "MediatedForce",
    "Replay",
    "SessionSettings",
    "SimulatedSession",
    "StopFlag",
    "framed_device",
    "framed_robot",
    "inverse",
    "make_operator",
    "mediate",
    "orphaned",
    "replay",
    "run_follower",
    "run_leader",
    "run_processes",
    "run_recorder",
    "simulate",
    "wait_for_hello",
]
