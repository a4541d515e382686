"""What holds of every command: an example in its help, JSON, exit codes, completion, and a quick start."""

from __future__ import annotations

import ast
import inspect
import json
import os
import re
import resource
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from typer.main import get_command
from typer.testing import CliRunner

import foretouch
from foretouch.cli import INTERRUPTED, main
from foretouch.cli.app import EXIT_CODES, app

DOCUMENTED = Path(__file__).resolve().parents[2] / "docs" / "command-line.md"

SOURCE = Path(inspect.getfile(foretouch)).parent

WITHOUT_RESULT = ("leader", "follower", "camera", "record", "console", "bridge ros2", "warm-up")
"""Commands that print nothing on the output: all but the last run until they are ended."""


def walk(command: object, path: tuple[str, ...] = ()) -> Iterator[tuple[str, click.Command]]:
    for name, below in getattr(command, "commands", {}).items():
        yield from walk(below, (*path, name))
    if not hasattr(command, "commands"):
        yield " ".join(path), command  # type: ignore[misc]


COMMANDS = dict(walk(get_command(app)))


def foretouch_command(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "foretouch", *arguments], env=os.environ | environment, capture_output=True, text=True
    )


def test_there_are_commands() -> None:
    assert len(COMMANDS) > 25
    assert "doctor" in COMMANDS


@pytest.mark.parametrize("name", COMMANDS)
def test_help_of_every_command_has_an_example_that_it_takes(name: str) -> None:
    result = CliRunner().invoke(app, [*name.split(), "--help"])
    assert result.exit_code == 0, result.output
    match = re.search(r"Example: (foretouch [^\n]*(?:\n +\S[^\n]*)*)", result.output)
    assert match is not None, f"foretouch {name} --help shows no example"
    words = shlex.split(" ".join(match[1].split()))[1:]
    assert words[: len(name.split())] == name.split()
    # What the example gives is what the command takes: an option that is not there, or a missing argument, raises.
    COMMANDS[name].make_context(name, words[len(name.split()) :], resilient_parsing=False)


@pytest.mark.parametrize("name", sorted(set(COMMANDS) - set(WITHOUT_RESULT)))
def test_what_prints_a_result_prints_it_as_json_too(name: str) -> None:
    assert "--json" in {option for parameter in COMMANDS[name].params for option in parameter.opts}


def test_the_commands_without_a_result_are_commands() -> None:
    assert set(WITHOUT_RESULT) <= set(COMMANDS)


def test_completing_the_beginning_of_a_command_gives_the_command(tmp_path: Path) -> None:
    command = Path(sys.executable).with_name("foretouch")
    if not command.exists():
        pytest.skip("the foretouch command is not installed beside this Python")
    completed = subprocess.run(
        [command],
        env=os.environ | {"_FORETOUCH_COMPLETE": "complete_bash", "COMP_WORDS": "foretouch sim", "COMP_CWORD": "1"},
        capture_output=True,
        text=True,
    )
    assert completed.stdout.split() == ["simulate"]
    assert completed.stderr == ""


@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")
def test_bash_completes_by_what_install_completion_writes(tmp_path: Path) -> None:
    command = Path(sys.executable).with_name("foretouch")
    if not command.exists():
        pytest.skip("the foretouch command is not installed beside this Python")
    environment = os.environ | {"HOME": str(tmp_path), "PATH": f"{command.parent}{os.pathsep}{os.environ['PATH']}"}
    shown = subprocess.run(
        ["bash", "-c", "foretouch --show-completion; true"], env=environment, capture_output=True, text=True
    )
    assert "complete -o default -F _foretouch_completion foretouch" in shown.stdout, shown.stderr
    asks = 'COMP_WORDS=(foretouch sim); COMP_CWORD=1; _foretouch_completion foretouch; echo "${COMPREPLY[@]}"'
    script = f"{shown.stdout}\n{asks}"
    reply = subprocess.run(["bash", "-c", script], env=environment, capture_output=True, text=True)
    assert reply.stdout.split() == ["simulate"], reply.stderr


@pytest.mark.long
def test_help_takes_less_than_three_times_what_its_library_takes_to_load() -> None:
    def processor_time(*arguments: str) -> float:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, *arguments], capture_output=True, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    took = [(processor_time("-m", "foretouch", "--help"), processor_time("-c", "import typer")) for _ in range(5)]
    shown, loaded = (min(times) for times in zip(*took, strict=True))  # a busy machine only adds to the least
    assert shown < 3.0 * loaded


def test_the_page_and_the_help_list_the_exit_codes_that_there_are() -> None:
    listed = {int(code) for code in re.findall(r"^\| (\d+) \|", DOCUMENTED.read_text(), re.MULTILINE)}
    assert listed == set(EXIT_CODES)
    help_text = " ".join(CliRunner().invoke(app, ["--help"]).output.split())
    for code, (short, sentence) in EXIT_CODES.items():
        assert f"{code} {short}" in help_text
        assert sentence in DOCUMENTED.read_text()


