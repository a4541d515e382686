"""`foretouch arms meshes`: where they lie, and what is said where they cannot be had."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from typed_commands import good, output_of, run

pytest.importorskip("mujoco")

from foretouch.errors import DatasetError
from foretouch.recordings import DATA_DIR
from foretouch.robot import ARM_MESHES
from menagerie import write_arm


def test_the_meshes_of_all_arms_are_fetched_and_their_licences_said(www: Path) -> None:
    for name, origin in ARM_MESHES.items():
        write_arm(name, www / origin.repository / origin.commit)
    content = output_of("arms", "meshes", "all")
    assert set(content) == set(ARM_MESHES)
    for name, origin in ARM_MESHES.items():
        assert Path(content[name]["file"]).is_file()
        assert content[name]["licence"] == origin.licence
    path = content["ur5e"]["file"]
    line = f"{path}   BSD 3-Clause License, Copyright 2018 ROS Industrial Consortium\n"
    assert good("arms", "meshes", "ur5e").stdout == line


@pytest.mark.parametrize(
    ("arm", "said"),
    [
        ("ur5e", "is no folder: name the one that has the files, or unset it"),
        ("simulated", "unknown arm with meshes 'simulated': choose one of all, fr3, so101, ur5e"),
        ("all2", "unknown arm with meshes 'all2': choose one of all, fr3, so101, ur5e"),
    ],
)
@pytest.mark.first
def test_what_cannot_be_had_is_one_line_with_exit_code_2(arm: str, said: str, elsewhere: Path) -> None:
    words = [sys.executable, "-m", "foretouch", "arms", "meshes", arm]
    surroundings = os.environ | {DATA_DIR: str(elsewhere / "absent")}
    done = subprocess.run(words, env=surroundings, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (2, "")
    assert said in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_without_network_the_recordings_and_the_meshes_say_the_same(elsewhere: Path) -> None:
    for words in (("arms", "meshes", "fr3"), ("datasets", "fetch", "tue/b-foam")):
        error = run(*words).exception
        assert isinstance(error, DatasetError)
        assert "is not here and could not be fetched from http://127.0.0.1:9 (" in str(error)
        assert "connect to the network once, or set FORETOUCH_DATA_DIR to a folder that has " in str(error)
