"""The leader's side as a teleoperator of LeRobot."""

from dataclasses import dataclass, field

from lerobot.teleoperators import Teleoperator, TeleoperatorConfig

from foretouch.link import free_endpoint
from lerobot_robot_foretouch.side import Side


@TeleoperatorConfig.register_subclass("foretouch")
@dataclass(kw_only=True)
class ForetouchTeleoperatorConfig(TeleoperatorConfig):
    """The follower to connect to, and what stands behind `foretouch leader`, such as ``--operator force-dimension``."""

    endpoint: str = "tcp/127.0.0.1:7447"
    options: list[str] = field(default_factory=list)
    patience: float = 180.0
    """Longest time until the first command [s]; the first time it compiles."""


class ForetouchTeleoperator(Teleoperator):
    """A hand that foretouch gives forces at 1 kHz, from a model of what the robot touches.

    LeRobot's loop of teleoperation never calls `send_feedback`: so the force is rendered where the hand is read.
    """

    config_class = ForetouchTeleoperatorConfig
    name = "foretouch"

    def __init__(self, config):
        super().__init__(config)
        self.config = config
        self._side = None

    action_features = property(lambda self: {"position_m": float})
    feedback_features = property(lambda self: {})
    is_connected = property(lambda self: self._side is not None)
    is_calibrated = property(lambda self: True)

    def calibrate(self):
        """Nothing."""

    def configure(self):
        """Nothing."""

    def connect(self, calibrate=True):
        """Start the leader; it waits for the follower."""
        own = free_endpoint()
        words = ["leader", "--connect", self.config.endpoint, "--listen", own, *self.config.options]
        self._side = Side(words, own, "command")

    def get_action(self):
        """The newest command; the robot has had it already."""
        return {"position_m": self._side.wait(self.config.patience).position}

    def send_feedback(self, feedback):
        """Nothing: the leader renders the force by itself."""

    def disconnect(self):
        """End the leader, and with it the session."""
        if self._side is not None:
            self._side.close()
            self._side = None
