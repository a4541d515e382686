from __future__ import annotations

import subprocess
import sys
from pathlib import Path


def test_importing_the_room_imports_neither_opencv_nor_mujoco() -> None:
    check = "import sys, foretouch.vision, foretouch.robot; print([n for n in ('cv2', 'mujoco') if n in sys.modules])"
    done = subprocess.run([sys.executable, "-c", check], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_opencv_is_imported_in_one_file() -> None:
    sources = (Path(__file__).resolve().parents[2] / "src" / "foretouch").rglob("*.py")
    assert [path.name for path in sources if "import cv2" in path.read_text()] == ["camera.py"]
