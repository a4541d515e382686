"""Small valid files of every format that is read, to be damaged."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import h5py
import numpy as np
import pyarrow
import pyarrow.parquet
import scipy.io
import trimesh

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "recordings"))

import made_bags
import measured_formats
import session_messages
from rosbags.rosbag2 import StoragePlugin

from foretouch.quantities import SensorCalibration
from foretouch.recordings import excerpt, write_calibration
from foretouch.vision import CameraModel

NAMES = ("time_s", "position_m", "force_N")
TABLE_MAP = "".join(
    f'[{name}]\ncolumn = "{name}_{unit}"\nunit = "{unit}"\n\n'
    for name, unit in (("time", "s"), ("position", "m"), ("force", "N"))
)


def write_all(folder: Path) -> dict[str, Path]:
    folder.mkdir()
    columns = dict(zip(NAMES, made_bags.press(0.2), strict=True))
    table = np.column_stack(list(columns.values()))
    np.savetxt(folder / "a.csv", table, delimiter=",", header=",".join(NAMES), comments="", fmt="%.6g")
    np.savetxt(folder / "semicolons.csv", table, delimiter=";", header="Zeit [s];Weg [m];Kraft [N]", comments="")
    pyarrow.parquet.write_table(pyarrow.table(columns), folder / "a.parquet")
    with h5py.File(folder / "a.h5", "w") as file:
        for name, column in columns.items():
            file.create_dataset(f"press/{name}", data=column, compression="gzip")
    scipy.io.savemat(folder / "a.mat", dict(columns))
    scipy.io.savemat(folder / "packed.mat", {"press": columns}, do_compression=True)
    measured_formats.write_tue(folder / "tue.mat", measured_formats.signals(200))
    measured_formats.write_aurora(folder / "a.ddf", table[:, 1:] * [1e3, 2.0])
    shutil.copy(excerpt("aurora/100-mN"), folder / "a.npz")
    _bags(folder)
    session_messages.write_session(folder / "session.mcap", 200)
    for ending in ("stl", "obj", "ply"):
        trimesh.creation.box((0.1, 0.1, 0.02)).export(folder / f"a.{ending}")
    trimesh.creation.box((0.1, 0.1, 0.02)).export(folder / "text.stl", file_type="stl_ascii")
    (folder / "map.toml").write_text(TABLE_MAP)
    write_calibration(folder / "calibration.toml", SensorCalibration(sensor_lag=0.003, tool_mass=0.1))
    CameraModel(640, 480, 600.0, 600.0).write(folder / "camera.toml")
    poses = np.column_stack([np.eye(3), np.eye(3)])
    np.savetxt(folder / "poses.csv", poses, delimiter=",", header="fx_N,fy_N,fz_N,gx,gy,gz", comments="")
    return {path.name: path for path in sorted(folder.iterdir()) if path.is_file()}


def _bags(folder: Path) -> None:
    made_bags.write_bag(folder / "bag", made_bags.press_messages(0.1))
    shutil.copy(next((folder / "bag").glob("*.db3")), folder / "a.db3")
    made_bags.write_bag(folder / "mcap", made_bags.press_messages(0.1), plugin=StoragePlugin.MCAP)
    shutil.copy(next((folder / "mcap").glob("*.mcap")), folder / "a.mcap")
    for name in ("bag", "mcap"):
        shutil.rmtree(folder / name)
