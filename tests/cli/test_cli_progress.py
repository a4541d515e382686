"""Bars: on a terminal, where something takes long; nowhere else, and never on the output."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from foretouch.cli import progress
from foretouch.cli.app import app
from foretouch.cli.progress import Bar, progress_bar, pulsing

pty = pytest.importorskip("pty")


def on_a_terminal(code: str, **environment: str) -> tuple[str, str]:
    """Output, and what a terminal that has the error stream was sent."""
    terminal, end = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        env=os.environ | {"TERM": "xterm-256color", "COLUMNS": "100"} | environment,
        stdout=subprocess.PIPE,
        stderr=end,
        close_fds=True,
    )
    os.close(end)
    shown = b""
    while True:
        try:
            part = os.read(terminal, 65536)
        except OSError:  # the other end has closed
            break
        if not part:
            break
        shown += part
    out = process.communicate()[0].decode()
    assert process.returncode == 0, shown.decode()
    return out, shown.decode()


COMMAND = "import sys; sys.argv = ['foretouch', {arguments}]; from foretouch.cli import main; main()"


def command(*arguments: object) -> str:
    return COMMAND.format(arguments=", ".join(repr(str(argument)) for argument in arguments))


@pytest.mark.long
def test_a_long_simulation_shows_how_far_it_is_and_keeps_its_output_clean() -> None:
    arguments = ("simulate", "--duration", 40, "--model", "kelvin-voigt", "--material", "kelvin-voigt", "--json")
    out, shown = on_a_terminal(command(*arguments))
    assert json.loads(out)["timing"]
    assert "simulating" in shown
    assert "%" in shown


def test_without_a_terminal_nothing_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "SHOWN_AFTER", 0.0)  # as if everything took long
    arguments = ("simulate", "--duration", "2", "--model", "kelvin-voigt", "--material", "kelvin-voigt", "--json")
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0
    assert done.stderr == ""
    assert json.loads(done.stdout)["timing"]


@pytest.mark.long
def test_a_comparison_shows_a_bar_on_a_terminal_and_lines_elsewhere(tmp_path: Path) -> None:
    code = command("compare", "--simulated", "--models", "kelvin-voigt", "--estimators", "rls", "--jobs", 1, "--json")
    out, shown = on_a_terminal(code)
    assert json.loads(out)["results"]
    assert " of " not in shown
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert len(done.stderr.splitlines()) == len(json.loads(out)["results"])
    assert " by rls" in done.stderr


PULSE = (
    "import time; from foretouch.cli.progress import pulsing\n"
    "print(pulsing('thinking', lambda seconds: (time.sleep(seconds), 42)[1], {seconds}))"
)


def test_what_says_nothing_of_itself_pulses_after_a_while() -> None:
    out, shown = on_a_terminal(PULSE.format(seconds=1.6))
    assert out.strip() == "42"
    assert "thinking" in shown
    out, shown = on_a_terminal(PULSE.format(seconds=0.2))
    assert (out.strip(), shown) == ("42", "")


def test_no_color_is_heeded() -> None:
    environment = {"NO_COLOR": "1"}
    _, shown = on_a_terminal(PULSE.format(seconds=1.6), **environment)
    assert "thinking" in shown
    assert "\x1b[38;" not in shown


def test_a_line_stands_above_the_bar_and_a_closed_bar_is_not_drawn_again() -> None:
    code = (
        "from foretouch.cli.progress import Bar\n"
        "bar = Bar('working', refreshing=False)\n"
        "bar.update(1, 2); bar.say('half is done'); bar.close(); bar.update(2, 2); bar.say('all is done')"
    )
    _, shown = on_a_terminal(code)
    assert shown.index("half is done") < shown.index("all is done")
    assert "50%" in shown
    assert "100%" not in shown


def test_a_bar_without_a_terminal_says_lines_and_ends_with_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    def fail() -> None:
        raise ValueError("no luck")

    with progress_bar("working") as bar:
        bar.pulse()
        bar.update(1, 2)
        bar.say("half is done")
    with pytest.raises(ValueError, match="no luck"):
        pulsing("working", fail)
    assert capsys.readouterr().err == "half is done\n"
    assert not Bar("working").shown
