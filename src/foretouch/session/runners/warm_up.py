"""Compilation of everything before a loop begins that has no time for it.

Compiled code is cached (`foretouch.core.compiling`): `compile_all` makes it once per machine, at set-up or before the
first use. `warm_up` loads it into a process, and compiles what is missing.
"""

from __future__ import annotations

import dataclasses
import fcntl
import gc
import math
import os
import selectors
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numba import config
from numba.core import event

from foretouch.core.compiling import compiled_root, complete_mark, mark_complete
from foretouch.errors import ForetouchError
from foretouch.errors.checks import require_type
from foretouch.identification import ESTIMATORS, ContactSample, Learner, identify, make_estimator, predict
from foretouch.models import ContactMapModel, Predictor, make_model, predictor_kernel
from foretouch.quantities import Recording
from foretouch.rendering import whole
from foretouch.robot import RobotSample, RobotSpecification, SpatialSample
from foretouch.session.runners.driven import Tick, drive_follower, drive_leader
from foretouch.session.runners.housekeeping import COMPILING, HELLO_PERIOD, ORPHANED, StopFlag, orphaned
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.setup import setup_of
from foretouch.session.steps import leader as line_leader
from foretouch.session.workspace import LINE, SPACE
from foretouch.settings import is_simulated

TICKS = 700
DEPTH, STIFFNESS, SURFACE, ABOVE = 2e-3, 500.0, 0.01, 1e-3
"""Depth, stiffness, surface and start height of an artificial press for warming up [m, N/m, m, m]."""
START, PRESSED, SLIDE, FRICTION = 2e-3, 4e-3, 0.01, 0.3
"""Start height, depth and length [m] of an artificial slide in space, and its coefficient of friction."""

SPECIFICATION = RobotSpecification(SAMPLE_PERIOD, 15.0, 0.0, 0.0, 0.0, 0.0, 0.02, 0.0, 200.0, (-1.0, 1.0))

KERNELS = {"map": (211, 0.5), "others": (405, 0.5)}
"""Number of functions compiled in each part and its fraction of the time, from which progress is estimated."""

LOOK_PERIOD = 0.2  # Time between two readings of the progress [s]


def warm_up(settings: SessionSettings | None = None) -> None:
    """Load into this process all compiled code that a session runs, or compile it where that was never done.

    Artificial presses are learnt and rendered, and thrown away. Call it before a loop of your own that uses `Learner`,
    `Predictor` or `Renderer`: without it the first touch waits for the compiler. It takes about a second where
    everything was compiled before (`make setup`, or ``foretouch warm-up``), and else some tens of seconds.

    Args:
        settings: Settings of the coming session, of which law and estimator are used. None for the defaults.

    Raises:
        ArgumentTypeError: The settings are not `SessionSettings`.
    """
    settings = SessionSettings() if settings is None else settings
    require_type("settings", settings, SessionSettings, "SessionSettings, or None for the defaults")
    counts_alike: dict[str, Any] = dict.fromkeys(("leader_frame", "follower_frame"))
    own = dataclasses.replace(
        settings, calibration="", sensor_fault=None, operator="scripted", baseline="none", specimen="", **counts_alike
    )
    _press_alone(own)
    for scene in dict.fromkeys(("", settings.scene)):  # what is of a line is of a scene too
        _press_in_a_session(dataclasses.replace(own, scene=scene))
    _move_the_simulated(own)


def _press(tick: int) -> tuple[float, float]:
    """Position [m] and force [N] of a press: down, up a little, down again."""
    depth = -ABOVE + (DEPTH + ABOVE) * 0.5 * (1.0 - math.cos(4.0 * math.pi * tick / TICKS))
    return SURFACE + depth, STIFFNESS * max(depth, 0.0)


