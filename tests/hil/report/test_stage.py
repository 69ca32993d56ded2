"""The drawn servo arm is where the servos said that it was, and the person beside it where she was."""

import numpy as np
import pytest
from trial_results import simulated_result

from highfive.hil.arm_model.servo_arm import DEFAULT_MOUNT
from highfive.hil.bench.contact import played, twin_loop
from highfive.hil.bench.retarget import reference_trajectories
from highfive.hil.report.film import Arms, picture_strips
from highfive.hil.report.stage import arm_stage, avatar_stage
from highfive.hil.sim.arm_body import arm_in_scene
from highfive.hil.sim.rendering import NoPictures
from highfive.hil.sim.scene import build_scene
from highfive.model import DEFAULT_MODEL
from highfive.model.hgpdm.store import load_model


def quiet(label, total):
    return lambda note="", done=None: None


@pytest.mark.slow
def test_the_drawn_arm_is_where_its_servos_said():
    arm = played(reference_trajectories(load_model(DEFAULT_MODEL), ("neutral",), ("B2",), 0, quiet)[0], twin_loop())
    result = simulated_result(build_scene(), 3, "neutral", "B2")
    twin = arm_in_scene(DEFAULT_MOUNT, avatar=False, visible=True)
    stage, avatar = arm_stage(twin, {3: arm}), avatar_stage(build_scene())
    for tick in (0, arm.due - 20, arm.due, arm.due + 5):
        data = stage.show(result, min(tick, len(result.times) - 1))
        assert data.site_xpos[twin.plate_site] == pytest.approx(arm.plates[tick].position, abs=1e-3)
        beside = avatar.show(result, min(tick, len(result.times) - 1))
        for body in ("person_head", "person_palm"):
            places = [d.body(body).xpos for d in (data, beside)]
            assert np.allclose(*places, atol=1e-6) and np.linalg.norm(places[0]) > 0.5
    strips = picture_strips(build_scene(visible=True), [result], Arms(twin, {3: arm}))
    if not isinstance(strips, NoPictures):
        assert [strip.arm for strip in strips] == [False, True]
        assert all(len(strip.pictures) == 5 for strip in strips)
    assert "pelvis" not in {twin.model.body(i).name for i in range(twin.model.nbody)}
