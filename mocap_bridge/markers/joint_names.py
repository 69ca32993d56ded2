"""Which joint centre a label names, whatever the naming habit: BVH, SMPL, Kinect, ZED, Xsens, Unity, Biped, Acclaim, …

A label is cut into words; words give a side and a part of the body. What a part means depends on its company:
``LeftHand`` is the wrist where segments give their names to the joints they start at, and the hand where there is a
``LeftWrist``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise

_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_VERTEBRA = re.compile(r"j?([CLT])(\d{1,2})(?:[CLTS]\d{1,2}|Head)?")
_SIDE_INSIDE = re.compile(r"^(left|right)|(?<=.)(left|right)$")
_SIDES = {"left": "left", "l": "left", "lt": "left", "right": "right", "r": "right", "rt": "right"}
_NOISE = {
    *("j", "jt", "joint", "jnt", "center", "centre", "bone", "bip", "biped", "mixamorig", "armature", "skeleton"),
    *("character", "ctrl", "def", "mid", "middle", "base", "jc", "m", "avg", "pos", "position"),
}
_IGNORED = {
    "roll",
    "twist",
    "helper",
    "ik",
    "pole",
    "target",
    "prop",
    "weapon",
    "jaw",
    "ground",
    "floor",
    "com",
    "mass",
}

# Parts under the names that they go by, joined words first. Values are parts, to be distinguished by their company.
_PARTS = {
    "pelvis": "pelvis hips hip root waist sacrum spinebase hipcenter midhip",
    "trunk": "spine naval navel belly abdomen ab torso lowerback back chest thorax upperback upperchest sternum "
    "spinemid spinechest chestspine navalspine spinenaval spineshoulder shouldercenter lumbar thoracic",
    "neck": "neck lowerneck neckbase",
    "upper_neck": "upperneck",
    "head": "head skull headcenter",
    "head_top": "headtop headend headtip vertex crown headtopend",
    "nose": "nose",
    "eye": "eye",
    "ear": "ear",
    "clavicle": "clavicle collar scapula collarbone clavicula",
    "shoulder": "shoulder sjc sho acromial",
    "upper_arm": "arm upperarm uparm uarm",
    "humerus": "humerus",
    "elbow": "elbow ejc elb",
    "forearm": "forearm lowerarm loarm lowarm farm",
    "radius": "radius ulna",
    "wrist": "wrist wjc wri",
    "hand": "hand palm",
    "hand_tip": "handtip fingers fingertip handend fingerbase fingerend handtop finger",
    "thumb": "thumb",
    "hip_joint": "hipjoint",
    "thigh": "thigh upleg upperleg hjc",
    "femur": "femur",
    "knee": "knee kjc kne",
    "shin": "leg shin calf lowerleg shank loleg lowleg",
    "tibia": "tibia",
    "ankle": "ankle ajc ank",
    "foot": "foot",
    "heel": "heel hee",
    "toe": "toe toes toebase ball ballfoot footindex football bigtoe forefoot mtp metatarsal",
    "toe_tip": "toeend toetip toesend toebaseend footend toend",
}
_PART_OF = {name: part for part, names in _PARTS.items() for name in names.split()}
_CUT_TO = 4  # letters of a name that are left at least, where a label was cut short
_UNPAIRED = {"pelvis", "trunk", "neck", "upper_neck", "head", "head_top", "nose"}
_FINGERS = ("index", "middle", "ring", "little", "pinky")
_DIGITS = {"0": "thumb", "1": "index_1", "2": "middle_1", "3": "ring_1", "4": "little_1"}
# How high on the trunk a name is, in steps of a numbered spine.
_HEIGHT = {"lowerback": 0, "naval": 0, "navel": 0, "belly": 0, "abdomen": 0, "ab": 0, "back": 2, "torso": 2} | {
    name: 8 for name in ("chest", "thorax", "upperback", "sternum", "chestspine", "spinechest")
}
_HEIGHT |= {"upperchest": 9, "spineshoulder": 10, "shouldercenter": 10, "navalspine": 0, "spinenaval": 0}
_LEVELS = {"lower": 0.0, "low": 0.0, "mid": 2.5, "middle": 2.5, "upper": 7.0, "high": 7.0}
_TRUNK_SLOTS = {1: (3,), 2: (2, 4), 3: (1, 3, 4), 4: (1, 2, 3, 4)}


def recognise(labels: Sequence[str]) -> dict[str, str]:
    """Canonical joint centre -> label, for the labels that are understood.

    The canonical names are those of the marker set ``joint_centres``.
    """
    parts: dict[tuple[str, str], list[str]] = {}
    trunk: list[tuple[float, str]] = []
    for label in labels:
        if vertebra := _VERTEBRA.fullmatch(_plain(label)):
            side, part, height = "", *_of_vertebra(vertebra.group(1), int(vertebra.group(2)))
        else:
            side, part, words = _understood(label)
            height = _height(words)
        if part == "trunk":
            trunk.append((height, label))
        elif part:
            parts.setdefault((side, part), []).append(label)
    # Of several labels for one part the plainest is the one: ``Head`` rather than ``Head_Nub``.
    plain = {key: min(found, key=len) for key, found in parts.items()}
    known = _of_trunk(plain, trunk)
    for side in ("left", "right"):
        own = {part: label for (s, part), label in plain.items() if s == side}
        known |= {f"{side}_{name}": label for name, label in {**_of_arm(own), **_of_leg(own), **_of_face(own)}.items()}
    return known


def words_of(label: str) -> list[str]:
    """The words of a label, lower case, what stands before the last ``:`` or ``|`` left out."""
    words = [word.lower() for word in _WORDS.findall(_plain(label))]
    return [part for word in words for part in _SIDE_INSIDE.sub(r" \g<0> ", word).split()]


def _plain(label: str) -> str:
    return re.split(r"[:|]", label)[-1].strip()


def _of_vertebra(kind: str, number: int) -> tuple[str, float]:
    """Part and height on the trunk of a vertebra, such as L5, or the joint below it, such as jL5S1."""
    if kind == "C":
        return ("head", 0.0) if number == 1 else ("neck", 0.0)
    if kind == "T" and number == 1:
        return "neck", 0.0
    return "trunk", 1.0 - number / 10 if kind == "L" else 7.0 - number / 3


def _understood(label: str) -> tuple[str, str, list[str]]:
    """Side (or ''), part (or '') and the words that gave the part."""
    words = words_of(label)
    if not words or _IGNORED.intersection(words):
        return "", "", []
    side = next((_SIDES[word] for word in words if word in _SIDES), "")
    words = [word for word in words if word not in _SIDES]
    part = _part(words)
    if not side and part not in _UNPAIRED and words and words[0][0] in "lr":  # lhumerus, LUArm
        rest = [word for word in (words[0][1:], *words[1:]) if word]
        if paired := _part(rest):
            side, part, words = _SIDES[words[0][0]], paired, rest
    if part == "pelvis" and side:
        part = "thigh" if "hip" in words else ""
    if bool(side) == (part in _UNPAIRED):  # a right neck, a shoulder without a side
        centre = {"shoulder": "trunk", "hip_joint": "pelvis"}.get(part, "") if not side else ""
        return "", centre, words
    return side, part, words


def _part(words: Sequence[str]) -> str:
    """The part that the words name, '' for none."""
    letters = [word for word in words if not word.isdigit()]
    kept = [word for word in letters if word not in _NOISE]
    if kept == ["finger"] and words[-1].isdigit():  # Biped counts its digits from the thumb
        return _DIGITS.get(words[-1], "")
    if "thumb" in letters:
        return "thumb"
    finger = next((word for word in letters if word in _FINGERS), "")
    if finger and not {"hip", "foot", "toe", "toes", "spine"}.intersection(letters):
        return _finger_part(finger, words)
    if "small" in letters:
        return ""
    pairs = [first + second for first, second in pairwise(letters)]
    pairs += [level + word for level in ("upper", "lower") if level in letters for word in letters]  # ArmLower
    for name in ("".join(letters), "".join(kept), *pairs, *reversed(kept)):
        if part := _PART_OF.get(name, ""):
            return _at_its_end(part, words)
    return _cut_short("".join(kept))


def _cut_short(letters: str) -> str:
    """The part whose name begins with these letters, as in labels that were cut to a length: ``LeftForeA``."""
    names = [name for name in _PART_OF if name.startswith(letters)] if len(letters) >= _CUT_TO else []
    return _PART_OF[min(names, key=len)] if names else ""


def _at_its_end(part: str, words: Sequence[str]) -> str:
    """The part, or the far end of it, if the words say so: ``HeadTop_End``, ``LeftHand_Nub``, ``Neck1``."""
    if part in ("head", "toe", "hand") and {"end", "tip", "top", "nub", "site"}.intersection(words):
        return "head_top" if part == "head" else f"{part}_tip"
    return "upper_neck" if part == "neck" and words[-1] in ("1", "2", "3") else part


def _finger_part(finger: str, words: Sequence[str]) -> str:
    """Knuckle of a finger, the tip of the hand, or ''."""
    finger = {"pinky": "little"}.get(finger, finger)
    tip = {"end", "tip", "site", "distal", "nub"}.intersection(words)
    number = next((int(word[:9]) for word in words if word.isdecimal()), 1)
    if finger == "middle" and (tip or number >= 3):
        return "hand_tip"
    first = not tip and number <= 1 and not {"intermediate", "dip", "pip"}.intersection(words)
    return f"{finger}_1" if first else ""


def _height(words: Sequence[str]) -> float:
    """Height on the trunk in steps of a numbered spine."""
    letters = "".join(word for word in words if not word.isdigit() and word not in _NOISE)
    number = next((int(word[:9]) for word in reversed(words) if word.isdecimal()), 0)
    if letters in ("lumbar", "thoracic"):
        return _of_vertebra(letters[0].upper(), number)[1]
    level = next((_LEVELS[word] for word in words if word in _LEVELS), 1.0)
    return _HEIGHT.get(letters, 10 if "shoulder" in letters else level) + 0.8 * min(number, 9)


def _of_trunk(plain: Mapping[tuple[str, str], str], trunk: list[tuple[float, str]]) -> dict[str, str]:
    """Pelvis, trunk, neck and head."""
    known = {part: plain["", part] for part in _UNPAIRED if ("", part) in plain and part != "pelvis"}
    if "neck" not in known and "upper_neck" in known:
        known["neck"] = known.pop("upper_neck")
    ordered = [label for _, label in sorted(trunk, key=lambda pair: pair[0])]
    if len(ordered) > 4:
        ordered = [ordered[round(i * (len(ordered) - 1) / 3)] for i in range(4)]
    slots = _TRUNK_SLOTS.get(len(ordered), ())
    known |= {f"trunk_{slot}": label for slot, label in zip(slots, ordered, strict=True)}
    if ("", "pelvis") in plain:
        known["pelvis"] = plain["", "pelvis"]
    return known


def _of_arm(own: Mapping[str, str]) -> dict[str, str]:
    """Clavicle to fingers of one side."""
    known = {part: own[part] for part in own if part.endswith("_1") or part in ("hand_tip", "thumb")}
    if _names_ends(own, ("humerus", "wrist"), ("shoulder", "elbow", "upper_arm", "forearm")):
        ends = {"clavicle": "shoulder", "humerus": "elbow", "radius": "mid_forearm", "wrist": "wrist", "hand": "hand"}
        return known | {ends[part]: own[part] for part in ends if part in own}
    shoulder = _first(own, ("upper_arm", "humerus"))
    if "clavicle" in own or "elbow" in own or shoulder is None:
        shoulder = own.get("shoulder", shoulder)
    clavicle = own.get("clavicle") or (own.get("shoulder") if shoulder != own.get("shoulder") else None)
    elbow = _first(own, ("elbow", "forearm", "radius"))
    wrist = _first(own, ("wrist", "hand"))
    hand = own.get("hand") if wrist != own.get("hand") else None
    found = {"clavicle": clavicle, "shoulder": shoulder, "elbow": elbow, "wrist": wrist, "hand": hand}
    return known | {name: label for name, label in found.items() if label is not None}


def _of_leg(own: Mapping[str, str]) -> dict[str, str]:
    """Hip to toes of one side."""
    if _names_ends(own, ("femur", "tibia"), ("thigh", "knee", "shin", "ankle")):
        ends = {"hip_joint": "hip", "femur": "knee", "tibia": "ankle", "foot": "ball", "toe": "toe_tip"}
        return {ends[part]: own[part] for part in ends if part in own}
    ankle = _first(own, ("ankle", "foot"))
    ahead = [own[part] for part in ("foot", "toe", "toe_tip") if part in own and own[part] != ankle]
    found = {
        "hip": _first(own, ("thigh", "femur", "hip_joint")),
        "knee": _first(own, ("knee", "shin", "tibia")),
        "ankle": ankle,
        "heel": own.get("heel"),
        "ball": ahead[0] if ahead else None,
        "toe_tip": ahead[-1] if len(ahead) > 1 else None,
    }
    return {name: label for name, label in found.items() if label is not None}


def _of_face(own: Mapping[str, str]) -> dict[str, str]:
    return {part: own[part] for part in ("eye", "ear") if part in own}


def _names_ends(own: Mapping[str, str], required: Iterable[str], absent: Iterable[str]) -> bool:
    """Labels name the far end of their bone, as positions computed from Acclaim skeletons do."""
    return all(part in own for part in required) and not any(part in own for part in absent)


def _first(own: Mapping[str, str], parts: Iterable[str]) -> str | None:
    return next((own[part] for part in parts if part in own), None)
