"""Whether MuJoCo draws an image here without a display: one is drawn, in a process of its own, and looked at."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
import time

from foretouch.doctor.finding import Finding, Verdict

__all__ = ["check_graphics", "main"]

WIDTH, HEIGHT = 320, 240

PATIENCE = 60.0
"""A driver that has said nothing for so long [s] will not."""

LEAST_CONTRAST = 30.0
"""Standard deviation of a drawn image over its pixels, of 255; an empty one has 0."""


def check_graphics() -> Finding:
    """Draw an image as a session's camera does. A driver may end its process, so the process is another one."""
    name = "graphics"
    try:
        child = subprocess.run(
            [sys.executable, "-m", "foretouch.doctor.graphics"], capture_output=True, text=True, timeout=PATIENCE
        )
    except subprocess.TimeoutExpired:
        found = f"nothing was drawn within {PATIENCE:g} s"
        return Finding(name, Verdict.WARNING, found, "foretouch simulate --scene plane --fusion contact --duration 2")
    try:
        drawn = json.loads(child.stdout.splitlines()[-1])
    except (ValueError, IndexError):
        last = (child.stderr.strip().splitlines() or ["without a word"])[-1]
        found = f"drawing ended with exit code {child.returncode}: {last}"
        mend = "sudo apt-get install libegl1 libegl-mesa0 libgl1-mesa-dri libopengl0"
        return Finding(name, Verdict.WARNING, found, mend)
    if "problem" in drawn:
        verdict = Verdict.UNKNOWN if drawn["extra"] else Verdict.WARNING
        return Finding(name, verdict, drawn["problem"], drawn["mend"])
    found = f"{drawn['library']} ({drawn['renderer']}): {WIDTH} x {HEIGHT} in {1e3 * drawn['draw_s']:.0f} ms"
    if drawn["contrast"] < LEAST_CONTRAST:
        return Finding(name, Verdict.WARNING, f"{found}, but the image is empty", "glxinfo -B", drawn)
    return Finding(name, Verdict.GOOD, found, figures=drawn)


def main() -> None:
    """Draw, and print as JSON what came of it."""
    from foretouch.errors import MissingExtraError, install_command
    from foretouch.robot.camera_scene import MESA_PACKAGES, MissingGraphicsError

    try:
        told = _draw()
    except MissingGraphicsError as error:
        told = {"problem": str(error), "extra": False, "mend": f"sudo apt-get install {MESA_PACKAGES}"}
    except MissingExtraError as error:
        told = {"problem": str(error), "extra": True, "mend": install_command("sim")}
    sys.stdout.write(json.dumps(told) + "\n")


def _draw() -> dict[str, object]:
    """What draws, how long it took [s] and how much is on the image: a chequered board, seen from above."""
    import numpy as np

    from foretouch.quantities.pose import Pose
    from foretouch.robot.camera_scene import CameraScene, graphics_library

    board = np.kron(np.indices((8, 8)).sum(axis=0) % 2, np.full((8, 8), 255)).astype(np.uint8)
    above = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 0.3]))
    scene = CameraScene(board, 0.1, above, width=WIDTH, height=HEIGHT)
    try:
        times = []
        for _ in range(3):  # the first one compiles what it draws with
            begun = time.perf_counter()
            image = scene.render(Pose(np.eye(3), np.zeros(3)), (0.0, 0.0, 0.1))
            times.append(time.perf_counter() - begun)
        drawing = importlib.import_module("OpenGL.GL")  # comes with MuJoCo
        renderer = drawing.glGetString(drawing.GL_RENDERER).decode(errors="replace")
    finally:
        scene.close()
    return {
        "library": {"egl": "EGL", "osmesa": "OSMesa"}[graphics_library()],
        "renderer": renderer,
        "draw_s": min(times),
        "contrast": float(image.std()),
    }


if __name__ == "__main__":
    main()
