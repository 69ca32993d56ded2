import numpy as np
import pytest

from highfive.hil.sim.avatar import avatar_skeleton
from highfive.hil.sim.dressing import avatar_bind
from highfive.hil.sim.sculpt import FAR, distance, sculpt, surface_nets
from highfive.scenes import appearance
from highfive.scenes.appearance import Part, ball


def volume(vertices, faces):
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0


def test_a_sampled_sphere_becomes_a_closed_sphere_that_faces_outwards():
    step, radius = 0.05, 0.6
    axis = np.arange(-1.0, 1.0, step)
    grid = np.linalg.norm(np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1), axis=-1) - radius
    vertices, faces = surface_nets(grid, np.full(3, -1.0), step)
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), radius, atol=0.1 * step)
    assert volume(vertices, faces) == pytest.approx(4.0 / 3.0 * np.pi * radius**3, rel=0.01)
    assert len(vertices) - len(faces) // 2 == 2  # Euler's formula for a closed surface without holes


@pytest.fixture(scope="module")
def pose():
    return avatar_bind(avatar_skeleton())


def test_sculpting_a_ball_gives_its_radius(pose):
    surface = sculpt(Part("ball", "skin", (ball("head", (0.0, 0.0, 0.1), 0.08),), step=0.01), pose)
    centre = pose.world((0.0, 0.0, 0.1), "head")
    np.testing.assert_allclose(np.linalg.norm(surface.vertices - centre, axis=1), 0.08, atol=1e-4)
    head = pose.skeleton.index("head")
    np.testing.assert_array_equal(surface.weights[:, head], 1.0)


@pytest.mark.parametrize("name", ["shirt", "left_hand", "head", "hair"])
def test_parts_are_closed_smooth_and_follow_their_joints(pose, name):
    part = next(p for p in appearance.parts(appearance.AVATAR) if p.name == name)
    surface = sculpt(part, pose)
    edges = np.sort(
        np.concatenate([surface.faces[:, [0, 1]], surface.faces[:, [1, 2]], surface.faces[:, [2, 0]]]), axis=1
    )
    _, count = np.unique(edges, axis=0, return_counts=True)
    assert np.all(count % 2 == 0)  # no open edge
    assert volume(surface.vertices, surface.faces) > 0.0
    np.testing.assert_allclose(surface.weights.sum(axis=1), 1.0)
    assert np.quantile(np.abs(distance(surface.vertices, part, pose)), 0.95) < 0.1 * part.step
    assert np.abs(surface.vertices).max() < FAR


def test_a_finger_does_not_move_its_neighbour(pose):
    part = next(p for p in appearance.parts(appearance.AVATAR) if p.name == "left_hand")
    weights = sculpt(part, pose).weights
    index, middle = (pose.skeleton.index(f"left_{finger}_3") for finger in ("index", "middle"))
    assert np.all(np.minimum(weights[:, index], weights[:, middle]) == 0.0)
    assert weights[:, index].max() > 0.95
