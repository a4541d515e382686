"""Everything compiled, before a loop begins that has no time for it.

Compiled code is kept (`foretouch.core.compiling`), so that it is made once on a machine, by `compile_all`: at set-up,
or before the first use. `warm_up` loads it into a process, and makes what is not there.
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

import numpy as np
from numba import config
from numba.core import event

from foretouch.core.compiling import compiled_root, complete_mark, mark_complete
from foretouch.errors import ForetouchError
from foretouch.errors.checks import require_type
from foretouch.identification import ESTIMATORS, ContactSample, Learner, identify, make_estimator, predict
from foretouch.messages import VERSION, Command, ModelUpdate, Telemetry
from foretouch.models import ContactMap, Predictor, make_model
from foretouch.quantities import Recording
from foretouch.robot import RobotSample, RobotSpecification
from foretouch.session.operators import make_operator
from foretouch.session.processes.housekeeping import COMPILING, HELLO_PERIOD, ORPHANED, StopFlag, orphaned
from foretouch.session.settings import SAMPLE_PERIOD, SIMULATED, SessionSettings
from foretouch.session.steps import follower, leader

TICKS = 700
DEPTH, STIFFNESS, SURFACE, ABOVE = 2e-3, 500.0, 0.01, 1e-3
"""Of a press [m, N/m, m, m] that exists nowhere else."""

SPECIFICATION = RobotSpecification(SAMPLE_PERIOD, 15.0, 0.0, 0.0, 0.0, 0.0, 0.02, 0.0, 200.0, (-1.0, 1.0))

KERNELS = {"map": (112, 0.6), "others": (228, 0.4)}
"""How many functions are compiled for each part, and its share of the time: they say how far it is."""

LOOK_PERIOD = 0.2
"""Between two looks at how far it is [s]."""


def warm_up(settings: SessionSettings | None = None) -> None:
    """Load into this process all compiled code that a session runs, or compile it where that was never done.

    Presses that exist nowhere are learnt and rendered, and thrown away. Call it before a loop of your own that uses
    `Learner`, `Predictor` or `Renderer`: without it the first touch waits for the compiler. It takes about a second
    where everything was compiled before (`make setup`, or ``foretouch warm-up``), and else some tens of seconds.

    Args:
        settings: Of the session that is to begin; law and estimator are taken from them. None for the defaults.

    Raises:
        ArgumentTypeError: Settings that are none.
    """
    settings = SessionSettings() if settings is None else settings
    require_type("settings", settings, SessionSettings, "SessionSettings, or None for the defaults")
    if settings.scene:
        from foretouch.session.runners.warm_up_scene import warm_up_scene

        warm_up_scene(settings)
    _press_alone(settings)
    _press_in_a_session(settings)
    _move_the_simulated(settings)


def _press(tick: int) -> tuple[float, float]:
    """Position [m] and force [N] of a press: down, up a little, down again."""
    depth = -ABOVE + (DEPTH + ABOVE) * 0.5 * (1.0 - math.cos(4.0 * math.pi * tick / TICKS))
    return SURFACE + depth, STIFFNESS * max(depth, 0.0)


def _press_alone(settings: SessionSettings) -> None:
    """What a loop of one's own calls."""
    learner = Learner(settings.make_estimator(), surface=SURFACE, force_offset=0.0)
    predictor, renderer = Predictor(), leader.start(settings).renderer
    renderer.engage(0.0, SURFACE - ABOVE)
    for tick in range(TICKS):
        time, (position, force) = tick * SAMPLE_PERIOD, _press(tick)
        learner.update(time, position, force)
        if tick % 20 == 19:
            learnt = learner.learnt()
            if learnt.model is not None:
                content = learnt.model.map if isinstance(learnt.model, ContactMap) else b""
                model = make_model(learnt.model.law, learnt.model.parameters, content)
                renderer.adopt(model, learnt.surface, learnt.state, tick // 2, message=tick)
                predictor.adopt(model, learnt.surface, learnt.state, tick // 2)
        predictor.update(time, position)
        renderer.update(time, (position - SURFACE + ABOVE) / settings.position_scale, SAMPLE_PERIOD)


def _press_in_a_session(settings: SessionSettings) -> None:
    """What the two steps of a session along a line call: the same press by both, with no way between."""
    settings = dataclasses.replace(settings, calibration="", sensor_fault="", scene="")
    follows, leads = follower.start(SPECIFICATION, settings), leader.start(settings)
    models: list[ModelUpdate] = []
    telemetry: list[Telemetry] = []
    for tick in range(TICKS):
        now_ns = round(tick * SAMPLE_PERIOD * 1e9)
        position, force = _press(tick)
        leads, led = leader.step(leads, leader.Inputs(position, models, telemetry, 1_000_000, 0), now_ns)
        command = Command(VERSION, tick + 1, now_ns, led.command.position, 0, holder="warm-up", epoch=1)
        sample = RobotSample(position, force, 0.0, force, position, position, False, force)
        follows, acted = follower.step(follows, follower.Inputs([command], sample, 1_000_000, 0), now_ns)
        models, telemetry = [] if acted.model is None else [acted.model], [acted.telemetry]


def _move_the_simulated(settings: SessionSettings) -> None:
    """What a simulated robot and a simulated hand call, as far as they can be simulated here."""
    by_script = dataclasses.replace(settings, operator="scripted")
    with suppress(ForetouchError):  # MuJoCo is not installed: then none will move
        if settings.scene:
            from foretouch.session.spatial import make_scene, make_spatial_operator, make_spatial_robot

            scene = make_scene(settings.scene)
            world = make_spatial_robot(settings, scene)
            hand = make_spatial_operator(by_script, scene, scene.nominal)
            for tick in range(TICKS):
                world.exchange(hand.read(tick * 1_000_000))
                hand.render((0.0, 0.0, 1.0))
        elif settings.robot == SIMULATED:
            from foretouch.robot import make_robot

            arm = make_robot(settings.material, seed=settings.seed)
            reach = arm.material
            operator = make_operator(by_script, surface=arm.surface, press_depth=reach.press_depth, say=lambda _: None)
            for tick in range(TICKS):
                operator.read(tick * 1_000_000)
                operator.render(1.0)
                arm.exchange(arm.surface + DEPTH * tick / TICKS)


def _recording() -> Recording:
    """The press, recorded."""
    places, forces = zip(*map(_press, range(TICKS)), strict=True)
    return Recording(np.linspace(0.0, TICKS * SAMPLE_PERIOD, TICKS), np.array(places), np.array(forces))


def _learn_offline(law: str) -> None:
    """What `identify` and `predict` call, with every estimator of a law."""
    for estimator in ESTIMATORS[law]:
        for use in (identify, lambda recording, learner: predict(recording, learner, delay=0.02)):
            with suppress(ForetouchError):  # not of one force along a line
                use(_recording(), Learner(make_estimator(law, estimator)))


def _compile_map() -> None:
    """The contact map, which takes longest."""
    # First what nobody else needs: meanwhile the other process compiles what both do, and this one finds it.
    bank = SessionSettings().make_estimator()
    for tick in range(TICKS):
        position, force = _press(tick)
        bank.update(ContactSample(tick * SAMPLE_PERIOD, position - SURFACE, 0.0, force, force > 0.0))
    _press_alone(SessionSettings())
    _learn_offline("contact-map")
    for settings in (SessionSettings(grip="normal"), SessionSettings(scene="phantom", material="hunt-crossley")):
        warm_up(settings)


def _compile_others() -> None:
    """All that needs no contact map."""
    settings = SessionSettings(model="hunt-crossley", estimator="exact", grip="normal")
    warm_up(settings)
    for scene in ("plane", "hill", "phantom"):
        warm_up(dataclasses.replace(settings, scene=scene, material="hunt-crossley"))
    for law in ESTIMATORS:
        if law != "contact-map":
            _learn_offline(law)


PARTS: dict[str, Callable[[], None]] = {"map": _compile_map, "others": _compile_others}


def is_compiled() -> bool:
    """Whether everything was compiled here, of these sources; also where nothing is ever compiled or kept."""
    mark = None if config.DISABLE_JIT else complete_mark()
    return mark is None or mark.is_dir()


def compiled_share() -> float | None:
    """How much the process that compiles has done, 0 to 1; None while none does."""
    root = compiled_root()
    try:
        return None if root is None else float(Path(root, "share").read_text())
    except (OSError, ValueError):
        return None


def compile_all(progress: Callable[[float], None] = lambda share: None, *, stop: Callable[[], bool] = bool) -> bool:
    """Compile everything, once on a machine, in two processes; whoever comes second waits for the first.

    Args:
        progress: Told how much is done, 0 to 1, some times a second.
        stop: Asked as often whether to give up.

    Returns:
        Whether all was compiled. What could not be is compiled where it is first needed.
    """
    root = compiled_root()
    if root is None or is_compiled():
        return is_compiled()
    with Path(root, "lock").open("w") as lock:
        while not _taken(lock.fileno()):
            progress(compiled_share() or 0.0)
            if stop():
                return False
            time.sleep(LOOK_PERIOD)
        if is_compiled():
            return True
        share = Path(root, "share")
        try:
            for done in _compile_in_processes(stop):
                share.write_text(f"{done:.3f}")
                progress(done)
        except (OSError, subprocess.SubprocessError):
            return False
        finally:
            share.unlink(missing_ok=True)
        if stop():
            return False
        mark_complete()
    progress(1.0)
    return True


def _taken(lock: int) -> bool:
    """Whether this process holds a lock now; it ends with the process."""
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _compile_in_processes(stop: Callable[[], bool]) -> Iterator[float]:
    """Compile the parts side by side; gives the share that is done, now and then.

    Raises:
        subprocess.SubprocessError: One of them failed.
    """
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
                    said = os.read(key.fd, 4096)
                    done[key.data] += len(said)
                    if not said:
                        open_ones.unregister(key.fileobj)
                yield sum(share * min(done[name] / most, 0.99) for name, (most, share) in KERNELS.items())
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
    """Compile what was never compiled, load what was, and say meanwhile that it goes on.

    Args:
        settings: Of the session that is to begin.
        stop: Looked at meanwhile, and set where the parent process has gone.
        say: Told how far it is, where there is no parent who says so.
        parent: Process that hears `COMPILING`, and whose end ends this one.

    Returns:
        Why the session is not to begin any more; "" where it is.
    """
    told, done = 0.0, threading.Event()

    def progress(share: float) -> None:
        nonlocal told
        if parent is None and told <= share < 1.0:
            say(f"compiling, {share:.0%}: the first start on this machine takes about a minute")
            told = share + 0.2

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
        """Nothing is done yet."""

    def on_end(self, event: object) -> None:
        os.write(1, b".")


def main(part: str) -> None:
    """Compile one of `PARTS`, and end with whoever reads how far it is."""
    for number in (signal.SIGINT, signal.SIGPIPE):
        signal.signal(number, signal.SIG_DFL)
    event.register("numba:compile", _Counted())
    gc.disable()  # it would look through the compiler's millions of small objects again and again
    PARTS[part]()


if __name__ == "__main__":
    main(sys.argv[1])
