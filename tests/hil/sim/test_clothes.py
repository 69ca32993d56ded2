"""Nothing comes through a shirt, however people bend: what MuJoCo draws, without drawing it."""

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from trial_results import simulated_result

from highfive.hil.report.stage import avatar_stage
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.key_frames import contact_tick

Array = NDArray[np.float64]

HEM = -0.045
"""m, in the pelvis's frame: what lies above it is under the shirt, which ends at -0.062."""


def skinned(model: mujoco.MjModel, scene: mujoco.MjvScene, name: str) -> tuple[Array, NDArray[np.int64]]:
    """Vertices (V, 3), m, of a skin as it is now, and its faces (F, 3)."""
    number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SKIN, name)
    first, count = scene.skinvertadr[number], scene.skinvertnum[number]
    vertices = scene.skinvert.reshape(-1, 3)[first : first + count]
    start, faces = model.skin_faceadr[number], model.skin_facenum[number]
    return vertices.astype(float), model.skin_face[start : start + faces].astype(int)


def turns_round(points: Array, vertices: Array, faces: NDArray[np.int64]) -> Array:
    """(P,) winding number of a closed surface about each point: 1 inside, 0 outside (van Oosterom, Strackee 1983)."""
    total = np.zeros(len(points))
    for corners in np.array_split(vertices[faces], 40):
        a, b, c = (corners[:, i] - points[:, None] for i in range(3))
        la, lb, lc = (np.linalg.norm(side, axis=-1) for side in (a, b, c))
        volume = np.einsum("pfi,pfi->pf", a, np.cross(b, c))
        dots = (np.einsum("pfi,pfi->pf", x, y) * z for x, y, z in ((a, b, lc), (b, c, la), (c, a, lb)))
        total += 2.0 * np.arctan2(volume, la * lb * lc + sum(dots)).sum(axis=1)
    return total / (4.0 * np.pi)


@pytest.mark.parametrize("cell", ["A1", "C3"])
@pytest.mark.slow
def test_trousers_stay_under_the_shirt_of_whoever_bends(cell: str) -> None:
    scene = build_scene(visible=True)
    result = simulated_result(scene, 0, "happy", cell)
    data = avatar_stage(scene).show(result, contact_tick(result))
    drawn = mujoco.MjvScene(scene.model, maxgeom=2000)
    mujoco.mjv_updateSkin(scene.model, data, drawn)
    for owner, pelvis in (("avatar", "pelvis"), ("person", "person_pelvis")):
        trousers, _ = skinned(scene.model, drawn, f"{owner}_trousers")
        body = data.body(pelvis)
        heights = (trousers - body.xpos) @ body.xmat.reshape(3, 3)[:, 2]
        under = trousers[heights > HEM]
        assert len(under) > 50
        inside = turns_round(under, *skinned(scene.model, drawn, f"{owner}_shirt")) > 0.5
        assert inside.all(), f"{owner}: {np.count_nonzero(~inside)} of {len(under)} are seen"
