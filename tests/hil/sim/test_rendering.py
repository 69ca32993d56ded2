import mujoco
import numpy as np
import pytest
from scene_helpers import RAISED, person_with_palm, pose_of

from highfive.hil.sim.rendering import CAMERAS, NoPictures, open_renderer
from highfive.hil.sim.scene import build_scene
from highfive.model.errors import HighFiveError


@pytest.fixture(scope="module")
def scene():
    return build_scene(visible=True)


@pytest.fixture(scope="module")
def renderer(scene):
    opened = open_renderer(scene, 160, 121, shadows=False, smooth=False)
    if isinstance(opened, NoPictures):
        pytest.skip(opened.reason)
    yield opened
    opened.close()


def picture(scene, renderer, degrees, camera):
    data = scene.make_data()
    scene.set_pose(data, pose_of(scene.skeleton, degrees))
    scene.set_person(data, person_with_palm([0.55, 0.0, 1.5], [-1.0, 0.0, 0.0]))
    mujoco.mj_kinematics(scene.model, data)
    return renderer.render(data, camera).astype(int)


def share_like(image, colour, tolerance=0.08):
    """Fraction of pixels with the hue of ``colour``, whatever the light."""
    hue = image / np.maximum(image.sum(axis=-1, keepdims=True), 1)
    return np.mean(np.abs(hue - np.array(colour) / np.sum(colour)).max(axis=-1) < tolerance)


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.slow
def test_every_camera_sees_both_people(scene, renderer, camera):
    image = picture(scene, renderer, RAISED, camera)
    assert image.shape == (121, 160, 3)
    assert image.std() > 20.0
    assert share_like(image, (0.16, 0.42, 0.50)) > 0.01  # the avatar's shirt
    assert share_like(image, (0.88, 0.62, 0.26)) > 0.01  # the person's


def test_a_raised_arm_changes_the_picture(scene, renderer):
    assert np.abs(picture(scene, renderer, RAISED, "wide") - picture(scene, renderer, {}, "wide")).max() > 60


def test_an_unknown_camera_is_named(scene, renderer):
    with pytest.raises(HighFiveError, match="shoulder"):
        renderer.render(scene.make_data(), "attic")


def test_looks_weigh_and_touch_nothing(scene):
    plain = build_scene().model
    np.testing.assert_array_equal(scene.model.body_mass, plain.body_mass)
    np.testing.assert_array_equal(scene.model.body_inertia, plain.body_inertia)
    assert scene.model.npair == plain.npair
    assert scene.model.nskin > 0
