"""Names of joint centres as the makers of skeletons write them."""

import pytest

from highfive.mocap_bridge.markers.joint_names import recognise, words_of
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.markers.recognise import find_marker_set
from highfive.model.errors import HighFiveError

# For each habit the right arm, right leg and the middle, as: shoulder elbow wrist | hip knee ankle | pelvis head
HABITS = {
    "BVH": "RightArm RightForeArm RightHand RightUpLeg RightLeg RightFoot Hips Head",
    "Mixamo": "mixamorig:RightArm mixamorig:RightForeArm mixamorig:RightHand mixamorig:RightUpLeg mixamorig:RightLeg "
    "mixamorig:RightFoot mixamorig:Hips mixamorig:Head",
    "SMPL": "right_shoulder right_elbow right_wrist right_hip right_knee right_ankle pelvis head",
    "Kinect": "ShoulderRight ElbowRight WristRight HipRight KneeRight AnkleRight SpineBase Head",
    "Azure": "SHOULDER_RIGHT ELBOW_RIGHT WRIST_RIGHT HIP_RIGHT KNEE_RIGHT ANKLE_RIGHT PELVIS HEAD",
    "ZED": "RIGHT_SHOULDER RIGHT_ELBOW RIGHT_WRIST RIGHT_HIP RIGHT_KNEE RIGHT_ANKLE PELVIS HEAD",
    "OpenPose": "RShoulder RElbow RWrist RHip RKnee RAnkle MidHip Head",
    "Xsens": "RightUpperArm RightForeArm RightHand RightUpperLeg RightLowerLeg RightFoot Pelvis Head",
    "Xsens joints": "jRightShoulder jRightElbow jRightWrist jRightHip jRightKnee jRightAnkle Pelvis jC1Head",
    "Unity": "RightUpperArm RightLowerArm RightHand RightUpperLeg RightLowerLeg RightFoot Hips Head",
    "Unreal": "upperarm_r lowerarm_r hand_r thigh_r calf_r foot_r pelvis head",
    "Motive": "RUArm RFArm RHand RThigh RShin RFoot Hip Head",
    "Rokoko": "RightArm RightForeArm RightHand RightThigh RightShin RightFoot Hips Head",
    "Acclaim": "rclavicle rhumerus rwrist rhipjoint rfemur rtibia root head",
    "plain": "rshoulder relbow rwrist rhip rknee rankle pelvis head",
    "capitals": "RIGHTSHOULDER RIGHTELBOW RIGHTWRIST RIGHTHIP RIGHTKNEE RIGHTANKLE PELVIS HEAD",
    "side last": "shoulderRight elbowRight wristRight hipRight kneeRight ankleRight root head",
    "level last": "RightArmUpper RightArmLower RightHand RightLegUpper RightLegLower RightFoot Hips Head",
    "OpenSim": "acromial_r elbow_r wrist_r hip_r knee_r ankle_r pelvis head",
    "Vicon": "RSJC REJC RWJC RHJC RKJC RAJC Pelvis Head",
}
PARTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
TURNED = {"Right": "Left", "right": "left", "RIGHT": "LEFT"}


def to_left(label: str) -> str:
    for right, left in TURNED.items():
        if right in label:
            return label.replace(right, left)
    if label.endswith("_r"):
        return label[:-1] + "l"
    return {"R": "L", "r": "l"}[label[0]] + label[1:]


@pytest.mark.parametrize("labels", [pytest.param(text.split(), id=habit) for habit, text in HABITS.items()])
def test_limbs_pelvis_and_head_are_known_in_every_habit(labels):
    if labels[0].startswith("Right") and "Arm" in labels[0]:
        labels = [*labels, "RightShoulder"]  # there it is the clavicle
    middle = labels[6:8]
    sided = labels[:6] + labels[8:]
    known = recognise([*sided, *map(to_left, sided), *middle])
    expected = dict(zip(PARTS, labels, strict=False))
    assert {part: known[f"right_{part}"] for part in PARTS} == expected
    assert {part: known[f"left_{part}"] for part in PARTS} == {part: to_left(label) for part, label in expected.items()}
    assert (known["pelvis"], known["head"]) == tuple(middle)
    assert len(set(known.values())) == len(known), "a label stands for one joint"
    assert known.get("right_clavicle") == ("RightShoulder" if "RightShoulder" in labels[8:] else None)


