"""What the columns of a trial mean, in a sentence each: for the tables that others read."""

from __future__ import annotations

from collections.abc import Mapping

_CLOCK = "ns of the session's clock, the host's monotonic one"

MEANING: Mapping[str, str] = {
    "begun": "When the trial began, s after the participant's first one began.",
    "weights": "Shares of the emotions that were shown, JSON.",
    "answer": "Emotion that was answered.",
    "key": "Key of the answer.",
    "rt_s": "From the opening of the question, right after the motion, to the answer, s.",
    "rt_contact_s": "From the contact to the answer, s.",
    "certainty": "How sure the answer was, 0 to 1.",
    "ratings": "Ratings by name, JSON.",
    "peak_speed": "Largest speed of the person's palm, m/s.",
    "motion_s": "From the cue to the end of the motion, s.",
    "longest_gap_s": "Longest time between two ticks of the motion, s; more than 1/120 where something stood still.",
    "stalled_s": "All times between ticks together, as far as each is beyond two ticks (1/60 s), s.",
    "cue_ns": f"The person was told to begin, {_CLOCK}.",
    "contact_ns": f"The palms met, or were shown to meet again; in clips, the shoulder was tapped, {_CLOCK}.",
    "ended_ns": f"The motion was over, {_CLOCK}.",
    "asked_ns": f"The question was opened, {_CLOCK}.",
    "answer_ns": f"It was answered, {_CLOCK}.",
    "arrival_ns": f"The frame in which the palms met, or the motion ended, came, {_CLOCK}.",
    "tick_ns": f"That frame was answered, {_CLOCK}.",
    "shown_ns": f"That frame was first shown by a page, {_CLOCK}.",
    "frame": "That frame's number.",
    "recording": "Recording of the session that holds the motion.",
    "broken_off": "Why the trial was broken off.",
    "excluded_why": "Why the session says that the trial does not count.",
    "ask": "The how manieth trial of the session it was, from 1; one that is asked again is another.",
    "block": "Block of the plan.",
    "trial": "Name of the trial in the plan.",
    "condition": "Mode of the block: interactive, own_replay, other_replay or no_contingency.",
    "style": "What the avatar showed.",
    "expected": "The right answer.",
    "cell": "Where the hands met: A to C low to high, 1 to 3 from the avatar's right.",
    "clip": "Number of the clip; 0 where the model made the motion.",
    "source_trial": "The trial that was shown again.",
    "viewpoint": "Of a replay: live or recorded.",
    "own_arm": "Of a replay, how the person's arm was shown: live or ghost.",
    "software": "Version that ran the trial.",
    "seed": "Of the plan.",
    "calibration": "Hash of the calibration in use.",
    "simulated": "1: no person answered.",
    "language": "Of the instructions and the participant's page.",
    "not_counted_why": "Why the analysis leaves the trial out.",
}
"""Column -> what it says."""
