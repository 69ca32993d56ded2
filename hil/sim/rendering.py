"""Pictures of the scene without a window, where the machine has OpenGL."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from highfive.hil.sim import opengl
from highfive.hil.sim.arm_body import ArmTwin
from highfive.hil.sim.scene import Scene
from highfive.hil.sim.viewpoint import CAMERAS
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

Image = NDArray[np.uint8]


@dataclass(frozen=True)
class NoPictures:
    """Why no pictures can be made here, in one line."""

    reason: str


class Renderer:
    """Draws a scene from its cameras; close it, or use it in ``with``."""

    def __init__(
        self, scene: Scene | ArmTwin, width: int, height: int, *, shadows: bool = True, smooth: bool = True
    ) -> None:
        """Opens a drawing context of ``width`` × ``height`` pixels.

        Args:
            scene: built with ``visible=True``.
            width, height: pixels.
            shadows: cast shadows; a software renderer is some five times as fast without.
            smooth: four samples a pixel, smooth edges; without, up to twice as fast.
        """
        self._scene = scene
        model = scene.model
        model.vis.global_.offwidth = max(int(model.vis.global_.offwidth), width)
        model.vis.global_.offheight = max(int(model.vis.global_.offheight), height)
        model.vis.quality.offsamples = 4 if smooth else 0
        self._renderer = mujoco.Renderer(model, height, width)
        self._renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shadows
        self._option = mujoco.MjvOption()
        self._option.geomgroup[3] = 0
        self._option.sitegroup[:] = 0

    def render(self, data: mujoco.MjData, camera: str = "wide", shift: Array | None = None) -> Image:
        """Picture (height, width, 3) of the state, which needs ``mujoco.mj_kinematics`` or a forward call before.

        Args:
            data: the state.
            camera: one of the scene's.
            shift: (3,) m, of the camera from its place, which ``data.cam_xpos`` has afterwards.

        Raises:
            HighFiveError: there is no such camera.
        """
        if camera not in CAMERAS:
            raise HighFiveError(f"no camera called {camera!r}; the scene has {', '.join(CAMERAS)}")
        mujoco.mj_camlight(self._scene.model, data)
        if shift is not None:
            data.cam_xpos[self._scene.model.camera(camera).id] += shift
        self._renderer.update_scene(data, camera, self._option)
        return self._renderer.render()

    def close(self) -> None:
        """Frees the drawing context."""
        self._renderer.close()

    def __enter__(self) -> Renderer:
        """Self."""
        return self

    def __exit__(self, *_: object) -> None:
        """Frees the drawing context."""
        self.close()


def open_renderer(
    scene: Scene | ArmTwin, width: int, height: int, *, shadows: bool = True, smooth: bool = True
) -> Renderer | NoPictures:
    """A renderer of ``width`` × ``height`` pixels, or why there are none; lack of OpenGL is no error."""
    if opengl.NO_PICTURES:
        return NoPictures(f"pictures left out: {opengl.NO_PICTURES}")
    try:
        return Renderer(scene, width, height, shadows=shadows, smooth=smooth)
    except Exception as error:
        # Each backend fails with exceptions of its own, and pictures are never worth a session.
        detail = " ".join(str(error).split())[:200]
        return NoPictures(f"pictures left out: OpenGL does not start ({type(error).__name__}: {detail})")
