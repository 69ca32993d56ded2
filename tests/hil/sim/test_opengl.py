import os
import subprocess
import sys

import pytest

from highfive.hil.sim.opengl import choose_backend


def chosen(environment, libraries=(), platform="linux"):
    environment = dict(environment)
    problem = choose_backend(environment, platform, lambda library: any(name in library for name in libraries))
    return environment.get("MUJOCO_GL", ""), problem


def test_a_headless_linux_takes_egl_then_osmesa():
    assert chosen({}, ["EGL", "OSMesa"]) == ("egl", "")
    assert chosen({}, ["OSMesa"]) == ("osmesa", "")


def test_without_a_library_mujoco_is_kept_from_trying():
    backend, problem = chosen({})
    assert backend == "disable"
    assert "libEGL.so.1" in problem
    assert "\n" not in problem


@pytest.mark.parametrize("requested", ["egl", "osmesa", "glfw"])
def test_a_choice_that_can_work_is_respected(requested):
    assert chosen({"MUJOCO_GL": requested}, ["EGL", "OSMesa"]) == (requested, "")


@pytest.mark.parametrize("requested", ["bogus", "egl", "osmesa"])
def test_a_choice_that_cannot_work_is_named(requested):
    backend, problem = chosen({"MUJOCO_GL": requested})
    assert backend == "disable"
    assert f"MUJOCO_GL={requested}" in problem


def test_a_display_and_other_systems_are_left_to_mujoco():
    assert chosen({"DISPLAY": ":0"}) == ("", "")
    assert chosen({}, platform="darwin") == ("", "")


@pytest.mark.parametrize("value", ["disable", "bogus"])
@pytest.mark.slow
def test_everything_but_pictures_runs_without_opengl(value):
    program = (
        "from highfive.hil.sim.scene import build_scene\n"
        "from highfive.hil.sim.rendering import NoPictures, open_renderer\n"
        "scene = build_scene(); scene.make_data()\n"
        "answer = open_renderer(scene, 64, 48)\n"
        "assert isinstance(answer, NoPictures), answer\n"
        "print(answer.reason)\n"
    )
    environment = {**os.environ, "MUJOCO_GL": value}
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("\n") == 1
    assert f"MUJOCO_GL={value}" in done.stdout
