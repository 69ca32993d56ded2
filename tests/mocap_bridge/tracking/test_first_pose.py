import numpy as np

from highfive.hil.sim.avatar import avatar_skeleton
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.tracking.chain import make_chain, segment_order
from highfive.mocap_bridge.tracking.chain_kinematics import kinematics
from highfive.mocap_bridge.tracking.first_pose import first_state, standing, turned_back
from highfive.model.geometry import rotations

SKELETON = avatar_skeleton()


def test_no_elbow_begins_bent_backwards():
    """Without markers on the upper arm the mirror image explains a bent arm as well; anatomy does not."""
    rng = np.random.default_rng(3)
    gait = load_marker_set("plug_in_gait")
    chain, order = make_chain(gait), segment_order(gait)
    lifting = np.array([chain.first[order.index(f"{side}_shoulder")] for side in ("right", "left")])
    elbow, forearm = chain.first[order.index("right_elbow")], order.index("right_elbow")
    seen = np.array([joint != "right_shoulder" for joint in gait.joints])
    upright = np.array([[0.0, 0.0, 0.93]])
    for _ in range(8):
        angles = np.zeros((1, len(SKELETON), 3))
        angles[0, SKELETON.index("right_shoulder")] = rng.uniform([-2.0, -0.8, -0.5], [0.0, 0.2, 1.0])
        angles[0, SKELETON.index("right_elbow")] = rng.uniform([-2.3, 0.0, -0.5], [-1.6, 0.0, 1.4])
        pose = SKELETON.forward_kinematics(upright, SKELETON.from_hinges(angles))
        state = first_state(chain, lifting, gait.simulate(SKELETON, *pose)[0], seen)
        assert state is not None
        assert state.pose.angles[elbow] < 0.0
        turned = rotations.to_matrix(pose[1][0, SKELETON.index("right_elbow")]).T @ state.pose.frames[forearm]
        assert np.arccos(np.clip((np.trace(turned) - 1.0) / 2.0, -1.0, 1.0)) < 0.35


def test_an_elbow_that_bends_backwards_is_turned_about_and_the_hand_stays():
    rng = np.random.default_rng(4)
    paper = load_marker_set("paper")
    chain, order = make_chain(paper), segment_order(paper)
    shoulder, elbow = (chain.first[order.index(f"right_{joint}")] for joint in ("shoulder", "elbow"))
    shoulders, arm = np.array([shoulder]), order.index("right_elbow")
    for _ in range(20):
        angles = chain.rest + rng.normal(scale=0.5, size=len(chain.rest))
        angles[elbow] = rng.uniform(0.4, 2.4)
        other = turned_back(chain, shoulders, angles)
        assert other is not None
        assert other[elbow] == -angles[elbow]
        assert turned_back(chain, shoulders, other) is None
        (mirrored, _), (right, _) = (
            kinematics(chain, chain.offsets, standing(chain, angles=given)) for given in (angles, other)
        )
        np.testing.assert_allclose(right.frames[arm], mirrored.frames[arm], atol=1e-9)
        np.testing.assert_allclose(right.centres, mirrored.centres, atol=1e-9)
