"""Sessions: the steps of leader and follower, the two runners, the processes and their settings.

This is the only room with time, threads, processes and policy.
"""

from foretouch.session.mediated import MediatedForce, mediate
from foretouch.session.operators import (
    close_operator,
    felt_texts,
    make_operator,
    require_simulated_operator,
    require_simulated_time,
)
from foretouch.session.processes.gate import Gate, gate_channels
from foretouch.session.processes.processes import run_processes
from foretouch.session.processes.recorder import RECORDER_CHANNELS, RECORDING_INCOMPLETE, Recorder, run_recorder
from foretouch.session.replay.machines import recorded_settings
from foretouch.session.replay.replay import Replay, replay
from foretouch.session.replay.under import CLOSED_LOOP, FIXED_MOTION, material_answers, replay_notes, replay_under
from foretouch.session.runners.channels import (
    FOLLOWER_CHANNELS,
    LEADER_CHANNELS,
    hear_packets,
    join_thin,
    side_channels,
)
from foretouch.session.runners.housekeeping import Housekeeper, Process, StopFlag, orphaned
from foretouch.session.runners.live import run_follower, run_leader, wait_for_hello
from foretouch.session.runners.loop_timer import be_prompt, give_way
from foretouch.session.runners.shadow import SHADOW_CHANNELS, run_shadow
from foretouch.session.runners.simulated import SimulatedSession, simulate
from foretouch.session.runners.warm_up import prepare, warm_up
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.setup import make_moved_robot, make_session_robot, reach_texts, setup_of
from foretouch.session.steps.sensing import session_calibration
from foretouch.session.thin import end_of
from foretouch.session.workspace import FramedDevice, FramedRobot, framed_device, framed_robot, inverse

__all__ = [
    "CLOSED_LOOP",
    "FIXED_MOTION",
    "FOLLOWER_CHANNELS",
    "LEADER_CHANNELS",
    "RECORDER_CHANNELS",
    "RECORDING_INCOMPLETE",
    "SAMPLE_PERIOD",
    "SHADOW_CHANNELS",
    "FramedDevice",
    "FramedRobot",
    "Gate",
    "Housekeeper",
    "MediatedForce",
    "Process",
    "Recorder",
    "Replay",
    "SessionSettings",
    "SimulatedSession",
    "StopFlag",
    "be_prompt",
    "close_operator",
    "end_of",
    "felt_texts",
    "framed_device",
    "framed_robot",
    "gate_channels",
    "give_way",
    "hear_packets",
    "inverse",
    "join_thin",
    "make_moved_robot",
    "make_operator",
    "make_session_robot",
    "material_answers",
    "mediate",
    "orphaned",
    "prepare",
    "reach_texts",
    "recorded_settings",
    "replay",
    "replay_notes",
    "replay_under",
    "require_simulated_operator",
    "require_simulated_time",
    "run_follower",
    "run_leader",
    "run_processes",
    "run_recorder",
    "run_shadow",
    "session_calibration",
    "setup_of",
    "side_channels",
    "simulate",
    "wait_for_hello",
    "warm_up",
]
