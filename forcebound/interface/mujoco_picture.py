"""Pictures of a MuJoCo scene, drawn off the screen by OpenGL: on a graphics card or in software."""

import os
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forcebound.errors import ConfigError
from forcebound.haptics.environments.mujoco_scene import listed

MOST_GEOMS = 10_000  # in a picture


class Painter:
    """Draws a compiled scene, ``width`` times ``height`` pixels.

    It draws by EGL, which needs no screen, unless the variable MUJOCO_GL chooses, as for MuJoCo.

    Raises:
        ConfigError: If nothing draws here, with what to install; or the scene has no such camera.
    """

    def __init__(self, scene: Any, width: int, height: int, camera: str | None) -> None:
        self._mujoco = mujoco = import_module("mujoco")
        self.signature = scene.signature  # of what was compiled
        self._camera = mujoco.MjvCamera()
        mujoco.mjv_defaultFreeCamera(scene, self._camera)
        if camera is not None:
            known = [scene.camera(i).name for i in range(scene.ncam)]
            if camera not in known:
                expected = (
                    "camera: expected None, for a view of all, or the name of one in the scene"
                )
                raise ConfigError(f"{expected}, got {camera!r}; known: {listed(known)}")
            self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
            self._camera.fixedcamid = known.index(camera)
        scene.vis.global_.offwidth, scene.vis.global_.offheight = width, height
        try:
            place = "mujoco" if os.environ.get("MUJOCO_GL") else "mujoco.egl"
            self._gl = import_module(place).GLContext(width, height)
            self._gl.make_current()
            self._context = mujoco.MjrContext(scene, mujoco.mjtFontScale.mjFONTSCALE_100)
        except Exception as error:  # of PyOpenGL, a driver or MuJoCo
            raise ConfigError(
                f"render_mode rgb_array: no OpenGL draws here ({type(error).__name__}: {error});"
                " expected PyOpenGL and a driver for EGL: pip install pyopengl, apt install libegl1"
                " libgl1-mesa-dri (which draws without a graphics card); or set MUJOCO_GL=osmesa,"
                " apt install libosmesa6"
            ) from error
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._drawn = mujoco.MjvScene(scene, MOST_GEOMS)
        self._frame = mujoco.MjrRect(0, 0, width, height)

    def picture(self, scene: Any, data: Any) -> NDArray[np.uint8]:
        """Return the scene as it is, red, green and blue from 0 to 255, (height, width, 3)."""
        mujoco, frame = self._mujoco, self._frame
        pixels = np.empty((frame.height, frame.width, 3), np.uint8)
        how = mujoco.MjvOption(), None, self._camera, mujoco.mjtCatBit.mjCAT_ALL
        self._gl.make_current()  # another one may have drawn
        mujoco.mjv_updateScene(scene, data, *how, self._drawn)
        mujoco.mjr_render(frame, self._drawn, self._context)
        mujoco.mjr_readPixels(pixels, None, frame, self._context)
        return pixels[::-1].copy()

    def close(self) -> None:
        """Give memory of the graphics card back."""
        self._gl.make_current()
        self._context.free()
        self._gl.free()
