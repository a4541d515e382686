"""What a camera beside the follower sees: the fixture with its board, and the probe."""

from __future__ import annotations

import ctypes.util
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import MissingExtraError, SettingError
from foretouch.quantities.pose import Pose
from foretouch.robot.engine import ROD_LENGTH, ROD_RADIUS, TIP_RADIUS, Tip, load_mujoco

MESA_PACKAGES = "libegl1 libegl-mesa0 libgl1-mesa-dri libopengl0"
"""Debian packages that let MuJoCo draw without a display."""

THICKNESS = 2e-3  # Thickness of a specimen that is drawn [m]
NEAREST, FARTHEST = 0.02, 5.0  # Nearest and farthest distance from the camera that is drawn [m]


class MissingGraphicsError(MissingExtraError):
    """There is no OpenGL library that draws without a display."""

    def __init__(self, problem: str) -> None:
        Exception.__init__(
            self, f"no camera image can be drawn: {problem}: apt-get install {MESA_PACKAGES} (or libosmesa6)"
        )


def graphics_library() -> str:
    """The library that draws without a display: ``egl``, or else ``osmesa``.

    Raises:
        MissingGraphicsError: Neither is there.
    """
    for name, library in (("egl", "EGL"), ("osmesa", "OSMesa")):
        if ctypes.util.find_library(library):
            return name
    raise MissingGraphicsError("neither EGL nor OSMesa is installed")


def _context(width: int, height: int) -> Any:
    """An OpenGL context without a display, current in this thread."""
    name = graphics_library()
    try:
        if name == "egl":
            from mujoco.egl import GLContext
        else:
            from mujoco.osmesa import GLContext
        context = GLContext(width, height)
        context.make_current()
    except Exception as error:  # PyOpenGL raises whatever its loader met: AttributeError, ImportError, RuntimeError
        raise MissingGraphicsError(f"{name} does not start ({error})".replace("\n", " ")) from error
    return context


def _numbers(values: Any) -> str:
    return " ".join(f"{value:.9g}" for value in np.ravel(values))


class CameraScene:
    """A camera in MuJoCo without lens, noise or delay: pixel centres at whole numbers, the middle at (size - 1) / 2.

    The fixture is a block whose upper side is the surface that is touched; its frame has its origin in the middle of
    the board, z out of it. Shadows and reflections are off: they cost four times the time. A scene belongs to the
    thread that made it, and is closed by it.

    Args:
        board_image: The board as it is printed, (n, n) grey.
        board_size: Side of that image on the fixture [m].
        camera: The camera's frame in the world: x to the right of the image, y down, z along the view.
        size: Width and height of the image [pixel].
        vertical: Field of view from the upper to the lower edge [rad].
        light: Brightness of what lights the scene, 0 to 1.
        specimen: Vertices (n, 3) [m] and triangles (m, 3) of what stands beside the board, in the fixture's frame; None
            for nothing.
        probe_radius: Of the sphere that touches, whose centre is the probe's position [m]; 0 for a point.

    Raises:
        SettingError: A number out of its range.
        MissingExtraError: MuJoCo is not installed.
        MissingGraphicsError: Nothing here draws without a display.
    """

    def __init__(
        self,
        board_image: NDArray[np.uint8],
        board_size: float,
        camera: Pose,
        *,
        size: tuple[int, int] = (640, 480),
        vertical: float = 0.75,
        light: float = 0.6,
        specimen: tuple[NDArray[np.float64], NDArray[np.int64]] | None = None,
        probe_radius: float = 0.0,
    ) -> None:
        if board_image.ndim != 2 or board_image.shape[0] != board_image.shape[1] or board_image.dtype != np.uint8:
            raise SettingError("board_image", board_image.shape, "must be square and grey, one byte a pixel")
        self.width, self.height = size
        for name, value, least, most in (
            ("board_size", board_size, 1e-3, 2.0),
            ("width", self.width, 16, 4096),
            ("height", self.height, 16, 4096),
            ("vertical", vertical, 0.05, 2.8),
            ("light", light, 0.0, 1.0),
            ("probe_radius", probe_radius, 0.0, 0.1),
        ):
            if not least <= value <= most:
                raise SettingError(name, value, f"must be {least:g} to {most:g}")
        mujoco = load_mujoco()
        self._mujoco = mujoco
        self._context = _context(*size)
        texture = np.repeat(board_image[:, :, None], 3, axis=2)
        tip = Tip.of(probe_radius, TIP_RADIUS)
        text = _scene_text(board_image.shape[0], board_size, camera, size, vertical, light, specimen, tip)
        self._model = mujoco.MjModel.from_xml_string(text)
        self._fill_texture(texture)
        self._data = mujoco.MjData(self._model)
        self._scene = mujoco.MjvScene(self._model, maxgeom=50)
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            self._scene.flags[flag] = 0
        self._view = mujoco.MjvCamera()
        self._view.type, self._view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
        self._option = mujoco.MjvOption()
        self._drawing = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._drawing)

    def _fill_texture(self, texture: NDArray[np.uint8]) -> None:
        first = int(self._model.tex_adr[0])
        self._model.tex_data[first : first + texture.size] = texture.ravel()

    def render(self, fixture: Pose, probe: NDArray[np.float64] | tuple[float, float, float]) -> NDArray[np.uint8]:
        """What the camera sees, (height, width, 3) RGB, the first row on top.

        Args:
            fixture: The board's frame in the world.
            probe: The probe's position in the world [m]: its tip, of a sphere the centre. The rod points straight up.
        """
        mujoco, data = self._mujoco, self._data
        data.mocap_pos[0] = fixture.translation
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(fixture.rotation).ravel())
        data.mocap_quat[0] = quaternion
        data.mocap_pos[1] = probe
        mujoco.mj_forward(self._model, data)
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self._model, data, self._option, None, self._view, everything, self._scene)
        frame = mujoco.MjrRect(0, 0, self.width, self.height)
        mujoco.mjr_render(frame, self._scene, self._drawing)
        image = np.empty((self.height, self.width, 3), np.uint8)
        mujoco.mjr_readPixels(image, None, frame, self._drawing)
        return np.ascontiguousarray(image[::-1])

    def close(self) -> None:
        """Give back what the graphics library holds."""
        self._drawing.free()
        self._context.free()


