"""LeRobot's own reader, in an environment of its own, finds in a dataset what the recording holds.

The environment takes 8 GB and most of the time; `FORETOUCH_LEROBOT_PYTHON` names the Python of one that is there.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import venv
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from foretouch.cli.app import app
from foretouch.link import free_endpoint
from foretouch.recordings import read_episode

pytestmark = pytest.mark.long
READS, MOVES = (Path(__file__).with_name(f"lerobot_{name}.py") for name in ("reads", "moves"))
ROOT = Path(__file__).parents[2]
CAMERA = "observation.images.camera"


def run(*words, seconds=300, **more):
    return subprocess.run([str(word) for word in words], capture_output=True, text=True, timeout=seconds, **more)


@pytest.fixture(scope="module")
def python(tmp_path_factory):
    """The Python of an environment with LeRobot: made here, or the one that the variable names, which is changed."""
    named = os.environ.get("FORETOUCH_LEROBOT_PYTHON", "")
    if named:
        yield Path(named)
        return
    folder = tmp_path_factory.mktemp("lerobot") / "env"
    venv.create(folder, with_pip=True)
    made = folder / "bin" / "python"
    done = run(made, "-m", "pip", "install", "--no-compile", "--quiet", "lerobot>=0.4.4,<0.5", seconds=1800)
    if done.returncode:
        pytest.skip(f"LeRobot cannot be installed here: {done.stderr.strip().splitlines()[-1]}")
    yield made
    shutil.rmtree(folder)  # 8 GB


@pytest.fixture(scope="module")
def ffmpeg(python, tmp_path_factory):
    """FFmpeg's libraries by the names that LeRobot's usual decoder looks for; PyAV brings them under other ones."""
    folder = tmp_path_factory.mktemp("ffmpeg")
    (own,) = python.parents[1].glob("lib/python3.*/site-packages/av.libs")
    for library in own.iterdir():
        (folder / library.name).symlink_to(library)
        plain = re.fullmatch(r"(lib(?:av|sw)\w+)-\w+(\.so\.\d+)[\d.]*", library.name)
        if plain:
            (folder / "".join(plain.groups())).symlink_to(library)
    return folder


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recordings")
    for name, more in (("line", ["--duration", "4"]), ("scene", ["--duration", "6", "--scene", "phantom"])):
        words = ["simulate", *more, "--recording", str(folder / f"{name}.mcap")]
        done = CliRunner().invoke(app, words)
        assert done.exit_code == 0, done.output
    return folder


def found(python, ffmpeg, root, decoder):
    """What LeRobot reads, with nothing fetched from anywhere."""
    alone = {"HF_HUB_OFFLINE": "1", "HF_HOME": str(root.parent / "cache"), "LD_LIBRARY_PATH": str(ffmpeg)}
    done = run(python, READS, root, decoder, env=os.environ | alone)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def expected(episode, frame):
    """What a frame holds by name, as the recording says it; a number that is never known is in no dataset."""
    told = {
        feature: [float(values[frame]) for values in named.values() if np.isfinite(values).any()]
        for feature, named in episode.features.items()
    }
    return {feature: values for feature, values in told.items() if values}


@pytest.mark.parametrize(("name", "decoder"), [("line", "pyav"), ("scene", "pyav"), ("scene", "torchcodec")])
def test_lerobot_reads_what_was_recorded(python, ffmpeg, recordings, tmp_path, name, decoder):
    path, root = recordings / f"{name}.mcap", tmp_path / "dataset"
    words = ["recordings", "convert", str(path), str(path), "--to", "lerobot", "--output", str(root)]
    done = CliRunner().invoke(app, [*words, "--task", "press foam"])
    assert done.exit_code == 0, done.output
    episode, said = read_episode(path), found(python, ffmpeg, root, decoder)
    assert (said["length"], said["episodes"], said["fps"]) == (2 * len(episode), 2, 30)
    images = [CAMERA] if name == "scene" else []
    assert said["inputs"] == sorted(["action", *images, "observation.state", "observation.wrench"])
    for number, read in said["frames"].items():
        index, frame = divmod(int(number), len(episode))
        assert (read["episode_index"], read["frame_index"], read["task"]) == (index, frame, "press foam")
        assert read["timestamp"] == np.float32(frame / 30)
        for feature, values in expected(episode, frame).items():
            given = read[feature] if isinstance(read[feature], list) else [read[feature]]
            assert np.array_equal(given, values, equal_nan=True), feature
        count, wrench = read["samples.count"], np.array(read["samples.wrench"])
        newest = [values[episode.ends[frame] - 1] for values in episode.samples["samples.wrench"].values()]
        assert wrench[count - 1].tolist() == newest
        assert count == episode.ends[frame] - (episode.ends[frame - 1] if frame else 0)
        if images:
            assert read["shape"] == [3, 480, 640]
            assert np.abs(255 * (np.array(read["colour"]) - colours(episode.images[frame]))).max() < 3.0
    action = [values[:2] for values in episode.features["action"].values()]
    assert np.reshape(said["two_actions"], (2, -1)).T.tolist() == np.array(action).tolist()
    assert said["batch"]["samples.wrench"] == [4, *np.shape(wrench)]
    mean = [values.mean(dtype=np.float64) for values in episode.features["observation.wrench"].values()]
    assert said["mean"]["observation.wrench"] == pytest.approx(mean, rel=1e-6, abs=1e-9)


def test_lerobot_drives_the_example(python, tmp_path):
    """Its loop of teleoperation looks on while foretouch's own loops press; and its actions alone move the robot."""
    example = shutil.copytree(ROOT / "examples" / "lerobot-foretouch", tmp_path / "example")
    here = f"{ROOT}[sim,link]"
    done = run(python, "-m", "pip", "install", "--no-compile", "--quiet", here, example, seconds=1800)
    assert done.returncode == 0, done.stderr
    alone = {"HF_HUB_OFFLINE": "1", "HF_HOME": str(tmp_path / "cache"), "PYTHONPATH": ""}
    done = run(python, MOVES, free_endpoint(), free_endpoint(), 0.006, seconds=900, env=os.environ | alone)
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout.splitlines()[-1])
    assert len(said["force"]) > 100
    assert max(said["force"]) > 1.0
    assert max(said["position"]) > 0.011
    asked, commanded = np.array(said["commanded"]).T
    assert np.ptp(commanded) > 0.008
    # The robot has what was asked for some frames before: the delay of the session's network.
    later = [np.abs(commanded[lag:] - asked[: asked.size - lag]).max() for lag in range(8)]
    assert min(later) < 0.004 < np.ptp(asked)
    assert said["policy"][0] == pytest.approx(0.0, abs=1e-4)
    assert said["policy"][-1] == pytest.approx(0.006, abs=1e-4)


def colours(jpeg):
    """Means of red, green and blue, from 0 to 1, by another decoder."""
    import cv2

    return cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)[:, :, ::-1].mean((0, 1)) / 255.0
