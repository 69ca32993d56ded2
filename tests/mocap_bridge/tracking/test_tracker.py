import functools
import itertools
from dataclasses import replace

import numpy as np
import pytest
from simulated_reach import arm_angles

from highfive.hil.sim.avatar import avatar_skeleton
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.tracking.filter_settings import NEVER, FilterSettings
from highfive.mocap_bridge.tracking.human_arm import HumanArmEstimator
from highfive.mocap_bridge.tracking.joint_angles import ANGLES, angles_between
from highfive.mocap_bridge.tracking.tracker import RestartSettings, Tracker
from highfive.model.geometry import rotations

SKELETON = avatar_skeleton()
PAPER = load_marker_set("paper")
NOTHING = np.zeros((0, 3))
HAND = PAPER.indices(["RFIN", "RMC5"])


def reaching(frames=480):
    """Markers (T, 16, 3) of a person who raises and lowers the right arm four times in 8 s."""
    time = np.arange(frames) / 120.0
    lift = 0.5 - 0.5 * np.cos(2 * np.pi * time / 2.0)
    angles = arm_angles(SKELETON, lift, forward=-1.6, outward=-0.2)
    angles[:, SKELETON.index("head"), 1] = 0.2 * np.sin(time)
    root = np.stack([1.0 + 0.03 * np.sin(1.3 * time), 0.02 * np.sin(time), np.full(frames, 0.93)], axis=-1)
    return PAPER.simulate(SKELETON, *SKELETON.forward_kinematics(root, SKELETON.from_hinges(angles)))


TRUTH = reaching()
NOISY = TRUTH + np.random.default_rng(5).normal(scale=0.001, size=TRUTH.shape)


def frame(points, number, valid=None, unlabelled=NOTHING, names=PAPER.names):
    valid = np.ones(len(points), dtype=bool) if valid is None else valid
    return MarkerFrame(names, points, valid, number, round(number * 1e9 / 120), 0, unlabelled)


def follow(points, valid=None, unlabelled=None):
    tracker = Tracker(PAPER)
    shown = np.ones(points.shape[:2], dtype=bool) if valid is None else valid
    extra = [NOTHING] * len(points) if unlabelled is None else unlabelled
    return [tracker.update(frame(points[k], k, shown[k], extra[k])) for k in range(len(points))]


def errors(tracked):
    return np.linalg.norm(np.array([t.positions for t in tracked]) - TRUTH[: len(tracked)], axis=-1)


def test_seen_markers_are_smoothed_not_spoilt():
    error = errors(follow(NOISY))[20:]
    assert np.sqrt((error**2).mean()) < np.sqrt(3) * 0.001


