"""Draws docs/high_five.png: the simulated pair at contact. Needs OpenGL."""

from pathlib import Path

import mujoco
import numpy as np
from PIL import Image

from hil.avatar import Pose
from hil.sim.actors import simulate_pair
from hil.sim.capture import CLEAN, PERSON_SET, markers_of, record
from hil.sim.rendering import NoPictures, open_renderer
from hil.sim.scene import build_scene
from mocap_bridge.human_arm import HumanArmEstimator
from mocap_bridge.marker_sets import load_marker_set
from mocap_bridge.sources import C3DSource
from mocap_bridge.tracker import Tracker

WIDTH, HEIGHT = 1280, 640


def main() -> None:
    """Simulates one high five and draws its contact."""
    scene = build_scene(visible=True)
    renderer = open_renderer(scene, WIDTH, HEIGHT)
    if isinstance(renderer, NoPictures):
        raise SystemExit(renderer.reason)
    trial = simulate_pair("happy", "C2", 0, np.random.default_rng(4))
    marker_set = load_marker_set(PERSON_SET)
    recording = record([("", markers_of(trial.person, marker_set), marker_set)], CLEAN, np.random.default_rng(0))
    tracker, arm = Tracker(marker_set), HumanArmEstimator(marker_set)
    people = [arm(tracker.update(frame)) for frame in C3DSource(recording)]
    data, k = scene.make_data(), trial.contact_frame
    scene.set_pose(data, Pose.from_quaternions(trial.avatar.root_in_world[k], trial.avatar.quaternions[k]))
    scene.set_person(data, people[k])
    mujoco.mj_kinematics(scene.model, data)
    picture = Image.fromarray(renderer.render(data, "wide"))
    picture.save(Path(__file__).with_name("high_five.png"), optimize=True)


if __name__ == "__main__":
    main()
