"""What is sent against loss: by the option's name, alike at both ends or not."""

from __future__ import annotations

import random
import sys
from itertools import product
from pathlib import Path

import pytest
from thin_serial import BothEnds, SerialLink
from thin_ticks import MS, command_at

from foretouch.errors import SettingError, UnknownNameError
from foretouch.messages import Message
from foretouch.session import SessionSettings
from foretouch.session.thin import FollowerEnd, LeaderEnd
from foretouch.session.thin.ends import PROTECTIONS, USUAL
from foretouch.settings import PROTECTIONS as NAMES
from foretouch.sweep import Plan, draw_case

sys.path.append(str(Path(__file__).resolve().parents[2] / "cli"))
from typed_commands import output_of, refusal_of


class Lossy(SerialLink):
    """One that loses packets."""

    def __init__(self, loss: float, seed: int) -> None:
        super().__init__(1e9, 30 * MS)
        self._loss, self._draw = loss, random.Random(seed)

    def push(self, now_ns: int, packet: Message) -> None:
        if self._draw.random() >= self._loss:
            super().push(now_ns, packet)


@pytest.mark.parametrize(("leader", "follower"), list(product(PROTECTIONS, PROTECTIONS)))
@pytest.mark.first
def test_ends_of_any_two_choices_understand_each_other_and_say_nothing_wrong(leader: str, follower: str) -> None:
    both = BothEnds(2000.0, (Lossy(0.2, 1), Lossy(0.05, 2)), heavy=True)
    both.leader, both.follower = LeaderEnd(2000.0, 0.0, leader), FollowerEnd(2000.0, 0.0, follower)
    came = 0
    for _ in range(4000):
        commands, _ = both.run(1)
        for command in commands:
            came += 1
            wrong = command.position - command_at(command.sequence).position
            assert abs(wrong) < 5e-3  # as far as a line may go on
    assert came > 3000
    # Of a model of a dozen pieces one is lost oftener than not.
    assert both.leader.models_came[0] > 0 or (follower == "none" and both.leader.models_came[1] > 0)


def test_the_names_are_those_of_the_setting() -> None:
    assert tuple(PROTECTIONS) == NAMES
    assert SessionSettings().protection == USUAL
    assert SessionSettings(budget=2000.0, protection="strong").protection == "strong"


def test_a_mistake_is_one_line() -> None:
    with pytest.raises(UnknownNameError, match="unknown protection 'twice': choose one of none, parity, strong"):
        SessionSettings(budget=2000.0, protection="twice")
    with pytest.raises(SettingError, match=r"protection = 'none': is of a thin link: give a budget, too"):
        SessionSettings(protection="none")
    assert "choose one of none, parity, strong" in refusal_of("simulate", "--budget", 2000, "--protection", "twice")
    assert "give a budget, too" in refusal_of("simulate", "--protection", "strong")
    assert "choose one of none, parity, strong" in refusal_of("sweep", "--budget", 2000, "--protection", "twice")
    assert "give a budget, too" in refusal_of("sweep", "--protection", "strong")


def test_sessions_of_a_sweep_have_it() -> None:
    case = draw_case(3, budget=2000.0, protection="strong")
    assert case.command.endswith("--budget 2000.0 --protection strong")
    assert draw_case(3, budget=2000.0).command == case.command.removesuffix(" --protection strong")
    assert all(case.options["protection"] == "none" for case in Plan(2, 0, budget=2000.0, protection="none").cases())


@pytest.mark.parametrize("protection", PROTECTIONS)
@pytest.mark.first
def test_a_session_that_loses_a_tenth(protection: str, tmp_path: Path) -> None:
    words = "--budget", 2000, "--protection", protection, "--loss", 0.1, "--duration", 4, "--report", tmp_path
    content = output_of("simulate", *words)
    assert content["settings"]["protection"] == protection
    for side in ("leader", "follower"):
        assert 400 < content["heard"][side]["bytes_per_s"] <= 2000