def test_an_arm_segment_names_the_joint_where_it_begins_if_there_is_a_clavicle_or_none():
    assert recognise(
        ["Bip01 R Clavicle", "Bip01 R UpperArm", "Bip01 R Forearm", "Bip01 R Hand", "Bip01 R Finger0"]
    ) == {
        "right_clavicle": "Bip01 R Clavicle",
        "right_shoulder": "Bip01 R UpperArm",
        "right_elbow": "Bip01 R Forearm",
        "right_wrist": "Bip01 R Hand",
        "right_thumb": "Bip01 R Finger0",
    }


def test_hand_and_foot_mean_something_else_beside_wrist_and_ankle():
    beside = recognise(["l_wrist", "l_hand", "l_ankle", "l_foot"])
    assert beside == {"left_wrist": "l_wrist", "left_hand": "l_hand", "left_ankle": "l_ankle", "left_ball": "l_foot"}
    assert recognise(["l_hand", "l_foot"]) == {"left_wrist": "l_hand", "left_ankle": "l_foot"}


def test_a_spine_is_ordered_from_below_whatever_the_order_of_the_labels():
    expected = {"trunk_1": "Spine", "trunk_2": "Spine1", "trunk_3": "Spine2", "trunk_4": "Chest"}
    assert recognise(["Chest", "Spine2", "Spine", "Spine1"]) == expected
    assert recognise(["T8", "L5", "T12", "L3"]) == {"trunk_1": "L5", "trunk_2": "L3", "trunk_3": "T12", "trunk_4": "T8"}
    assert recognise(["UpperSpine", "LowerSpine", "MidSpine"]) == {
        "trunk_1": "LowerSpine",
        "trunk_3": "MidSpine",
        "trunk_4": "UpperSpine",
    }
    assert recognise(["CHEST_SPINE", "NAVAL_SPINE"]) == {"trunk_2": "NAVAL_SPINE", "trunk_4": "CHEST_SPINE"}


def test_what_is_no_joint_is_left_out():
    assert recognise(["RightForeArmRoll", "LeftUpLegTwist", "jaw", "weapon_r", "j07", "M001", "", "*12"]) == {}


def test_labels_are_cut_into_words():
    assert words_of("mixamorig:LeftHandIndex1") == ["left", "hand", "index", "1"]
    assert words_of("HANDTIP_RIGHT") == ["handtip", "right"]
    assert words_of("Bip01 R UpperArm") == ["bip", "01", "r", "upper", "arm"]


def test_a_set_of_joint_centres_bears_the_laboratorys_own_labels():
    labels = ["Hips", "Neck", "Head", *(f"{s}{p}" for s in ("Left", "Right") for p in ("Arm", "ForeArm", "Hand"))]
    marker_set = find_marker_set([*labels, "Sword"])
    assert sorted(marker_set.names) == sorted(labels)
    assert marker_set.arm.wrist == ("RightHand",) and marker_set.arm.hand == ()
    assert marker_set.match(["Sword", *labels]).min() >= 1


def test_sets_that_fit_by_name_come_first():
    assert find_marker_set(load_marker_set("cmu_joint_centres").names).name == "cmu_joint_centres"
    assert find_marker_set(load_marker_set("full_body").names).name == "full_body"


def test_what_is_missing_is_named():
    with pytest.raises(HighFiveError, match=r"no right_wrist is recognised .*LElbow as left_elbow"):
        find_marker_set(["Neck", "Head", "LShoulder", "LElbow", "LWrist", "RShoulder", "RElbow"])


def test_labels_that_were_cut_to_a_length_are_told_from_what_is_left():
    whole = "Hips Neck Head RightShoulder RightArm RightForeArm RightHand RightUpLeg RightLeg RightFoot RightToeBase"
    for length in (9, 10, 11):
        cut = {label: label[:length] for label in whole.split()}
        found = recognise(list(cut.values()))
        assert found == {name: cut[label] for name, label in recognise(whole.split()).items()}