def test_innovations_are_about_as_large_as_predicted():
    """Normalised innovation squared: mean near its dimension, 3, on noise of the size that the tracker assumes."""
    points = TRUTH + np.random.default_rng(1).normal(scale=FilterSettings().marker_sigma, size=TRUTH.shape)
    tracker = Tracker(PAPER)
    squared = []
    for k in range(len(points)):
        if k >= 60 and k % 4 == 0:  # a frame without measurements shows the prediction
            one = np.ones(16, dtype=bool)
            marker = (k // 4) % 16
            one[marker] = False
            tracked = tracker.update(frame(points[k], k, one))
            innovation = points[k, marker] - tracked.positions[marker]
            covariance = tracked.covariances[marker] + FilterSettings().marker_sigma ** 2 * np.eye(3)
            squared.append(innovation @ np.linalg.solve(covariance, innovation))
        else:
            tracker.update(frame(points[k], k))
    assert 0.3 < np.mean(squared) / 3.0 < 1.5
    assert np.mean(np.array(squared) > 16.3) < 0.03  # the 99.9 % quantile


def hidden_hand():
    valid = np.ones(TRUTH.shape[:2], dtype=bool)
    for start in range(60, len(TRUTH) - 40, 70):
        valid[start : start + 36, HAND] = False  # 300 ms
    return valid


def held(valid):
    out = NOISY.copy()
    for k in range(1, len(out)):
        out[k] = np.where(valid[k][:, None], NOISY[k], out[k - 1])
    return np.linalg.norm(out - TRUTH, axis=-1)


def test_a_hidden_hand_follows_from_the_forearm():
    valid = hidden_hand()
    tracked = follow(NOISY, valid)
    ours = errors(tracked)[~valid]
    assert np.sqrt((ours**2).mean()) < 0.2 * np.sqrt((held(valid)[~valid] ** 2).mean())
    assert np.sqrt((ours**2).mean()) < 0.025
    reported = np.array([t.valid for t in tracked])
    assert reported[~valid].mean() > 0.9


def test_the_covariance_owns_up_to_the_error_of_hidden_markers():
    valid = hidden_hand()
    tracked = follow(NOISY, valid)
    spread = np.sqrt(np.array([np.trace(t.covariances, axis1=1, axis2=2) for t in tracked]))
    ratio = errors(tracked)[~valid] / spread[~valid]
    assert np.sqrt((ratio**2).mean()) < 2.5
    assert (spread[~valid] > spread[valid].mean()).all()


def test_age_and_seen_tell_when_a_marker_was_measured():
    valid = hidden_hand()
    tracked = follow(NOISY, valid)
    np.testing.assert_array_equal(np.array([t.seen for t in tracked]), valid)
    assert tracked[95].age_ns[HAND[0]] == round(95e9 / 120) - round(59e9 / 120)
    assert (tracked[59].age_ns == 0).all()


def test_one_frame_outliers_and_ghosts_move_nothing():
    rng = np.random.default_rng(2)
    points, ghosts, wrong = NOISY.copy(), [], 0
    for k in range(len(points)):
        ghosts.append(points[k, rng.integers(16, size=3)] + rng.normal(scale=0.5, size=(3, 3)))
        if k > 30 and k % 7 == 0:
            points[k, rng.integers(16)] += rng.normal(size=3) + 0.2
            wrong += 1
    tracked = follow(points, unlabelled=ghosts)
    clean = follow(NOISY)
    assert sum(t.rejected.sum() for t in tracked) == pytest.approx(wrong, abs=2)
    shift = [np.linalg.norm(a.positions - b.positions, axis=-1).max() for a, b in zip(tracked, clean, strict=True)]
    assert max(shift) < 0.02


def test_swapped_labels_are_put_right():
    points = NOISY.copy()
    swap = PAPER.indices(["RWRA", "RFIN"])
    points[100:110, swap] = points[100:110, swap[::-1]]
    tracked = follow(points)
    assert errors(tracked)[95:130].max() < 0.01
    assert all(t.rejected.sum() == 2 for t in tracked[100:110])


def test_a_lost_label_is_taken_up_from_the_unlabelled_points():
    valid = np.ones(TRUTH.shape[:2], dtype=bool)
    valid[100:140, HAND[0]] = False
    loose = [NOISY[k, HAND[:1]] if 100 <= k < 140 else NOTHING for k in range(len(NOISY))]
    tracked = follow(NOISY, valid, loose)
    assert all(t.seen[HAND[0]] for t in tracked[100:140])
    assert errors(tracked)[100:140].max() < 0.005


def test_it_recovers_by_itself_when_everything_jumps():
    points = NOISY.copy()
    points[200:] += [0.5, 0.0, 0.0]
    tracked = follow(points)
    after = np.linalg.norm(tracked[-1].positions - TRUTH[-1] - [0.5, 0.0, 0.0], axis=-1)
    assert after.max() < 0.01
    late = np.linalg.norm(tracked[240].positions - TRUTH[240] - [0.5, 0.0, 0.0], axis=-1)
    assert late.max() < 0.02


def test_labels_may_come_in_any_order_and_change_it():
    tracker, order = Tracker(PAPER), np.arange(16)
    rng = np.random.default_rng(0)
    for k in range(40):
        if k % 5 == 0:
            order = rng.permutation(16)
        names = tuple(PAPER.names[m] for m in order)
        tracked = tracker.update(frame(NOISY[k][order], k, names=names))
    assert np.linalg.norm(tracked.positions - TRUTH[39], axis=-1).max() < 0.005
    assert tracked.names == PAPER.names


def test_moving_the_world_moves_the_output():
    """Any shift, and any turn about the vertical: what is upright is expected to stay so."""
    turn, shift = rotations.from_axis_angle("z", 2.3), np.array([3.0, -1.0, 0.4])
    valid = hidden_hand()[:130]
    here = follow(NOISY[:130], valid)
    there = follow(rotations.rotate(turn, NOISY[:130]) + shift, valid)
    matrix = rotations.to_matrix(turn)
    for a, b in zip(here[::10], there[::10], strict=True):
        np.testing.assert_allclose(b.positions, rotations.rotate(turn, a.positions) + shift, atol=1e-4)
        np.testing.assert_allclose(b.covariances, matrix @ a.covariances @ matrix.T, atol=1e-6)


def test_a_marker_that_is_not_worn_is_put_where_the_set_has_it_and_unknown_names_are_ignored():
    names = (*PAPER.names[:15], "SPARE")
    tracker = Tracker(PAPER)
    for k in range(30):
        tracked = tracker.update(frame(NOISY[k], k, names=names))
    assert tracked.valid.all() and HumanArmEstimator(PAPER)(tracked).valid
    assert not tracked.seen[15] and tracked.age_ns[15] == NEVER
    assert np.linalg.norm(tracked.positions[15] - TRUTH[29, 15]) < 0.04
    spread = np.sqrt(np.trace(tracked.covariances, axis1=1, axis2=2))
    assert spread[15] > 4.0 * spread[:15].max()


@pytest.mark.parametrize("late", [("RWRA", "RWRB"), ("RFIN", "RMC5"), ("RWRA", "RWRB", "RFIN", "RMC5", "RFRM")])
def test_markers_that_come_late_leave_no_trace_in_the_angles(late):
    shown = np.ones(NOISY.shape[:2], dtype=bool)
    shown[:60, PAPER.indices(list(late))] = False
    angles = []
    for valid in (np.ones_like(shown), shown):
        tracker = Tracker(PAPER)
        for k in range(240):
            tracker.update(frame(NOISY[k], k, valid[k]))
        assert tracker.arm_angles is not None
        angles.append(tracker.arm_angles.angles[3:])  # elbow and wrist
    away = (angles[1] - angles[0] + np.pi) % (2.0 * np.pi) - np.pi
    assert np.degrees(np.abs(away)).max() < 3.0


@pytest.mark.parametrize("first", range(3))
def test_labels_that_are_swapped_in_the_first_frame_do_no_lasting_harm(first):
    for swap in list(itertools.combinations(range(16), 2))[first::6]:
        points = NOISY[:30].copy()
        points[0, list(swap)] = points[0, list(swap[::-1])]
        away = errors(follow(points))[6:, [*PAPER.indices(["RWRA", "RWRB"]), *HAND]]
        assert away.max() < 0.02, [PAPER.names[m] for m in swap]


def test_frames_without_any_label_are_gaps():
    tracker, none = Tracker(PAPER), np.zeros(0, dtype=bool)
    assert not tracker.update(frame(NOTHING, 0, none, names=())).valid.any()
    tracker.update(frame(NOISY[1], 1))
    assert tracker.update(frame(NOTHING, 2, none, names=())).valid.all()


def test_bad_numbers_and_bad_times_do_no_lasting_harm():
    tracker = Tracker(PAPER)
    for k in range(60):
        points = NOISY[k].copy()
        if k % 10 == 5:
            points[3] = np.nan
        stamp = frame(points, k)
        if k == 30:
            stamp = replace(stamp, source_time_ns=stamp.source_time_ns - 50_000_000)
        tracked = tracker.update(stamp)
        assert np.isfinite(tracked.positions).all()
    assert np.linalg.norm(tracked.positions - TRUTH[59], axis=-1).max() < 0.01


def test_a_reset_tracker_is_a_new_one():
    used, fresh = Tracker(PAPER), Tracker(PAPER)
    for k in range(50):
        used.update(frame(NOISY[k], k))
    used.reset()
    for k in range(100, 150):
        a, b = used.update(frame(NOISY[k], k)), fresh.update(frame(NOISY[k], k))
    np.testing.assert_array_equal(a.positions, b.positions)
    np.testing.assert_array_equal(a.covariances, b.covariances)


def palms(tracked):
    arm = HumanArmEstimator(PAPER)
    return np.array([arm(t).palm.position for t in tracked])


@functools.cache
def true_palms(frames):
    return palms(follow(TRUTH[:frames]))


def palm_jump(points, valid=None, unlabelled=None, frames=slice(20, 60)):
    """Largest step of the palm from frame to frame that the person did not make, and its largest error, m."""
    away = palms(follow(points[: frames.stop], valid, unlabelled))[frames] - true_palms(frames.stop)[frames]
    return np.linalg.norm(np.diff(away, axis=0), axis=1).max(), np.linalg.norm(away, axis=1).max()


@pytest.mark.slow
def test_no_swap_of_two_labels_moves_the_palm():
    for swap in itertools.combinations(range(16), 2):
        points = NOISY.copy()
        points[30:50, list(swap)] = points[30:50, list(swap[::-1])]
        jump, error = palm_jump(points)
        assert jump < 0.006 and error < 0.006, [PAPER.names[m] for m in swap]


@pytest.mark.parametrize("seed", range(3))
def test_ghosts_and_missing_markers_together_move_the_palm_little(seed):
    rng = np.random.default_rng(seed)
    points, shape = NOISY.copy(), NOISY.shape[:2]
    wrong = rng.random(shape) < 0.2
    wrong[:5] = False
    points[wrong] += rng.normal(scale=0.2, size=(wrong.sum(), 3))
    valid = rng.random(shape) > 0.3
    valid[:5] = True
    loose = [p[rng.integers(16, size=3)] + rng.normal(scale=0.1, size=(3, 3)) for p in NOISY]
    jump, error = palm_jump(points, valid[:160], loose, slice(20, 160))
    assert jump < 0.020 and error < 0.015


def test_a_hand_that_comes_back_fast_is_not_thrown_on():
    """Out of sight during the quickest part of a reach: seen again, it is where it is seen, now and afterwards."""
    quick = NOISY[::4]
    valid = np.ones(quick.shape[:2], dtype=bool)
    valid[20:40, PAPER.indices(["RWRA", "RWRB", "RFIN", "RMC5"])] = False
    error = np.linalg.norm(np.array([t.positions for t in follow(quick, valid)]) - TRUTH[::4], axis=-1)
    assert error[39].max() > 0.02  # it was not easy
    assert error[41:].max() < 0.01


def test_the_joint_angles_are_those_of_the_person():
    upper = load_marker_set("full_body")
    angles, skeleton = np.zeros((240, len(SKELETON), 3)), SKELETON
    time = np.arange(240) / 120.0
    lift = 0.5 - 0.5 * np.cos(2 * np.pi * time / 2.0)
    for joint, columns in (
        ("shoulder", (-0.3 - 1.4 * lift, -0.3 - 0.2 * lift, 0.3 * lift)),
        ("elbow", (-0.4 - 1.0 * lift, 0 * lift, -0.8 * lift)),
        ("wrist", (0.4 * lift, 0.1 * lift, 0 * lift)),
    ):
        angles[:, skeleton.index(f"right_{joint}")] = np.stack(columns, axis=-1)
    root = np.tile([1.0, 0.0, 0.93], (240, 1))
    positions, orientations = skeleton.forward_kinematics(root, skeleton.from_hinges(angles))
    points = upper.simulate(skeleton, positions, orientations)
    points = points + np.random.default_rng(0).normal(scale=0.001, size=points.shape)
    turns = rotations.to_matrix(orientations)
    segments = [skeleton.index(name) for name in ("thoracic_8", "right_shoulder", "right_elbow", "right_wrist")]
    tracker, wrong = Tracker(upper), []
    for k in range(240):
        tracker.update(
            MarkerFrame(upper.names, points[k], np.ones(len(upper), bool), k, round(k * 1e9 / 120), 0, NOTHING)
        )
        if k > 20:
            found = tracker.arm_angles
            assert found is not None
            away = found.angles - angles_between(*(np.ascontiguousarray(turns[k, s]) for s in segments))
            wrong.append((away + np.pi) % (2 * np.pi) - np.pi)
    rms = np.degrees(np.sqrt(np.mean(np.square(wrong), axis=0)))
    assert rms.max() < 0.7, dict(zip(ANGLES, rms.round(2), strict=True))


def test_angles_of_somebody_whose_markers_sit_elsewhere_lie_within_their_deviations():
    """Places and lengths off by what they differ from person to person: errors that no number of frames takes away."""
    upper = load_marker_set("plug_in_gait_upper")
    segments = [SKELETON.index(name) for name in ("thoracic_8", "right_shoulder", "right_elbow", "right_wrist")]
    normalised = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        angles = np.zeros((1, len(SKELETON), 3))
        angles[0, segments[1]], angles[0, segments[2]] = rng.uniform(-1.2, -0.4, 3) * [1, 0.5, -0.5], [-1.2, 0.0, -0.5]
        lengths = rng.normal(1.0, 0.07, 3)
        body = SKELETON.scaled(dict(zip(("right_shoulder", "right_elbow", "right_wrist"), lengths, strict=True)))
        positions, turned = body.forward_kinematics(np.array([[1.0, 0.0, 0.93]]), body.from_hinges(angles))
        worn = replace(
            upper, local_positions=upper.local_positions + rng.normal(size=(len(upper), 3)) * upper.spreads[:, None]
        )
        points = worn.simulate(body, positions, turned)[0]
        tracker = Tracker(upper)
        for k in range(60):
            noise = rng.normal(scale=0.001, size=points.shape)
            shown = np.ones(len(upper), bool)
            tracker.update(MarkerFrame(upper.names, points + noise, shown, k, round(k * 1e9 / 120), 0, NOTHING))
        found = tracker.arm_angles
        assert found is not None
        true = angles_between(*(np.ascontiguousarray(rotations.to_matrix(turned[0, s])) for s in segments))
        normalised.append(((found.angles - true + np.pi) % (2.0 * np.pi) - np.pi) / found.deviations)
    assert 0.3 < np.sqrt(np.mean(np.square(normalised))) < 1.6
    assert np.mean(np.abs(normalised) < 2.0) > 0.85


def ended(**settings):
    """The last frame of a hand that jumps by up to 4 cm in it."""
    tracker, points = Tracker(PAPER, **settings), TRUTH[:60].copy()
    points[-1, :, 2] += np.linspace(0.0, 0.04, points.shape[1])
    return [tracker.update(frame(one, number)) for number, one in enumerate(points)][-1]


def test_settings_reach_the_compiled_filter():
    usual = ended()
    strict = ended(settings=FilterSettings(slide=1e-6, first_step=1e-6, gate=1e-3, take_up_gate=1e-3))
    assert strict.rejected.sum() > usual.rejected.sum()
    assert not np.array_equal(ended(settings=FilterSettings(marker_sigma=0.01)).positions, usual.positions)


def test_settings_say_when_the_tracker_begins_anew():
    """A body that is suddenly elsewhere is followed there at once by a tracker without patience."""
    elsewhere = np.array([1.0, 0.0, 0.0])

    def frames_until_there(restart):
        tracker = Tracker(PAPER, restart=restart)
        for number, points in enumerate(TRUTH[:120]):
            tracker.update(frame(points, number))
        for number, points in enumerate(TRUTH[120:240]):
            if (
                np.abs(tracker.update(frame(points + elsewhere, 120 + number)).positions - points - elsewhere).max()
                < 0.05
            ):
                return number
        return 120

    assert frames_until_there(RestartSettings(lost_frames=1)) < frames_until_there(RestartSettings(lost_frames=30))


def follow_with(points, covariance, valid=None, unlabelled=None):
    tracker = Tracker(PAPER)
    shown = np.ones(points.shape[:2], dtype=bool) if valid is None else valid
    extra = [NOTHING] * len(points) if unlabelled is None else unlabelled
    return [
        tracker.update(replace(frame(points[k], k, shown[k], extra[k]), covariance=covariance))
        for k in range(len(points))
    ]


def test_a_covariance_that_is_the_settings_own_changes_nothing():
    """Hidden hands, swapped labels and points without a label: the two ways of saying the same noise agree."""
    points, valid, swap = NOISY[:200].copy(), hidden_hand()[:200], PAPER.indices(["RWRA", "RFIN"])
    points[100:110, swap] = points[100:110, swap[::-1]]
    loose = [NOISY[k, HAND[:1]] if k % 3 else NOTHING for k in range(200)]
    alike = np.tile(FilterSettings().marker_sigma ** 2 * np.eye(3), (16, 1, 1))
    for ours, usual in zip(follow_with(points, alike, valid, loose), follow(points, valid, loose), strict=True):
        np.testing.assert_allclose(ours.positions, usual.positions, atol=1e-9)
        np.testing.assert_allclose(ours.covariances, usual.covariances, atol=1e-11)
        np.testing.assert_array_equal(ours.seen, usual.seen)
        np.testing.assert_array_equal(ours.rejected, usual.rejected)


def test_a_point_that_is_known_in_two_directions_counts_for_these():
    """Depth off by 5 cm, the rest by 3 mm: told so, the tracker believes the points and is better in depth than they,
    and better in all directions than one that is told a single deviation between the two."""
    deviations = np.array([0.05, 0.003, 0.003])
    points = TRUTH + np.random.default_rng(4).normal(size=TRUTH.shape) * deviations
    told = follow_with(points, np.tile(np.diag(deviations**2), (16, 1, 1)))
    single = follow_with(points, np.tile(np.square(deviations).mean() * np.eye(3), (16, 1, 1)))
    ours = np.array([t.positions for t in told]) - TRUTH
    other = np.array([t.positions for t in single]) - TRUTH
    rms, other_rms = (np.sqrt(np.square(each[60:]).mean(axis=(0, 1))) for each in (ours, other))
    assert np.mean([t.rejected.sum() for t in told]) < 0.1
    assert rms[0] < 0.6 * deviations[0]
    assert (rms[1:] < 0.7 * other_rms[1:]).all()


def test_the_gate_is_as_wide_as_the_covariance_says_in_each_direction():
    """The same 8 cm beside the marker are believed along the direction that is not sure, not across it."""
    noise = np.tile(np.diag([0.05**2, 0.002**2, 0.002**2]), (16, 1, 1))
    for axis, believed in ((0, True), (1, False), (2, False)):
        tracker = Tracker(PAPER)
        for k in range(60):
            tracker.update(replace(frame(TRUTH[k], k), covariance=noise))
        points = TRUTH[60].copy()
        points[HAND[0], axis] += 0.08
        tracked = tracker.update(replace(frame(points, 60), covariance=noise))
        assert tracked.seen[HAND[0]] == believed


def test_a_covariance_that_is_none_hides_its_marker():
    noise = np.tile(1e-6 * np.eye(3), (16, 1, 1))
    noise[2], noise[5], noise[7] = np.nan, 0.0, -1e-6 * np.eye(3)
    tracked = follow_with(NOISY[:30], noise)[-1]
    np.testing.assert_array_equal(np.flatnonzero(~tracked.seen), [2, 5, 7])
    assert np.isfinite(tracked.positions).all() and np.isfinite(tracked.covariances).all()
