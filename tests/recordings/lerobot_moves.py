"""Run by the Python of an environment that has LeRobot and the example: its own loop of teleoperation, and actions."""

import json
import sys
import time

from lerobot.processor import make_default_processors
from lerobot.robots import RobotConfig, make_robot_from_config
from lerobot.scripts.lerobot_teleoperate import teleop_loop
from lerobot.teleoperators import TeleoperatorConfig, make_teleoperator_from_config
from lerobot.utils.import_utils import register_third_party_plugins

FPS = 30


def choose(config, **options):
    return config.get_choice_class("foretouch")(**options)


class Watched:
    """The robot as it is, with what LeRobot was told by it."""

    def __init__(self, robot):
        self._robot, self.seen, self.commanded = robot, [], []

    def __getattr__(self, name):
        return getattr(self._robot, name)

    def get_observation(self):
        self.seen.append(self._robot.get_observation())
        return self.seen[-1]

    def send_action(self, action):
        self.commanded.append((action["position_m"], self._robot.send_action(action)["position_m"]))
        return {"position_m": self.commanded[-1][1]}


def teleoperate(endpoint, seconds):
    """A scripted operator presses; LeRobot's loop looks on."""
    robot = Watched(make_robot_from_config(choose(RobotConfig, id="test", endpoint=endpoint)))
    hand = make_teleoperator_from_config(choose(TeleoperatorConfig, id="test", endpoint=endpoint))
    hand.connect()
    robot.connect()
    try:
        teleop_loop(hand, robot, FPS, *make_default_processors(), duration=seconds)
    finally:
        hand.disconnect()
        robot.disconnect()
    return {
        "force": [one["force_N"] for one in robot.seen],
        "position": [one["position_m"] for one in robot.seen],
        "commanded": robot.commanded,
    }


def by_policy(endpoint, target, seconds):
    """Actions alone move the robot."""
    with make_robot_from_config(choose(RobotConfig, id="test", endpoint=endpoint, moved_by="policy")) as robot:
        seen = []
        for _ in range(int(seconds * FPS)):
            robot.send_action({"position_m": target})
            seen.append(robot.get_observation()["position_m"])
            time.sleep(1 / FPS)
    return seen


if __name__ == "__main__":
    register_third_party_plugins()
    first, second, target = sys.argv[1:]
    told = teleoperate(first, 8.0) | {"policy": by_policy(second, float(target), 4.0)}
    sys.stdout.write("\n" + json.dumps(told) + "\n")
