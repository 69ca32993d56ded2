import os
import subprocess
import sys
from dataclasses import replace

import imageio_ffmpeg
import mujoco
import numpy as np
import pytest
from paths import HELPERS
from trial_results import some_results

from highfive.hil.report.captions import Captions, who_is_who
from highfive.hil.report.film import FPS, Shot, make_film, picture_strips, pixel_of
from highfive.hil.sim.rendering import NoPictures
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.key_frames import apart_at_contact, key_frames_of, showpieces
from highfive.model.errors import HighFiveError


@pytest.fixture(scope="module")
def results():
    return some_results()


@pytest.fixture(scope="module")
def visible():
    return build_scene(visible=True)


def test_moments_come_in_order(results):
    for result in results:
        at = key_frames_of(result)
        assert 0 <= at.start <= at.half_way <= at.contact <= at.release <= at.end == len(result.times) - 1
        gone = np.linalg.norm(result.person_palm - result.person_palm[at.contact], axis=-1)
        assert gone[at.half_way] <= 0.5 * gone[at.start] + 1e-9
        if result.contact.met:
            assert apart_at_contact(result) < 0.05


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_the_showpiece_is_the_median_trial_whatever_the_order(results, count):
    errors = [0.002, 0.004, 0.03, np.nan][:count]
    group = [replace(results[0], number=i, touch_error=e) for i, e in enumerate(errors)]
    group = [replace(r, contact=replace(r.contact, met=bool(r.touch_error == r.touch_error))) for r in group]
    other = results[1]
    for order in (group, group[::-1]):
        (shown, same) = showpieces([*order, other])
        nearer = sum(r.touch_error < shown.touch_error for r in group)
        assert nearer <= count / 2 <= nearer + 1 and shown.contact.met and same is other
    assert showpieces(results[4:]) == list(results[4:])


def test_points_are_where_the_camera_sees_them(visible):
    data = visible.make_data()
    mujoco.mj_forward(visible.model, data)
    number = visible.model.camera("close").id
    position, axes = data.cam_xpos[number], data.cam_xmat[number].reshape(3, 3)
    size, half_view = (400, 600), 0.5 * np.radians(visible.model.cam_fovy[number])
    ahead = position - 2.0 * axes[:, 2]
    assert pixel_of(data, "close", ahead, size) == pytest.approx((300.0, 200.0))
    top = ahead + 2.0 * np.tan(half_view) * axes[:, 1]
    assert pixel_of(data, "close", top, size) == pytest.approx((300.0, 0.0))
    right = ahead + 3.0 * np.tan(half_view) * axes[:, 0]
    assert pixel_of(data, "close", right, size) == pytest.approx((600.0, 200.0))


@pytest.mark.parametrize("where", [(0.5, -0.1, 1.9), (0.4, -0.9, 1.0), (0.5, -0.2, 1.4)])
def test_a_close_picture_has_where_the_palms_meet_well_inside(visible, results, where):
    met = replace(results[0], contact=replace(results[0].contact, where=np.array(where)))
    shot, data = Shot(met, "close", range(1), 0, slow=True), visible.make_data()
    mujoco.mj_forward(visible.model, data)
    data.cam_xpos[visible.model.camera("close").id] += shot.shift
    column, row = pixel_of(data, "close", np.array(where), (720, 1280))
    assert 0.3 * 1280 < column < 0.7 * 1280 and 0.3 * 720 < row < 0.7 * 720
    assert replace(shot, camera="wide", slow=False).shift is None


def test_captions_stay_in_their_corners(results):
    before = np.full((360, 640, 3), 90, np.uint8)
    frame = before.copy()
    Captions(360).caption(frame, results[0], slow=True, after_contact=True)
    changed = np.argwhere((frame != before).any(axis=-1))
    assert changed[:, 0].min() > 270 and len(changed) > 2000
    assert not (frame != before)[:, 300:340].any()


def test_captions_say_who_answers_and_in_which_style(results):
    happy = replace(results[0], style="happy", simulated=False)
    assert who_is_who(happy, arm=False) == ("avatar: happy", "person")
    assert who_is_who(replace(happy, style="", simulated=True), arm=True) == ("servo arm", "simulated person")


@pytest.mark.parametrize("where", [(320.0, 180.0), (0.0, 0.0), (639.0, 359.0), (-500.0, 100.0), (100.0, 9000.0)])
def test_the_ring_may_leave_the_picture(where):
    frame = np.zeros((360, 640, 3), np.uint8)
    Captions(360).ring(frame, where, 0.3)
    assert frame.any() == (-60 < where[0] < 700 and -60 < where[1] < 420)


@pytest.mark.slow
def test_strips_show_the_moments(visible, results):
    strips = picture_strips(visible, results[1:2])
    if isinstance(strips, NoPictures):
        pytest.skip(strips.reason)
    ((label, first), *others) = strips[0].pictures
    assert label == "start" and len(others) == 4
    for _, picture in others:
        assert picture.shape == first.shape
        assert np.abs(picture.astype(int) - first).max() > 50
    again = picture_strips(visible, results[1:2])
    assert not isinstance(again, NoPictures)
    assert all(np.array_equal(a, b) for (_, a), (_, b) in zip(strips[0].pictures, again[0].pictures, strict=True))


@pytest.mark.slow(20)
def test_film_is_as_long_as_its_shots(visible, results, tmp_path):
    counted, path = [], tmp_path / "film.mp4"
    made = make_film(visible, results[2:3], path, lambda label, total: lambda: counted.append(total))
    if isinstance(made, NoPictures):
        pytest.skip(made.reason)
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(path))
    assert frames == len(counted) == counted[0]
    assert seconds == pytest.approx(frames / FPS, abs=0.1)
    assert list(tmp_path.iterdir()) == [path] and path.stat().st_size < 3e6


def test_no_trials_make_no_film(visible, tmp_path):
    made = make_film(visible, [], tmp_path / "film.mp4")
    assert isinstance(made, NoPictures) and "no trial" in made.reason
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_film_that_cannot_be_written_is_one_line(visible, results, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(HighFiveError) as error:
        made = make_film(visible, results[2:3], tmp_path / "file" / "film.mp4")
        if isinstance(made, NoPictures):
            pytest.skip(made.reason)
    assert "\n" not in str(error.value)


WITHOUT_OPENGL = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from trial_results import simulated_result
from highfive.hil.report.film import make_film, picture_strips
from highfive.hil.sim.scene import build_scene
scene = build_scene()
results = [simulated_result(scene, 0, "angry", "B2")]
print(picture_strips(scene, results).reason)
print(make_film(scene, results, Path("never.mp4")).reason)
"""


@pytest.mark.slow
def test_without_opengl_there_is_a_reason(tmp_path):
    command = [sys.executable, "-c", WITHOUT_OPENGL, str(HELPERS)]
    environment = {**os.environ, "MUJOCO_GL": "disable"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True, cwd=tmp_path)
    reasons = done.stdout.splitlines()
    assert len(reasons) == 2 and all("MUJOCO_GL=disable" in reason for reason in reasons)
    assert not (tmp_path / "never.mp4").exists()
