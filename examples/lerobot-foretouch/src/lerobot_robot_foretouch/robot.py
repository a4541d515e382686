"""The follower's side as a robot of LeRobot."""

import threading
from dataclasses import dataclass, field

from lerobot.robots import Robot, RobotConfig

from foretouch.devices import Device
from foretouch.link import ZenohLink
from foretouch.session import LEADER_CHANNELS, Process, SessionSettings, StopFlag, run_leader
from lerobot_robot_foretouch.side import Side

SPEED = 0.05
"""How fast a policy's targets are approached [m/s]; the follower limits speed, acceleration and force after that."""


@RobotConfig.register_subclass("foretouch")
@dataclass(kw_only=True)
class ForetouchRobotConfig(RobotConfig):
    """Who moves the robot, and what stands behind `foretouch follower`."""

    endpoint: str = "tcp/127.0.0.1:7447"
    moved_by: str = "leader"
    """``leader``: who is connected to the endpoint, 1000 times a second. ``policy``: the actions that LeRobot sends."""
    options: list[str] = field(default_factory=list)
    patience: float = 180.0
    """Longest time until the follower begins [s]; the first time it compiles."""


class PolicyHand(Device):
    """A hand that goes to the newest target in a straight line, and stays there."""

    name = "policy"
    closed_loop = False

    def __init__(self, position):
        self.target = self._position = position
        self._now_ns = None

    def read(self, now_ns):
        """Position of the hand [m]."""
        step = 0.0 if self._now_ns is None else SPEED * (now_ns - self._now_ns) * 1e-9
        self._now_ns = now_ns
        self._position += min(max(self.target - self._position, -step), step)
        return self._position

    def render(self, force):
        """No hand feels it."""
        return force


class ForetouchRobot(Robot):
    """A robot that foretouch commands at 1 kHz; LeRobot sees it as often as its own loop goes."""

    config_class = ForetouchRobotConfig
    name = "foretouch"

    def __init__(self, config):
        super().__init__(config)
        if config.moved_by not in ("leader", "policy"):
            raise ValueError(f"moved_by = {config.moved_by!r}: must be leader or policy")
        self.config = config
        self._side = self._hand = None

    observation_features = property(lambda self: {"position_m": float, "force_N": float})
    action_features = property(lambda self: {"position_m": float})
    is_connected = property(lambda self: self._side is not None)
    is_calibrated = property(lambda self: True)

    def calibrate(self):
        """Nothing: foretouch finds the zero of the force by itself."""

    def configure(self):
        """Nothing."""

    def connect(self, calibrate=True):
        """Start the follower, and with a policy the leader's loop in a thread of its own."""
        endpoint = self.config.endpoint
        self._side = Side(["follower", "--listen", endpoint, *self.config.options], endpoint, "telemetry")
        try:
            begun = self._side.wait(self.config.patience)
            if self.config.moved_by == "policy":
                self._begin(PolicyHand(begun.position))
        except BaseException:
            self.disconnect()
            raise

    def _begin(self, hand):
        """Start the leader's loop, and wait until the robot follows it."""
        self._hand, self._stop = hand, StopFlag()
        self._link = ZenohLink(connect=[self.config.endpoint], subscribe=LEADER_CHANNELS)
        process = Process(self._link, self._stop, lambda line: None)
        told = {"description": {"operator": hand.name}, "name": "policy"}
        self._loop = threading.Thread(target=run_leader, args=(process, hand, SessionSettings()), kwargs=told)
        self._loop.start()
        self._side.wait(self.config.patience, lambda newest: newest.command_sequence > 0)

    def get_observation(self):
        """The newest sample."""
        newest = self._side.wait(0.0)
        return {"position_m": newest.position, "force_N": newest.force}

    def send_action(self, action):
        """Say where to go, if a policy moves the robot; return what it was commanded."""
        if self._hand is not None:
            self._hand.target = float(action["position_m"])
        return {"position_m": self._side.wait(0.0).desired_position}

    def disconnect(self):
        """End the session: the robot unloads."""
        if self._hand is not None:
            self._stop.set("disconnected")
            self._loop.join(10.0)
            self._link.close()
            self._hand = None
        if self._side is not None:
            self._side.close()
            self._side = None