def test_every_exit_code_in_the_code_is_listed() -> None:
    """Literal codes of `typer.Exit` and `sys.exit`, and named ones, as the modules define them."""
    result: set[int] = set()
    for path in (SOURCE / "cli").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and ast.unparse(node.func) in ("typer.Exit", "sys.exit") and node.args:
                (argument,) = node.args
                if isinstance(argument, ast.Constant):
                    result.add(int(argument.value))
                else:
                    assert ast.unparse(argument) in ("code", "self.code", "INTERRUPTED"), f"{path}: {ast.unparse(node)}"
    from foretouch.session import RECORDING_INCOMPLETE

    assert result | {0, RECORDING_INCOMPLETE, INTERRUPTED} == set(EXIT_CODES)


@pytest.mark.parametrize(("arguments", "code"), [(("--version",), 0), (("no-such-command",), 2)])
def test_codes_are_as_listed(arguments: tuple[str, ...], code: int) -> None:
    assert foretouch_command(*arguments).returncode == code


@pytest.mark.parametrize(
    ("arguments", "what_to_do"),
    [
        (("simulat",), "Did you mean 'simulate'?"),
        (("simulate", "--durration", "3"), "--duration"),
        (("simulate", "--material", "jelly"), "choose one of"),
        (("simulate", "--duration", "0"), "above 0 s"),
        (("simulate", "--recording", "out.csv"), "must end with .mcap"),
        (("identify", "nothing.csv"), "nothing.csv"),
        (("predict", "nothing.csv", "--delay=-1"), "at least 0"),
        (("leader",), "give --listen or --connect"),
        (("doctor", "--connect", "127.0.0.1"), "write it as tcp/HOST:PORT"),
        (("doctor", "--connect", "tcp/192.0.2.1:7447"), "--insecure"),
        (("doctor", "--seconds", "0"), "above 0"),
        (("doctor", "--robot", "kuka"), "unknown robot 'kuka': choose one of FILE.xml, "),
        (("doctor", "--robot", "fr3", "--listen", "tcp/127.0.0.1:1"), "do not go together"),
        (("sweep", "--robot", "kuka"), "must be simulated, fr3, ur5e, so101, or the .xml"),
        (("sweep", "--robot", "nowhere.xml"), "nowhere.xml: no such file"),
        (("doctor", "--listen", "tcp/127.0.0.1:1", "--connect", "tcp/127.0.0.1:2"), "on one machine"),
        (("datasets", "fetch", "nonsense"), "choose one of"),
        (("bench", "--only", "nonsense"), "choose one of"),
        (("reproduce", "--only", "nonsense"), "choose one of"),
    ],
)
def test_errors_say_what_to_do_in_few_lines_and_no_traceback(
    arguments: tuple[str, ...], what_to_do: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("foretouch.session.give_way", lambda: None)  # this process is the tests' own
    monkeypatch.setattr("foretouch.cli.POOLS", ())
    monkeypatch.setattr(sys, "argv", ["foretouch", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    output = capsys.readouterr()
    assert ended.value.code == 2
    assert output.out == ""
    assert what_to_do in output.err
    assert "Traceback" not in output.err
    assert len(output.err.strip().splitlines()) <= 4


def test_json_is_the_whole_output(tmp_path: Path) -> None:
    def said(*arguments: str) -> str:
        return CliRunner().invoke(app, ["keys", *arguments, "--keys", str(tmp_path / "keys"), "--json"]).stdout

    made = {words[0]: json.loads(said(*words)) for words in (("init",), ("issue", "leader"), ("rotate",))}
    assert set(made["init"]["certificates"]) == {"authority.key"}
    assert set(made["issue"]["certificates"]) == set(made["rotate"]["certificates"]) == {"leader.pem"}
    before, after = (made[name]["certificates"]["leader.pem"]["sha256"] for name in ("issue", "rotate"))
    assert before != after


def test_names_of_others_are_printed_in_one_safe_way(tmp_path: Path) -> None:
    """Every line for people goes through `say` or `show`; a file's name moves no cursor."""
    from foretouch.cli import options

    folder = Path(options.__file__).parent
    raw = [path.name for path in folder.glob("*.py") if "typer.echo(" in path.read_text()]
    assert sorted(raw) == ["app.py", "options.py"]  # app.py: the version
    source = tmp_path / "a.csv"
    source.write_text("time_s,position_m,force_N\n0,0,0\n0.001,0.0001,0.1\n0.002,0.0002,0.2\n")
    done = CliRunner().invoke(app, ["recordings", "convert", str(source), str(tmp_path / "b\x1b[2J.csv")])
    assert done.exit_code == 0, done.output
    assert "\x1b" not in done.output
    assert r"b\x1b[2J.csv" in done.output


@pytest.mark.parametrize("words", [("predict", "--bogus"), ("lead",), ("predict", "--delay", "x")])
def test_what_was_typed_wrong_is_told_in_one_line(words: tuple[str, ...]) -> None:
    result = foretouch_command(*words)
    assert result.returncode == 2
    assert re.fullmatch(r"foretouch: [^\n]+ \(see `[^`\n]+ --help`\)\n", result.stderr)


@pytest.mark.long
def test_an_arm_that_breaks_a_rule_is_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "mine.xml"
    path.write_text("<mujoco/>")
    report = tmp_path / "out"
    for words in (("simulate", "--report", str(report)), ("follower",), ("teleop", "--report", str(report))):
        done = foretouch_command(*words, "--robot", str(path), "--duration", "1")
        assert done.returncode == 2
        assert done.stderr == f'foretouch: {path}: it has no site "base": add one to the body of the base\n'
        assert not report.exists()
