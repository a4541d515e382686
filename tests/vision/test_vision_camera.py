from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.errors import InputError, SettingError
from foretouch.vision import CameraModel, Lens

LENS = CameraModel(640, 480, 610.0, 605.0, 322.0, 236.0, k1=-0.21, k2=0.05, p1=1e-3, p2=-8e-4, k3=0.01)


def test_projection_is_that_of_opencv() -> None:
    cv2 = pytest.importorskip("cv2")
    points = np.random.default_rng(0).uniform([-0.2, -0.15, 0.4], [0.2, 0.15, 0.9], (200, 3))
    theirs, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), LENS.matrix, LENS.distortion)
    assert LENS.project(points) == pytest.approx(theirs.reshape(-1, 2), abs=1e-9)


@given(st.floats(0, 639), st.floats(0, 479), st.floats(0.1, 10))
def test_a_ray_comes_back_to_its_pixel(column: float, row: float, depth: float) -> None:
    ray = LENS.unproject([(column, row)])
    assert LENS.project(depth * ray)[0] == pytest.approx((column, row), abs=1e-6)


def test_an_ideal_camera_in_closed_form() -> None:
    camera = CameraModel.from_field_of_view(641, 481, np.pi / 2)
    assert camera.project([(0.0, 0.0, 2.0), (1.0, -1.0, 2.0)]) == pytest.approx(
        np.array([(320.0, 240.0), (320.0 + 120.25, 240.0 - 120.25)])
    )
    assert np.isnan(camera.project([(0.0, 0.0, -1.0)])).all()


def test_the_file_is_read_as_it_was_written(tmp_path: Path) -> None:
    LENS.write(tmp_path / "camera.toml")
    assert CameraModel.read(tmp_path / "camera.toml") == LENS
    assert [path.name for path in tmp_path.iterdir()] == ["camera.toml"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("width = 640", "'focal_x' is missing"),
        ("width = 640\nheight = 480\nfocal_x = 600\nfocal_y = 600\nzoom = 2", "unknown key 'zoom'"),
        ("width = 640\nheight = 480\nfocal_x = nan\nfocal_y = 600", "focal_x = nan"),
        ("width = ", "is no camera"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "camera.toml").write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        CameraModel.read(tmp_path / "camera.toml")
    assert "camera.toml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_number_out_of_range_is_refused() -> None:
    with pytest.raises(SettingError, match="width"):
        CameraModel(0, 480, 600.0, 600.0)


@pytest.mark.long
def test_the_lens_moves_a_dot_where_the_camera_has_it() -> None:
    pytest.importorskip("cv2")
    lens = Lens(LENS)
    ideal = CameraModel.from_field_of_view(640, 480, lens.field_of_view)
    point = np.array([(0.16, -0.1, 0.5)])
    (column, row), rows, columns = ideal.project(point)[0], np.arange(480)[:, None], np.arange(640)
    dot = 255.0 * np.exp(-((columns - column) ** 2 + (rows - row) ** 2) / 18.0)
    drawn = lens.distort(np.rint(dot).astype(np.uint8)).astype(float)
    middle = (drawn * columns).sum() / drawn.sum(), (drawn * rows).sum() / drawn.sum()
    assert middle == pytest.approx(LENS.project(point)[0], abs=0.1)


def test_importing_the_room_imports_neither_opencv_nor_mujoco() -> None:
    check = "import sys, foretouch.vision, foretouch.robot; print([n for n in ('cv2', 'mujoco') if n in sys.modules])"
    done = subprocess.run([sys.executable, "-c", check], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_opencv_is_imported_in_one_file() -> None:
    sources = (Path(__file__).resolve().parents[2] / "src" / "foretouch").rglob("*.py")
    assert [path.name for path in sources if "import cv2" in path.read_text()] == ["camera.py"]
