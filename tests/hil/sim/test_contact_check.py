import numpy as np
import pytest

from highfive.hil.sim.avatar import Pose
from highfive.hil.sim.contact_check import ContactCheck, contact_report, palm_offset
from highfive.hil.sim.playout import PlayState
from highfive.hil.sim.touch import Touch
from highfive.mocap_bridge.frames import PalmPose
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations

NOWHERE = Pose(np.zeros(3), np.zeros((53, 3)))


def palm(position, normal, velocity=(0.0, 0.0, 0.0)):
    normal = np.asarray(normal, float)
    return PalmPose(np.asarray(position, float), normal, np.array([0.0, 0.0, 1.0]), np.asarray(velocity, float))


def state(number, avatar, person, touches=(), force=0.0):
    return PlayState(number, NOWHERE, avatar, person, tuple(touches), force)


def touch(first, second, expected, distance):
    return Touch(first, second, expected, distance, 0.0, np.zeros(3), np.array([1.0, 0.0, 0.0]))


def approach(final_gap, speed=1.0, lateral=0.0):
    """Palms close in along x at ``speed`` and stay for three ticks."""
    states = []
    for number, ahead in enumerate([0.3, 0.2, 0.1, 0.0, 0.0, 0.0]):
        moving = (-speed, 0.0, 0.0) if ahead > 0.0 else (0.0, 0.0, 0.0)
        person = palm([0.5 + final_gap + ahead, lateral, 1.4], [-1.0, 0.0, 0.0], moving)
        states.append(state(number, palm([0.5, 0.0, 1.4], [1.0, 0.0, 0.0]), person))
    return states


@pytest.mark.parametrize("gap", [-0.0015, 0.0, 0.0015])
def test_palms_that_meet(gap):
    report = contact_report(approach(gap, speed=0.7, lateral=0.004))
    assert report.met
    assert report.met_time_ns == report.nearest_time_ns == 3
    assert report.gap == pytest.approx(gap)
    assert report.lateral == pytest.approx(0.004)
    assert report.distance == pytest.approx(np.hypot(gap, 0.004))
    assert report.approach_speed == pytest.approx(0.7)
    assert report.palm_angle == pytest.approx(0.0, abs=1e-6)
    np.testing.assert_allclose(report.where, [0.5 + gap / 2, 0.002, 1.4])


@pytest.mark.parametrize(("gap", "lateral"), [(0.02, 0.0), (0.0, 0.08)])
def test_palms_that_miss(gap, lateral):
    report = contact_report(approach(gap, lateral=lateral))
    assert not report.met
    assert report.met_time_ns is None
    assert report.distance == pytest.approx(np.hypot(gap, lateral))


def test_a_contact_of_the_palms_counts_even_between_two_ticks():
    states = approach(0.01)
    hit = touch("right_palm", "person_palm", True, -0.001)
    states[2] = state(2, states[2].palm, states[2].person_palm, [hit], force=31.0)
    report = contact_report(states)
    assert report.met_time_ns == 2
    assert report.peak_force == 31.0
    assert report.bodies == (("right_palm", "person_palm"),)


@pytest.mark.parametrize("degrees", [0.0, 5.0, 40.0, 180.0])
def test_angle_between_the_palms(degrees):
    turned = rotations.rotate(rotations.from_axis_angle("z", np.radians(degrees)), [-1.0, 0.0, 0.0])
    report = contact_report([state(0, palm([0, 0, 1], [1, 0, 0]), palm([0.1, 0, 1], turned))])
    assert np.degrees(report.palm_angle) == pytest.approx(degrees, abs=1e-5)


def test_the_report_does_not_change_with_the_place_in_the_room():
    rng = np.random.default_rng(2)
    turn, shift = rotations.normalize(rng.normal(size=4)), rng.normal(size=3)

    def moved(p):
        place = rotations.rotate(turn, p.position) + shift
        return PalmPose(place, *(rotations.rotate(turn, v) for v in (p.normal, p.fingers, p.velocity)))

    here = approach(0.001, lateral=0.01)
    there = [state(s.time_ns, moved(s.palm), moved(s.person_palm)) for s in here]
    first, second = contact_report(here), contact_report(there)
    assert first.met is second.met
    for figure in ("distance", "lateral", "gap", "approach_speed"):
        assert getattr(first, figure) == pytest.approx(getattr(second, figure), abs=1e-12)


def test_offset_splits_the_distance():
    rng = np.random.default_rng(3)
    for _ in range(20):
        normal, other = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
        a, b = palm(rng.normal(size=3), normal), palm(rng.normal(size=3), other)
        gap, lateral = palm_offset(a, b)
        assert np.hypot(gap, lateral) == pytest.approx(np.linalg.norm(a.position - b.position))


def test_unwanted_contacts_keep_their_first_time_and_deepest_overlap():
    check = ContactCheck()
    for number, depth in ((10, 0.001), (11, 0.006), (12, 0.002)):
        found = [touch("right_index_3", "person_head", False, -depth)]
        check.record(state(number, palm([0, 0, 1], [1, 0, 0]), palm([1, 0, 1], [-1, 0, 0]), found))
    (finding,) = check.report().unwanted
    assert (finding.first, finding.second) == ("right_index_3", "person_head")
    assert finding.first_time_ns == 10
    assert finding.deepest == pytest.approx(0.006)


def test_an_empty_trial_is_refused():
    with pytest.raises(HighFiveError, match="without a single"):
        ContactCheck().report()