def _press_alone(settings: SessionSettings) -> None:
    """Run the code of a loop without a session."""
    learner = Learner(settings.make_estimator(), surface=SURFACE, force_offset=0.0)
    predictor, renderer = Predictor(), line_leader.start(settings).renderer
    renderer.engage(0.0, SURFACE - ABOVE)
    for tick in range(TICKS):
        time, (position, force) = tick * SAMPLE_PERIOD, _press(tick)
        learner.update(time, position, force)
        if tick % 20 == 19:
            learnt = learner.learnt()
            if learnt.model is not None:
                content = learnt.model.map if isinstance(learnt.model, ContactMapModel) else b""
                model = make_model(learnt.model.law, learnt.model.parameters, content)
                renderer.adopt(model, learnt.surface, learnt.state, tick // 2, message=tick)
                predictor.adopt(model, learnt.surface, learnt.state, tick // 2)
        predictor.update(time, position)
        renderer.update(time, (position - SURFACE + ABOVE) / settings.position_scale, SAMPLE_PERIOD)


class _Press:
    """Robot and operator of the press; `pushed` is a force for a hand [N]."""

    specification, name, closed_loop, clutched, pushed = SPECIFICATION, "press", False, False, 1.0

    def __init__(self) -> None:
        self._tick = 0

    def read(self, now_ns: int | None = None) -> Any:
        """The robot's sample, or at a time the hand's position."""
        position, force = _press(self._tick)
        return (
            RobotSample(position, force, 0.0, force, position, position, False, force) if now_ns is None else position
        )

    def exchange(self, desired: Any) -> Any:
        """Go on to the next tick."""
        self._tick += 1
        return self.read()

    @property
    def exact_position(self) -> Any:
        return self.read(0)

    intention = exact_position

    def render(self, force: Any) -> None:
        """Feel nothing."""

    def see(self, pose: Any) -> None:
        """See nothing."""

    def way(self, reach: Any, position: Any, tick: int) -> Any:
        """Where a simulated robot goes while its operator is at a position [m]: into the material at once."""
        return reach.surface + DEPTH * tick / TICKS


class _Slide(_Press):
    """The same in space: down, then along."""

    pushed: Any = (0.0, 0.0, 1.0)

    def way(self, reach: Any, position: Any, tick: int) -> Any:
        """See `_Press.way`; after the operator."""
        return position

    def read(self, now_ns: int | None = None) -> Any:
        done = self._tick / (0.5 * TICKS)
        position = (SLIDE * max(done - 1.0, 0.0), 0.0, START - (START + PRESSED) * min(done, 1.0))
        if now_ns is not None:
            return position
        pressed = max(-position[2], 0.0) * STIFFNESS
        force = (-FRICTION * pressed if position[0] > 0.0 else 0.0, 0.0, pressed)
        return SpatialSample(position, force, force, position, (), False)


MOTIONS: dict[Any, Any] = {LINE: _Press, SPACE: _Slide}


def _press_in_a_session(settings: SessionSettings) -> None:
    """Run both sides of a session: the same press by both, with no network between."""
    press = MOTIONS[settings.workspace]()
    follows, leads = drive_follower(press, settings, 1), drive_leader(press, settings, "warm-up", 1)
    commands: list[Any] = []
    for number in range(TICKS):
        tick = Tick(number * 1_000_000, 1_000_000)
        commands = leads.act(follows.act(commands, tick), tick)[:1]
        follows.exchange()


def _move_the_simulated(settings: SessionSettings) -> None:
    """Run a simulated robot and a simulated hand, as far as they can be simulated here."""
    with suppress(ForetouchError):  # MuJoCo is not installed: then no session uses it
        if not is_simulated(settings.robot):
            return
        setup, motion = setup_of(settings), MOTIONS[settings.workspace]()
        robot, reach = setup.robot()
        hand = setup.operator(reach, lambda _: None)
        for tick in range(TICKS):
            position = hand.read(tick * 1_000_000)
            hand.render(motion.pushed)
            robot.exchange(motion.way(reach, position, tick))


def _learn_offline(law: str) -> None:
    """Run what `identify` and `predict` call, with every estimator of a law, on a recording of the press."""
    positions, forces = zip(*map(_press, range(TICKS)), strict=True)
    press = Recording(np.linspace(0.0, TICKS * SAMPLE_PERIOD, TICKS), np.array(positions), np.array(forces))
    for estimator in ESTIMATORS[law]:
        for use in (identify, lambda recording, learner: predict(recording, learner, delay=0.02)):
            with suppress(ForetouchError):  # an estimator not of one force along a line
                use(press, Learner(make_estimator(law, estimator)))


def _compile_map() -> None:
    """Compile the contact map, which takes longest; then the other process has compiled what is common, found here."""
    bank = SessionSettings().make_estimator()
    for tick in range(TICKS):
        position, force = _press(tick)
        bank.update(ContactSample(tick * SAMPLE_PERIOD, position - SURFACE, 0.0, force, force > 0.0))
    _press_alone(SessionSettings())
    _learn_offline("contact-map")
    warm_up(SessionSettings(grip="normal", scene="plane"))  # and along a line
    warm_up(SessionSettings(scene="phantom"))


def _compile_others() -> None:
    """Compile everything that needs no contact map: at first what the other process needs later."""
    for common in (whole.whole, whole.whole_over_surface, predictor_kernel.adopt):
        common.entry  # noqa: B018  # asked for, it is compiled
    settings = SessionSettings(model="hunt-crossley", estimator="exact", grip="normal")
    warm_up(settings)
    for scene in ("plane", "hill", "phantom"):
        warm_up(dataclasses.replace(settings, scene=scene, material="hunt-crossley"))
    for law in ESTIMATORS:
        if law != "contact-map":
            _learn_offline(law)


PARTS: dict[str, Callable[[], None]] = {"map": _compile_map, "others": _compile_others}


def is_compiled() -> bool:
    """Whether everything is compiled here, from these sources; also true where nothing is compiled or cached."""
    mark = None if config.DISABLE_JIT else complete_mark()
    return mark is None or mark.is_dir()


def compiled_share() -> float | None:
    """Progress of the process that compiles, 0 to 1; None while none does."""
    root = compiled_root()
    try:
        return None if root is None else float(Path(root, "share").read_text())
    except (OSError, ValueError):
        return None


def compile_all(progress: Callable[[float], None] = lambda fraction: None, *, stop: Callable[[], bool] = bool) -> bool:
    """Compile everything, once on a machine, in two processes; a second caller waits for the first.

    Args:
        progress: Called with the progress, 0 to 1, some times a second.
        stop: Called as often; returns whether to give up.

    Returns:
        Whether everything was compiled. What could not be is compiled where it is first needed.
    """
    root = compiled_root()
    if root is None or is_compiled():
        return is_compiled()
    with Path(root, "lock").open("w") as lock:
        waited = 0.0
        while not _taken(lock.fileno()):
            waited = max(waited, compiled_share() or 0.0)  # the file goes when the other process has finished
            progress(waited)
            if stop():
                return False
            time.sleep(LOOK_PERIOD)
        if is_compiled():
            progress(1.0)
            return True
        fraction, next_share = Path(root, "share"), Path(root, "share.next")
        try:
            for done in _compile_in_processes(stop):
                next_share.write_text(f"{done:.3f}")
                next_share.replace(fraction)  # atomic: a reader finds the old file or the new one
                progress(done)
        except (OSError, subprocess.SubprocessError):
            return False
        finally:
            fraction.unlink(missing_ok=True)
        if stop():
            return False
        mark_complete()
    progress(1.0)
    return True


def _taken(lock: int) -> bool:
    """Whether this process holds a lock now, until it ends."""
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _compile_in_processes(stop: Callable[[], bool]) -> Iterator[float]:
    """Compile the parts side by side; yields the progress, 0 to 1, and raises where a part failed."""
    command = [sys.executable, "-m", "foretouch.session.runners.warm_up"]
    parts = [
        subprocess.Popen([*command, name], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        for name in PARTS
    ]
    done = dict.fromkeys(PARTS, 0)
    try:
        with selectors.DefaultSelector() as open_ones:
            for name, part in zip(PARTS, parts, strict=True):
                assert part.stdout is not None
                open_ones.register(part.stdout, selectors.EVENT_READ, name)
            while open_ones.get_map() and not stop():
                for key, _ in open_ones.select(LOOK_PERIOD):
                    output = os.read(key.fd, 4096)
                    done[key.data] += len(output)
                    if not output:
                        open_ones.unregister(key.fileobj)
                yield sum(fraction * min(done[name] / most, 0.99) for name, (most, fraction) in KERNELS.items())
        if not stop() and any(part.wait() for part in parts):
            raise subprocess.SubprocessError
    finally:
        for part in parts:
            part.kill()
            part.communicate()


_LOADED: set[tuple[str, ...]] = set()


def warm_up_once(settings: SessionSettings) -> None:
    """`warm_up` for the first session in this process that runs the same code."""
    runs = (settings.model, settings.estimator, settings.grip, settings.scene, settings.robot)
    if runs not in _LOADED:
        warm_up(settings)
        _LOADED.add(runs)


def prepare(settings: SessionSettings, stop: StopFlag, say: Callable[[str], None], parent: int | None) -> str:
    """Compile what was never compiled, load what was, and report progress meanwhile.

    Args:
        settings: Settings of the session that is to begin.
        stop: Checked meanwhile, and set where the parent process has gone.
        say: Prints the progress, where there is no parent that prints it.
        parent: Process that receives `COMPILING`, and whose end ends this one.

    Returns:
        Why the session is not to begin any more; "" where it is.
    """
    reported, done = 0.0, threading.Event()

    def progress(fraction: float) -> None:
        nonlocal reported
        if parent is None and reported <= fraction < 1.0:
            say(f"compiling, {fraction:.0%}: the first start on this machine takes about a minute")
            reported = fraction + 0.2

    def beat() -> None:
        while parent is not None and not done.wait(HELLO_PERIOD):
            with suppress(OSError):  # the parent has gone
                os.write(1, COMPILING)

    def stopped() -> bool:
        if orphaned(parent):
            stop.set(ORPHANED)
        return bool(stop.reason)

    beating = threading.Thread(target=beat, name="compiling", daemon=True)
    beating.start()
    try:
        compile_all(progress, stop=stopped)
        if not stop.reason:
            warm_up_once(settings)
    finally:
        done.set()
        beating.join()
    return stop.reason


class _Counted(event.Listener):  # type: ignore[misc]  # Numba is not typed
    """Writes a byte for each function that has been compiled."""

    def on_start(self, event: object) -> None:
        """Do nothing."""

    def on_end(self, event: object) -> None:
        os.write(1, b".")


def main(part: str) -> None:
    """Compile one of `PARTS`; end when the reader of the progress has ended."""
    for number in (signal.SIGINT, signal.SIGPIPE):
        signal.signal(number, signal.SIG_DFL)
    event.register("numba:compile", _Counted())
    gc.disable()  # it would look through the compiler's millions of small objects again and again
    PARTS[part]()


if __name__ == "__main__":
    main(sys.argv[1])
