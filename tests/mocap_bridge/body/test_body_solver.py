from dataclasses import replace

import numpy as np
import pytest

from highfive.hil.sim.avatar import avatar_skeleton
from highfive.mocap_bridge.body.body_solver import solve_body
from highfive.mocap_bridge.body.kinematic_part import forward, jacobian, make_part
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations

SKELETON = avatar_skeleton()
FULL = load_marker_set("full_body")


def movement(frames=60, seed=0, extent=0.6):
    """Root (T, 3) and hinge angles (T, 53, 3) of a smooth movement through most of the range of every joint."""
    rng = np.random.default_rng(seed)
    time = np.arange(frames)[:, None, None] / 120.0
    low, high = SKELETON.hinge_limits[..., 0], SKELETON.hinge_limits[..., 1]
    phase, rate = rng.uniform(0.0, 2 * np.pi, low.shape), rng.uniform(0.5, 2.0, low.shape)
    angles = 0.5 * (low + high) + 0.5 * extent * (high - low) * np.sin(phase + rate * time)
    angles[:, 0] = [2.9, 0.05, 0.1]
    angles[:, 0, 0] += 2.0 * time[:, 0, 0]  # through the turn of pi
    root = np.column_stack([1.0 + 0.2 * time[:, 0, 0], 0.1 * time[:, 0, 0], np.full(frames, 0.9)])
    return root, angles


def markers_of(marker_set, root, angles, skeleton=SKELETON):
    return marker_set.simulate(skeleton, *skeleton.forward_kinematics(root, skeleton.from_hinges(angles)))


def angle_errors(found, angles):
    truth = SKELETON.from_hinges(angles)
    return np.degrees(
        np.linalg.norm(rotations.to_rotation_vector(rotations.multiply(rotations.conjugate(truth), found)), axis=-1)
    )


def test_the_jacobian_is_the_derivative_of_the_markers():
    part = make_part(SKELETON, FULL, [j for j in range(len(SKELETON)) if j < 23])
    rng = np.random.default_rng(1)
    x = rng.normal(scale=0.4, size=(3, part.parameters))
    upright = np.tile(np.eye(3), (3, 1, 1))

    def markers(parameters):
        return forward(part, parameters[:, :-3], parameters[:, -3:], upright).markers

    analytic = jacobian(part, forward(part, x[:, :-3], x[:, -3:], upright))
    step = 1e-6
    for column in range(part.parameters):
        shift = np.zeros_like(x)
        shift[:, column] = step
        numeric = (markers(x + shift) - markers(x - shift)) / (2 * step)
        np.testing.assert_allclose(analytic[..., column].transpose(0, 2, 1), numeric, atol=1e-8)


def test_its_kinematics_are_the_skeletons():
    root, angles = movement(5)
    part = make_part(SKELETON, FULL, list(range(len(SKELETON))))
    own = forward(part, angles.reshape(5, -1), root, np.tile(np.eye(3), (5, 1, 1)))
    positions, orientations = SKELETON.forward_kinematics(root, SKELETON.from_hinges(angles))
    np.testing.assert_allclose(own.positions, positions, atol=1e-12)
    np.testing.assert_allclose(own.rotations, rotations.to_matrix(orientations), atol=1e-12)
    np.testing.assert_allclose(own.markers, markers_of(FULL, root, angles), atol=1e-12)


def test_clean_markers_give_back_the_body():
    root, angles = movement()
    points = markers_of(FULL, root, angles)
    solution = solve_body(SKELETON, FULL, points, np.ones(points.shape[:2], dtype=bool))
    assert angle_errors(solution.quaternions, angles)[:, :23].max() < 0.5
    np.testing.assert_allclose(solution.root, root, atol=1e-4)
    assert solution.rms.max() < 0.001
    # A finger's two markers tell how far it is bent in all, though not how each bone is twisted.
    tips = [
        SKELETON.index(f"{side}_{f}_3") for side in ("left", "right") for f in ("index", "middle", "ring", "little")
    ]
    found, _ = SKELETON.forward_kinematics(solution.root, solution.quaternions)
    truth, _ = SKELETON.forward_kinematics(root, SKELETON.from_hinges(angles))
    assert np.linalg.norm(found[:, tips] - truth[:, tips], axis=-1).max() < 0.012


