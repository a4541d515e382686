"""Is this machine fit for a session? One finding a check: a verdict, its result, and the command that mends it.

Nothing of the package that is heavy is imported here: a check that needs it makes it in a process of its own, which may
also crash there.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from foretouch.doctor import surroundings
from foretouch.doctor.arms import check_arm
from foretouch.doctor.finding import Finding, Verdict, render_findings, worst
from foretouch.doctor.hardware import check_cores, check_governor, check_graphics, check_real_time
from foretouch.doctor.loops import LoopReport, check_loops, run_loops
from foretouch.errors import install_command

if TYPE_CHECKING:
    from foretouch.link import ZenohLink
    from foretouch.messages import Message

__all__ = ["Finding", "Verdict", "examine", "render_findings", "worst"]

Way = tuple[str, str, int, "Callable[[Callable[[Message], None]], ZenohLink]"]
"""Way to a peer: endpoint, host, port, and the function that opens a link to it."""


def examine(
    *,
    seconds: float = 5.0,
    keys: Path | None = None,
    ways: tuple[Way, ...] = (),
    arm: str = "",
    machines: tuple[tuple[str, str], ...] = (),
    move: float = 0.0,
    network: str = "",
    say: Callable[[str], None],
) -> Iterator[Finding]:
    """Make every check, those first that disturb the others least, and give each finding as soon as it is there.

    The loops run, and each peer of the `ways` is asked, for `seconds` [s], above 0; `keys` is a folder, else the usual
    one; `arm` a simulated arm that is made and timed, or the file of its description; `machines` what is there, each
    ``"robot"`` or ``"device"`` and its name, a robot being allowed to `move` so far [m]; over a
    `network`, a name or a file, a session is simulated. `say` is called with what is examined next, where it takes
    long.
    """
    yield from (surroundings.check_python(), surroundings.check_packages(), surroundings.check_extras())
    yield from (check_cores(), check_governor())
    yield from (surroundings.check_text(), surroundings.check_disk(), surroundings.check_compiled())
    for port in surroundings.PORTS:
        yield _made(f"port {port}", functools.partial(surroundings.check_port, port))
    yield _made("keys", lambda: surroundings.check_keys(keys))
    say("drawing an image")
    yield check_graphics()
    if arm:
        say(f"timing the arm {arm}")
        yield check_arm(arm)
    for what, name in machines:
        from foretouch.doctor.machines import check_machine

        say(f"looking at the {what} {name} for {seconds:g} s")
        yield from check_machine(what, name, seconds, move)
    say(f"running two loops for {seconds:g} s")
    reports: dict[str, LoopReport] | str
    try:
        reports = run_loops(seconds)
    except RuntimeError as error:
        reports = str(error)
    yield check_loops(reports)
    yield check_real_time(None if isinstance(reports, str) else reports["session"]["slice_s"])
    if network:
        from foretouch.doctor.felt import check_network

        say(f"simulating a session over {network}")
        yield check_network(network)
    for endpoint, host, port, open_link in ways:
        from foretouch.doctor.network import check_peer

        say(f"asking {endpoint} for {seconds:g} s")
        yield from check_peer(endpoint, host, port, open_link, seconds)


def _made(name: str, check: Callable[[], Finding]) -> Finding:
    """A check that needs a package, or why it could not be made."""
    try:
        return check()
    except ImportError as error:
        return Finding(name, Verdict.UNKNOWN, f"{error.name} is not installed", install_command(again=True))
