"""What is built from this checkout, and what it is in an environment where nothing else is."""

from __future__ import annotations

import json
import re
import runpy
import shutil
import subprocess
import sys
import tarfile
import tomllib
import venv
import zipfile
from pathlib import Path
from typing import Any

import pytest

from foretouch import __version__
from foretouch.recordings import DATASETS
from foretouch.robot.camera_scene import MESA_PACKAGES

ROOT = Path(__file__).parents[2]
EXTRAS = runpy.run_path(str(ROOT / "docs" / "try_extras.py"))
TRIED, INSTALLED = EXTRAS["TRIED"], EXTRAS["INSTALLED"]
LEAN_MB = 400
LEAN = {"numpy", "scipy", "numba", "msgspec", "typer", "rich", "joblib"}
"""What the base asks for."""


def run(*command: str | Path, **options: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=600, **options)  # type: ignore[call-overload,no-any-return]


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dist")
    done = run(sys.executable, "-m", "hatchling", "build", "-d", folder, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return folder


def one(folder: Path, pattern: str) -> Path:
    (result,) = folder.glob(pattern)
    return result


@pytest.mark.long
def test_both_distributions_are_as_the_index_wants_them(built: Path) -> None:
    files = one(built, "*.whl"), one(built, "*.tar.gz")
    done = run(sys.executable, "-m", "twine", "--no-color", "check", "--strict", *files)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("PASSED") == 2


def test_the_wheel_holds_the_package_and_nothing_beside_it(built: Path) -> None:
    with zipfile.ZipFile(one(built, "*.whl")) as wheel:
        sizes = {entry.filename: entry.compress_size for entry in wheel.infolist()}
    names = sizes.keys()
    info = f"foretouch-{__version__}.dist-info/"
    assert {name.split("/")[0] + "/" for name in names} == {"foretouch/", info}
    assert "foretouch/py.typed" in names
    assert "foretouch/bench/baseline.json" in names
    excerpts = {f"foretouch/recordings/measured/{name}.npz" for name in DATASETS}
    assert excerpts <= names
    for folder in {path.rpartition("/")[0] for path in excerpts}:
        assert {f"{folder}/LICENSE", f"{folder}/ORIGIN.md", f"{info}licenses/src/{folder}/LICENSE"} <= names
    assert sum(sizes[name] for name in names if "/recordings/measured/" in name) < 4e6
    assert info + "licenses/LICENSE" in names
    ours = {path.relative_to(ROOT / "src").as_posix() for path in (ROOT / "src" / "foretouch").rglob("*.py")}
    assert {name for name in names if name.endswith(".py")} == ours


def test_the_source_distribution_holds_what_a_test_of_it_needs(built: Path) -> None:
    with tarfile.open(one(built, "*.tar.gz")) as source:
        names = {name.partition("/")[2] for name in source.getnames()}
    wanted = {
        "Makefile",
        "requirements.lock",
        "CITATION.cff",
        "Containerfile",
        ".dockerignore",
        "tools/setup",
        "tests/conftest.py",
    }
    assert wanted <= names
    assert not [name for name in names if name.startswith("docs/_build/") or "__pycache__" in name]


@pytest.mark.long
def test_the_wheel_alone_runs_in_an_empty_environment(built: Path, tmp_path: Path) -> None:
    venv.create(tmp_path / "env", with_pip=True)
    python = tmp_path / "env" / "bin" / "python"
    done = run(python, "-m", "pip", "install", "--no-compile", "--only-binary", ":all:", one(built, "*.whl"))
    assert done.returncode == 0, done.stderr
    sizes = json.loads(run(python, "-c", INSTALLED).stdout)
    assert {name.lower() for name in sizes} >= LEAN
    assert not {"mujoco", "matplotlib", "viser", "pyarrow", "pandas"} & set(sizes)
    ours = {name: size for name, size in sizes.items() if name not in ("pip", "setuptools")}
    assert sum(ours.values()) < LEAN_MB * 1e6, sorted(ours.items(), key=lambda item: -item[1])[:5]

    command = tmp_path / "env" / "bin" / "foretouch"
    press = tmp_path / "press.csv"
    lines = [f"{k * 1e-3:.3f},{0.01 * abs((k % 1000) / 500 - 1):.6f}" for k in range(3000)]
    rows = [line + f",{max(0.0, 400.0 * (float(line.split(',')[1]) - 0.002)):.4f}" for line in lines]
    press.write_text("\n".join(["time_s,position_m,force_N", *rows]) + "\n")
    done = run(command, "identify", press, "--model", "kelvin-voigt", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    stiffness = json.loads(done.stdout)["parameters"]["stiffness"]
    assert 360.0 < stiffness < 440.0

    done = run(command, "predict", "--dataset", "tue/b-foam", "--model", "kelvin-voigt", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["samples"] == 9816

    for words, extra in (
        (("teleop",), "sim"),
        (("simulate",), "sim"),
        (("leader", "--connect", "tcp/127.0.0.1:7447"), "link"),
    ):
        done = run(command, *words, cwd=tmp_path)
        assert done.returncode != 0
        assert re.fullmatch(rf"foretouch: .* not installed: pip install 'foretouch\[{extra}[^\]]*\]'\n", done.stderr)
        assert not done.stdout


PAGES = ("devices.md", "drivers.md", "ros2.md", "recordings.md")
BESIDE = {"all", "recordings"}
"""Extras on these pages that are of no driver or device."""


@pytest.fixture(scope="module")
def without(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    """The wheel, and what it is without an extra."""
    wheel = EXTRAS["build"](tmp_path_factory.mktemp("wheel"))
    return wheel, EXTRAS["install"](wheel, "", tmp_path_factory.mktemp("without"))


@pytest.mark.long
@pytest.mark.parametrize("extra", TRIED)
def test_an_extra_brings_the_library_of_its_driver(extra: str, without: tuple[Path, Any], tmp_path: Path) -> None:
    wheel, base = without
    one = EXTRAS["install"](wheel, extra, tmp_path)
    shutil.rmtree(tmp_path / "env")  # half a gigabyte
    assert one.found, one.answer
    assert one.plugins == base.plugins > 30
    assert set(one.sizes) > set(base.sizes)


def test_every_extra_of_a_driver_or_device_is_tried() -> None:
    pages = "".join((ROOT / "docs" / page).read_text() for page in PAGES)
    named = {extra for words in re.findall(r"foretouch\[([\w,]+)\]", pages) for extra in words.split(",")}
    assert named - BESIDE <= set(TRIED)
    assert set(TRIED) <= set(tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"])


def test_the_citation_is_of_this_version_and_names_the_paper() -> None:
    from ruamel.yaml import YAML

    cited = YAML(typ="safe").load(ROOT / "CITATION.cff")
    assert cited["cff-version"] == "1.2.0"
    assert cited["version"] == __version__
    assert "A continuous switching contact model" in cited["message"]
    assert "Complex & Intelligent Systems (2021), https://doi.org/10.1007/s40747-021-00464-0" in cited["message"]


def test_every_package_of_the_lock_has_its_licence_listed() -> None:
    locked = re.findall(r"^([a-z0-9][a-z0-9.-]*)==(\S+)", (ROOT / "requirements.lock").read_text(), re.MULTILINE)
    listed = runpy.run_path(str(ROOT / "docs" / "list_licences.py"))["rows"]()
    assert {name: version for name, version, _, _ in listed} == dict(locked)
    stated = {name: licence for name, _, licence, _ in listed}
    assert "Apache" in stated["cryptography"]
    assert "not stated" not in stated.values()
    assert ".. licences::" in (ROOT / "docs" / "licences.md").read_text()


def test_the_container_installs_the_lock_and_runs_the_main_job() -> None:
    text = (ROOT / "Containerfile").read_text()
    copied = [word for words in re.findall(r"^COPY (.*) \S+$", text, re.MULTILINE) for word in words.split()]
    assert {"requirements.lock", "pyproject.toml", "src"} <= set(copied)
    sent = re.findall(r"^!(\S+)$", (ROOT / ".dockerignore").read_text(), re.MULTILINE)
    assert sorted(copied) == sorted(sent), "what the build copies is what it is sent"
    for word in copied:
        assert (ROOT / word).exists(), word
    assert "--require-hashes -r requirements.lock" in text
    (packages,) = re.findall(r"apt-get install -y --no-install-recommends (.*?) \\\n", text)
    assert packages == MESA_PACKAGES
    assert 'ENTRYPOINT ["foretouch"]\nCMD ["teleop"]' in text