def _solid(specimen: tuple[NDArray[np.float64], NDArray[np.int64]]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """A sheet with its own back: MuJoCo wants meshes with a volume, and draws one side of a triangle alone."""
    vertices, faces = specimen
    below = vertices - (0.0, 0.0, THICKNESS)
    return np.concatenate([vertices, below]), np.concatenate([faces, faces[:, ::-1] + len(vertices)])


def _scene_text(
    pixels: int,
    board_size: float,
    camera: Pose,
    size: tuple[int, int],
    vertical: float,
    light: float,
    specimen: tuple[NDArray[np.float64], NDArray[np.int64]] | None,
    tip: Tip,
) -> str:
    mesh = geom = ""
    plate, middle = 0.5 * board_size + 0.03, 0.0
    if specimen is not None:
        points, faces = _solid(specimen)
        corners = " ".join(map(str, faces.ravel()))
        mesh = f'<mesh name="specimen" inertia="shell" vertex="{_numbers(points)}" face="{corners}"/>'
        geom = '<geom name="specimen" type="mesh" mesh="specimen" rgba="0.35 0.7 0.9 1"/>'
        right = float(points[:, 0].max())
        plate, middle = 0.5 * (right + plate) + 0.005, 0.5 * (right - plate)
    x, y = camera.rotation[:, 0], -camera.rotation[:, 1]  # MuJoCo's camera looks along -z with y up
    half = 0.5 * board_size
    rod = min(ROD_RADIUS, ROD_RADIUS / TIP_RADIUS * tip.radius)  # a small ball has a thin rod
    return f"""
<mujoco model="foretouch camera">
  <option><flag contact="disable"/></option>
  <statistic extent="1" center="0 0 0"/>
  <visual>
    <global offwidth="{size[0]}" offheight="{size[1]}"/>
    <quality shadowsize="0" offsamples="4"/>
    <map znear="{NEAREST}" zfar="{FARTHEST}"/>
    <headlight ambient="{light} {light} {light}" diffuse="0.3 0.3 0.3" specular="0 0 0"/>
  </visual>
  <asset>
    <texture name="board" type="2d" builtin="flat" width="{pixels}" height="{pixels}" rgb1="1 1 1"/>
    {mesh}
    <material name="board" texture="board" texuniform="false" texrepeat="1 1" specular="0" shininess="0"/>
  </asset>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <camera name="camera" pos="{_numbers(camera.translation)}" xyaxes="{_numbers([x, y])}"
            fovy="{math.degrees(vertical):.9g}"/>
    <geom name="table" type="box" size="0.4 0.4 0.01" pos="0 0 -0.12" rgba="0.45 0.47 0.5 1"/>
    <body name="fixture" mocap="true">
      <geom name="block" type="box" size="{plate} {half + 0.03} 0.01" pos="{middle} 0 -0.0125" rgba="0.9 0.72 0.45 1"/>
      {geom}
      <geom name="board" type="plane" size="{half} {half} 0.01" material="board"/>
    </body>
    <body name="probe" mocap="true">
      <geom type="capsule" size="{rod}" fromto="0 0 {tip.centre} 0 0 {ROD_LENGTH}" rgba="0.8 0.82 0.85 1"/>
      <geom type="sphere" size="{tip.radius}" pos="0 0 {tip.centre}" rgba="0.85 0.25 0.2 1"/>
    </body>
  </worldbody>
</mujoco>
"""