def test_noise_occlusions_and_swapped_labels_do_not_bend_the_body():
    root, angles = movement()
    rng = np.random.default_rng(0)
    points = markers_of(FULL, root, angles) + rng.normal(scale=0.001, size=(60, len(FULL), 3))
    valid = rng.random(points.shape[:2]) > 0.1
    swap = FULL.indices(["RASI", "LUPA"])
    points[10:14, swap] = points[10:14, swap[::-1]]
    solution = solve_body(SKELETON, FULL, points, valid)
    centres, _ = SKELETON.forward_kinematics(solution.root, solution.quaternions)
    truth, _ = SKELETON.forward_kinematics(root, SKELETON.from_hinges(angles))
    error = np.linalg.norm(centres - truth, axis=-1)[:, :23]
    assert np.sqrt((error**2).mean()) < 0.003
    assert error.max() < 0.03
    assert (solution.residuals[~valid] == 0.0).all()


def test_limits_hold_even_if_the_markers_ask_for_more():
    root, angles = movement(24)
    angles[:, SKELETON.index("right_elbow"), 0] = 1.0  # an elbow bent backwards
    points = markers_of(FULL, root, angles)
    solution = solve_body(SKELETON, FULL, points, np.ones(points.shape[:2], dtype=bool))
    hinges = SKELETON.to_hinges(solution.quaternions)[:, 1:]
    limits = SKELETON.hinge_limits[1:]
    assert (hinges >= limits[..., 0] - 1e-9).all()
    assert (hinges <= limits[..., 1] + 1e-9).all()


def test_joints_without_markers_stay_at_rest():
    body = replace_markers(FULL, [m for m, joint in enumerate(FULL.joints) if not joint.startswith("right_")])
    root, angles = movement(24)
    points = markers_of(body, root, angles)
    solution = solve_body(SKELETON, body, points, np.ones(points.shape[:2], dtype=bool))
    right_arm = [SKELETON.index(f"right_{joint}") for joint in ("shoulder", "elbow", "wrist", "thumb_1", "index_2")]
    rest = np.broadcast_to(SKELETON.rest[right_arm], (24, len(right_arm), 4))
    np.testing.assert_allclose(solution.quaternions[:, right_arm], rest, atol=1e-9)


def replace_markers(marker_set, keep):
    """The set with some markers only, for a body solve that needs no arm."""
    return replace(
        marker_set,
        names=tuple(marker_set.names[m] for m in keep),
        aliases=tuple(marker_set.aliases[m] for m in keep),
        joints=tuple(marker_set.joints[m] for m in keep),
        local_positions=marker_set.local_positions[keep],
    )


def test_turning_the_world_turns_the_pelvis_alone():
    root, angles = movement(24)
    points = markers_of(FULL, root, angles)
    seen = np.ones(points.shape[:2], dtype=bool)
    turn, shift = rotations.from_axis_angle("z", 0.9), np.array([2.0, -1.0, 0.2])
    here = solve_body(SKELETON, FULL, points, seen)
    there = solve_body(SKELETON, FULL, rotations.rotate(turn, points) + shift, seen)
    np.testing.assert_allclose(there.root, rotations.rotate(turn, here.root) + shift, atol=1e-4)
    same = np.abs(np.sum(there.quaternions[:, 1:23] * here.quaternions[:, 1:23], axis=-1))
    assert np.degrees(2 * np.arccos(np.clip(same, 0, 1))).max() < 0.3


def test_a_recording_that_shows_nothing_is_refused():
    points = np.zeros((30, len(FULL), 3))
    with pytest.raises(HighFiveError, match="only 0 of 30 frames"):
        solve_body(SKELETON, FULL, points, np.zeros(points.shape[:2], dtype=bool))
