"""Processors and drawing: how many cores, how busy and how fast, whom the kernel runs first, and whether MuJoCo draws.

An image is drawn without a display, in a process of its own, and looked at.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path

from foretouch.doctor.finding import Finding, Verdict
from foretouch.files.children import last_line

FEWEST_CORES = 2  # A session has two loops at 1 kHz, and each wants a processor when its tick is due
BUSIEST = 0.7  # Load for each core from which on loops have to wait for their turn

CPUS, CGROUP = Path("/sys/devices/system/cpu"), Path("/sys/fs/cgroup")

GOVERN = "echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor"

PRIORITY = "echo '* - rtprio 20' | sudo tee /etc/security/limits.d/foretouch.conf"


def check_cores(load: float | None = None, cores: int | None = None, group: Path = CGROUP) -> Finding:
    """Cores that this process may use, and how much is waiting for them; the system's answers where none are given.

    The load is the mean number of processes that want to run, of the last minute; ``cpu.max`` in the folder of the
    control group bounds a container.
    """
    if cores is None:
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    load = os.getloadavg()[0] if load is None else load
    quota = None  # processors that the control group allows at most
    with contextlib.suppress(OSError, ValueError):  # no such file; or "max", which is no bound
        fraction, period = (group / "cpu.max").read_text().split()
        quota = int(fraction) / int(period)
    usable = min(float(cores), quota or float(cores))
    bounded = "" if quota is None else f", of which the container may use {quota:g}"
    text = f"{cores} cores{bounded}; load {load:.1f} in the last minute"
    figures = {"cores": cores, "quota": quota, "load": load}
    busiest = "ps -eo pid,pcpu,args --sort=-pcpu | head"
    if usable < FEWEST_CORES:
        text += f"; fewer than {FEWEST_CORES}: leader and follower take turns"
        mend = "" if quota is None else "docker update --cpus 2 CONTAINER"
        return Finding("cores", Verdict.WARNING, text, mend, figures)
    if load > BUSIEST * usable:
        return Finding("cores", Verdict.WARNING, f"{text}: others want them too", busiest, figures)
    return Finding("cores", Verdict.GOOD, text, figures=figures)


def check_governor(cpus: Path = CPUS) -> Finding:
    """Check the frequency governors of the processors, in the folder that the kernel has of them."""
    name = "CPU governor"
    governors: set[str] = set()
    for path in cpus.glob("cpu[0-9]*/cpufreq/scaling_governor"):
        with contextlib.suppress(OSError):
            governors.add(path.read_text().strip())
    if not governors:
        why = "the kernel shows no governor here, as in most virtual machines and containers"
        return Finding(name, Verdict.UNKNOWN, why)
    figures = {"governors": sorted(governors)}
    text = ", ".join(sorted(governors))
    if governors == {"performance"}:
        return Finding(name, Verdict.GOOD, text, figures=figures)
    text += ": a loop that mostly sleeps is run at low speed, and woken late"
    return Finding(name, Verdict.WARNING, text, GOVERN, figures)


def check_real_time(slice_s: float | None, limits: Iterable[int] | None = None) -> Finding:
    """Whether a loop that asks for short slices is run at once, and what this user may ask for beyond that.

    The slice is what the kernel gave to a loop that asked for 0.1 ms [s]: 0 where it does not say, as before Linux
    6.12; None where no loop was run. The limits are RLIMIT_RTPRIO and RLIMIT_NICE, by default this process's.
    """
    name = "real time"
    if limits is None:
        if not hasattr(resource, "RLIMIT_RTPRIO"):
            return Finding(name, Verdict.UNKNOWN, "this system has no limits of real-time priority: it is not Linux")
        limits = (resource.getrlimit(which)[0] for which in (resource.RLIMIT_RTPRIO, resource.RLIMIT_NICE))
    priority, nice = limits
    figures = {"slice_s": slice_s, "rtprio": priority, "nice": nice}
    least_nice = 20 - nice if 0 <= nice <= 40 else -20 if nice < 0 else 0  # -1 is "no bound"
    allowed = f"real-time priority {'any' if priority < 0 else priority}, nice down to {min(least_nice, 19)}"
    if slice_s is None:
        return Finding(name, Verdict.UNKNOWN, f"no loop was run; allowed: {allowed}", figures=figures)
    if 0.0 < slice_s < 1e-3:
        text = f"the kernel grants short slices ({1e3 * slice_s:g} ms); allowed: {allowed}, neither is needed"
        return Finding(name, Verdict.GOOD, text, figures=figures)
    text = f"the kernel ({os.uname().release}) knows no short slices, which Linux has since 6.12; allowed: {allowed}"
    mend = PRIORITY if priority == 0 else "chrt --fifo 10 foretouch teleop"
    return Finding(name, Verdict.WARNING, text, mend, figures)


WIDTH, HEIGHT = 320, 240

PATIENCE = 60.0  # Time after which a silent driver counts as failed [s]
LEAST_CONTRAST = 30.0  # Standard deviation of a drawn image over its pixels, of 255; an empty one has 0


def check_graphics() -> Finding:
    """Draw an image as a session's camera does. A driver may end its process, so the process is another one."""
    name = "graphics"
    command = [sys.executable, "-m", "foretouch.doctor.hardware"]
    try:
        child = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        text = f"nothing was drawn within {PATIENCE:g} s"
        return Finding(name, Verdict.WARNING, text, "foretouch simulate --scene plane --fusion contact --duration 2")
    try:
        drawn = json.loads(child.stdout.splitlines()[-1])
    except (ValueError, IndexError):
        why = last_line(child.stderr, "without a word")
        text = f"drawing ended with exit code {child.returncode}: {why}"
        mend = "sudo apt-get install libegl1 libegl-mesa0 libgl1-mesa-dri libopengl0"
        return Finding(name, Verdict.WARNING, text, mend)
    if "problem" in drawn:
        verdict = Verdict.UNKNOWN if drawn["extra"] else Verdict.WARNING
        return Finding(name, verdict, drawn["problem"], drawn["mend"])
    text = f"{drawn['library']} ({drawn['renderer']}): {WIDTH} x {HEIGHT} in {1e3 * drawn['draw_s']:.0f} ms"
    if drawn["contrast"] < LEAST_CONTRAST:
        return Finding(name, Verdict.WARNING, f"{text}, but the image is empty", "glxinfo -B", drawn)
    return Finding(name, Verdict.GOOD, text, figures=drawn)


def main() -> None:
    """Draw, and print as JSON what came of it."""
    from foretouch.errors import MissingExtraError, install_command
    from foretouch.robot.camera_scene import MESA_PACKAGES, MissingGraphicsError

    try:
        report = _draw()
    except MissingGraphicsError as error:
        report = {"problem": str(error), "extra": False, "mend": f"sudo apt-get install {MESA_PACKAGES}"}
    except MissingExtraError as error:
        report = {"problem": str(error), "extra": True, "mend": install_command("sim")}
    sys.stdout.write(json.dumps(report) + "\n")


def _draw() -> dict[str, object]:
    """What draws, how long it took [s] and how much is on the image: a chequered board, seen from above."""
    import numpy as np

    from foretouch.quantities.pose import Pose
    from foretouch.robot.camera_scene import CameraScene, graphics_library

    board = np.kron(np.indices((8, 8)).sum(axis=0) % 2, np.full((8, 8), 255)).astype(np.uint8)
    above = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 0.3]))
    scene = CameraScene(board, 0.1, above, size=(WIDTH, HEIGHT))
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
