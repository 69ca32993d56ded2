"""How the simulated actors show an emotion.

A stand-in, not a finding about people. Speeds: peak right-hand speed of single-person recordings of a guiding gesture,
one clip per style (angry 4.1, happy 2.2, neutral 1.35, sad 0.56 m/s). Directions of posture cues: Pollick et al. 2001
(arousal scales speed, acceleration, jerk), Wallbott 1998 and Roether et al. 2009 (sad: slow, head and trunk bowed, arms
near the body; happy: wide, lifted, bouncy, open chest; angry: fast, leaning forward, stiff elbows; neutral: upright,
medium speed).
"""

from __future__ import annotations

from dataclasses import dataclass

from highfive.model.errors import HighFiveError


@dataclass(frozen=True)
class EmotionStyle:
    """One emotion's cues. Angles in degrees, lengths in m, times in s, speeds in m/s."""

    peak_speed: float
    """Peak speed of the avatar actor's right hand in the reach."""
    person_peak_speed: float
    """Peak speed of the person's hand; the person is never quicker than the actor's reach plus ``reaction`` allows."""
    reaction: float
    """Onset of the avatar actor's reach after the person's."""
    contact_speed: float
    """Speed of each palm along its normal at contact."""
    return_ratio: float
    """Duration of the return over that of the reach."""
    wind_up: float
    """How far the palm is drawn back before the strike."""
    elbow_out: float
    """Swivel of the elbow away from straight down."""
    trunk_lean: float
    """Forward bend of the trunk (negative: open chest)."""
    reach_lean: float
    """Additional forward bend at contact."""
    head_pitch: float
    """Head bowed (positive) or lifted."""
    shoulder_lift: float
    """Elevation of the clavicles."""
    rest_elbow: float
    """Elbow flexion while the arms hang."""
    left_arm_out: float
    """Abduction of the left arm."""
    finger_curl: float
    """Curl of the relaxed fingers."""
    bounce: float
    """Vertical movement of the pelvis in the reach."""
    follow_through: float
    """How far the palm travels on, down and back, after contact."""


EMOTIONS: dict[str, EmotionStyle] = {
    "neutral": EmotionStyle(1.35, 1.25, 0.20, 0.25, 1.15, 0.02, 30, 0, 4, 0, 0, 12, 6, 18, 0.000, 0.04),
    "happy": EmotionStyle(2.20, 1.80, 0.16, 0.40, 1.20, 0.07, 55, -7, 3, -9, 6, 28, 20, 10, 0.025, 0.10),
    "angry": EmotionStyle(4.10, 2.60, 0.22, 0.70, 1.60, 0.09, 18, 11, 9, 6, 9, 38, 14, 55, 0.000, 0.12),
    "sad": EmotionStyle(0.56, 0.60, 0.32, 0.08, 0.85, 0.00, 8, 16, 1, 24, -7, 8, 2, 26, -0.010, 0.02),
}
"""The four emotions of the simulated pair, by name."""


def emotion_style(name: str) -> EmotionStyle:
    """The cues of an emotion; an unknown name is an error that lists the known ones."""
    try:
        return EMOTIONS[name]
    except KeyError:
        raise HighFiveError(f"unknown emotion {name!r}; known are {', '.join(EMOTIONS)}") from None
