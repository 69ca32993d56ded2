"""Where a film's camera stands, against MuJoCo's own free camera and the scene's cameras."""

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highfive.hil.sim.scene import Scene, build_scene
from highfive.hil.sim.viewpoint import BETWEEN, CAMERAS, HANDS, NEAR, viewpoint
from highfive.model.errors import HighFiveError


@pytest.fixture(scope="module")
def scene() -> Scene:
    """One of this file's own: its camera is moved."""
    return build_scene(visible=True)


def placed(scene: Scene, text: str) -> tuple[np.ndarray, np.ndarray]:
    """Place and axes of the camera ``wide``, which is put back afterwards."""
    model, data = scene.model, scene.make_data()
    kept = [values.copy() for values in (model.cam_pos, model.cam_quat, model.cam_fovy)]
    viewpoint(text).apply(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    wide = model.camera("wide").id
    found = data.cam_xpos[wide].copy(), data.cam_xmat[wide].reshape(3, 3).copy()
    for values, before in zip((model.cam_pos, model.cam_quat, model.cam_fovy), kept, strict=True):
        values[:] = before
    return found


@given(st.floats(-360.0, 360.0), st.floats(-60.0, 5.0), st.floats(0.5, 8.0))
@pytest.mark.slow
def test_it_stands_where_mujocos_free_camera_does(
    scene: Scene, azimuth: float, elevation: float, distance: float
) -> None:
    place, axes = placed(scene, f"{azimuth},{elevation},{distance}")
    camera, drawn = mujoco.MjvCamera(), mujoco.MjvScene(scene.model, 100)
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.lookat[:], camera.azimuth, camera.elevation, camera.distance = BETWEEN, azimuth, elevation, distance
    mujoco.mjv_updateCamera(scene.model, scene.make_data(), camera, drawn)
    np.testing.assert_allclose(place, np.mean([eye.pos for eye in drawn.camera], axis=0), atol=1e-5)
    np.testing.assert_allclose(-axes[:, 2], drawn.camera[0].forward, atol=1e-6)
    np.testing.assert_allclose(axes[:, 1], drawn.camera[0].up, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("text", ["front", "60,-15,2.5"])
def test_the_close_camera_looks_at_the_hands_in_the_same_direction(text: str) -> None:
    scene = build_scene(visible=True)
    viewpoint(text).apply(scene.model)
    data, model = scene.make_data(), scene.model
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    wide, close = model.camera("wide").id, model.camera("close").id
    np.testing.assert_allclose(data.cam_xmat[close], data.cam_xmat[wide], atol=1e-9)
    right, up, back = (data.cam_xmat[close].reshape(3, 3).T @ (HANDS - data.cam_xpos[close])).tolist()
    assert abs(right) < 1e-9 and abs(up) < 1e-9 and back == pytest.approx(-NEAR)


@pytest.mark.parametrize("name", CAMERAS)
def test_a_name_is_one_of_the_scenes_cameras(scene: Scene, name: str) -> None:
    data, other = scene.make_data(), scene.model.camera(name).id
    mujoco.mj_kinematics(scene.model, data)
    mujoco.mj_camlight(scene.model, data)
    place, axes = placed(scene, name)
    np.testing.assert_array_equal(place, data.cam_xpos[other])
    np.testing.assert_array_equal(axes.ravel(), data.cam_xmat[other])


@pytest.mark.parametrize(
    "text", ["side", "90", "90,-10", "90,-10,x", "nan,0,3", "0,nan,3", "0,0,nan", "0,30,9", "0,0,0"]
)
def test_what_is_no_view_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(HighFiveError, match="view"):
        viewpoint(text)
