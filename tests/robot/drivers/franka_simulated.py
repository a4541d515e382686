"""An arm of Franka as its library's author simulates it (``franky-sim``), with a floor, a reflex and what else fails.

Everything beyond the arm's motion is ours: the spring below `FLOOR` is a force on its hand in the simulation, and what
the arm feels of it, in the library's sign; a reflex ends its motion as the arm's protocol has it.
"""

from __future__ import annotations

import dataclasses
import time
from typing import Any

import numpy as np

DOWN, STIFFNESS = 0.01, 1000.0  # Where the floor is below the tip as it begins [m], and how stiff [N/m]
REFLEXES = (7,)  # cartesian_reflex, of the arm's 41 errors


class Simulated:
    """A simulated arm, running from `with` on.

    Attributes:
        host: Its address.
        force: Shown instead of the floor's [N].
        place: Shown instead of the tip's [m].
        late: Time that each state takes longer [s].
    """

    def __init__(self) -> None:
        from franky_sim import SimulationServer
        from franky_sim.franka_robot_server import FrankaRobotServer
        from franky_sim.mujoco_simulator import MujocoSimulator

        self.force: float | None = None
        self.place: float | None = None
        self.late, self.height, self.floor = 0.0, np.inf, -np.inf
        self._reflex = False
        told = FrankaRobotServer.robot_state.fget
        FrankaRobotServer.robot_state = property(lambda server: self._shown(told(server)))  # type: ignore[misc]
        self._simulator = MujocoSimulator()
        self._robot = self._simulator.add_robot()
        self._server = SimulationServer(self._simulator)

    def __enter__(self) -> Simulated:
        self._simulator.__enter__()
        self._server.__enter__()
        self._server.run_async()
        self.host = self._robot.hostname
        time.sleep(0.2)
        self.floor = self._robot.state.O_T_EE[14] - DOWN
        self._simulator.register_pre_step_callback(lambda _: self._push())
        return self

    def __exit__(self, *given: Any) -> None:
        self._server.__exit__(*given)
        self._simulator.__exit__(*given)

    def pushes(self) -> float:
        """Force of the floor on the tip [N]."""
        return STIFFNESS * max(self.floor - self.height, 0.0)

    def reflex(self) -> None:
        """Stop with a reflex, which ends the motion."""
        from franky_sim.franka_robot_protocol import BaseCommand, MoveStatus, RobotCommand

        server, motion = self._robot.server, self._robot.server.current_motion_id
        server.stop_motion(send_preemption_signal=False)
        self._reflex = True
        if motion:
            BaseCommand.send_response(server._tcp_socket, RobotCommand.kMove, motion, MoveStatus.kReflexAborted)
            server.reset_current_motion_id()

    def recover(self) -> None:
        """What a person does after a reflex."""
        self._reflex = False

    def moves(self) -> bool:
        """Whether a motion runs."""
        return bool(self._robot.server.current_motion_id)

    def _push(self) -> None:
        body = self._simulator.model.body("robot0_hand").id
        self._simulator.data.xfrc_applied[body] = [0.0, 0.0, self.pushes(), 0.0, 0.0, 0.0]

    def _shown(self, state: Any) -> Any:
        from franky_sim.franka_robot_protocol import RobotMode

        if self.late:
            time.sleep(self.late)
        pose = list(state.O_T_EE)
        self.height = pose[14]
        pose[14] = pose[14] if self.place is None else self.place
        felt = self.pushes() if self.force is None else self.force
        changed: dict[str, Any] = {"O_T_EE": tuple(pose), "O_F_ext_hat_K": (0.0, 0.0, -felt, 0.0, 0.0, 0.0)}
        if self._reflex:
            changed["errors"] = tuple(number in REFLEXES for number in range(41))
            changed["robot_mode"] = RobotMode.kReflex
        return dataclasses.replace(state, **changed)
