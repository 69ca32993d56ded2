"""The webcam: high fives with a person of known truth, from what the nets saw of her, through filter and session.

In virtual time, as a live session goes. She is rendered, of the avatar's size, 2 m before a 70° camera; the nets'
answers were recorded once (:mod:`highfive.hil.bench.webcam_recorded`), and some of them can be left out. The world is
placed as a session does it, by a high five before the first one. She holds her hand up for a while, as people do before
a screen: it rests where she met her own partner, and so do the landmarks of that picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from highfive.calibration.placement import Placement, place_before_camera
from highfive.hil.bench.live_people import parts
from highfive.hil.bench.webcam_recorded import STEP, RecordedClip, load_clips
from highfive.hil.runtime.console import Bar
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.runtime.virtual_scheduler import VirtualScheduler
from highfive.hil.session.reach_settings import SEEN_LATE
from highfive.hil.session.session import RATE_HZ, Session, TickInput
from highfive.hil.sim.contact_check import ON_THE_PALM
from highfive.hil.sim.playout import KinematicPlayOut
from highfive.hil.trials.frame_link import FrameLink, SentFrames
from highfive.hil.trials.key_frames import contact_tick
from highfive.hil.trials.live_partner import LiveTrial
from highfive.hil.trials.partners import Partner
from highfive.hil.trials.screen_contact import across_view
from highfive.hil.trials.trial import run_trial
from highfive.hil.trials.trial_result import TrialResult
from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.markers.recognise import find_marker_set
from highfive.mocap_bridge.sources.camera_person import TO_ROOM, CameraPerson
from highfive.mocap_bridge.sources.camera_settings import KNUCKLES, MARKERS, SHOULDER, WRIST
from highfive.mocap_bridge.sources.live import LiveSource
from highfive.mocap_bridge.tracking.filter_settings import WEBCAM
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

BEFORE_S = 1.5
"""She stands still for so long before she moves."""
PRACTICE = ("neutral", "B2")
"""The high five that places her."""
RAISED_BELOW = 0.25
"""m below the shoulder from which on a wrist counts as raised."""
_AFTER = 24  # frames of 120 Hz after contact that still count


@dataclass(frozen=True)
class WebcamBenchOptions:
    """How the pictures come.

    Attributes:
        every: of the pictures at 15 Hz one in so many is looked at.
        latency_ms: from a picture until its landmarks arrive.
        hold_s: for so long the hand is held where it is to be met.
    """

    every: int = 1
    latency_ms: float = 80.0
    hold_s: float = 0.5


@dataclass(frozen=True)
class ScreenFelt:
    """What came of one high five: whether it touched as tracked, and m across the view from the true palm."""

    emotion: str
    cell: str
    met: bool
    across: float
    time_error: float

    @property
    def touched(self) -> bool:
        """Palm on true palm, as the screen shows it."""
        return self.met and self.across <= ON_THE_PALM


def bench_webcam(options: WebcamBenchOptions, bar: Bar) -> dict[str, Any]:
    """High fives touched as seen on the screen, and how far off the wrist was.

    Raises:
        HighFiveError: options that make no sense.
    """
    if not 1 <= options.every <= 4 or not 0.0 <= options.latency_ms <= 500.0 or not 0.0 <= options.hold_s <= 2.0:
        raise HighFiveError(f"{options}: expected every 1 to 4, 0 to 500 ms, and a hand that is held for 0 to 2 s")
    clips = load_clips()
    practice = next(clip for clip in clips if (clip.emotion, clip.cell) == PRACTICE)
    placement, marker_set = _placed(practice, options)
    advance = bar("high fives", len(clips))
    felt = []
    for clip in clips:
        felt.append(play(clip, options, placement, marker_set))
        advance()
    return {**_figures(felt), **wrist_errors(clips, options), "rate_hz": RATE_HZ / STEP / options.every}


def frames_of(clip: RecordedClip, options: WebcamBenchOptions, begins_ns: int) -> tuple[list[MarkerFrame], Array]:
    """What the source gives, from a time on, and where the camera is in the frames' room (3,), m."""
    person, frames = CameraPerson(), list[MarkerFrame]()
    period_ns = round(1e9 * options.every * STEP / RATE_HZ)
    shown = list(clip.landmarks[:: options.every])
    met = int(np.argmin(np.abs(clip.frames[:: options.every] - clip.contact_frame)))
    shown[met:met] = [shown[met]] * round(1e9 * options.hold_s / period_ns)
    still = round(1e9 * BEFORE_S) // period_ns
    for number in range(-still, len(shown)):
        captured_ns = begins_ns + round(1e9 * BEFORE_S) + number * period_ns
        found = replace(
            shown[max(number, 0)], number=number + still, captured_ms=1e-6 * captured_ns, took_ms=options.latency_ms
        )
        frames.append(person.take(found))
    return frames, person.camera_in_room


def _placed(clip: RecordedClip, options: WebcamBenchOptions) -> tuple[Placement, MarkerSet]:
    frames, camera = frames_of(clip, options, 0)
    points, valid = np.array([frame.positions for frame in frames]), np.array([frame.valid for frame in frames])
    marker_set = find_marker_set(MARKERS)
    watched = make_recording(RATE_HZ / STEP / options.every, MARKERS, points, valid)
    return place_before_camera(watched, marker_set, camera), marker_set


def play(clip: RecordedClip, options: WebcamBenchOptions, placement: Placement, marker_set: MarkerSet) -> ScreenFelt:
    """One high five as a live session plays it."""
    result, shown_s, camera = played(clip, options, placement, marker_set)
    if result.contact.met_time_ns is None:
        return ScreenFelt(clip.emotion, clip.cell, False, np.nan, np.nan)
    at = contact_tick(result)
    truth = CubicSpline(np.arange(len(clip.palm)) / RATE_HZ, placement.apply(clip.palm @ TO_ROOM.T + camera))
    true = truth(float(np.clip(_in_clip(shown_s[at], clip, options), 0.0, (len(clip.palm) - 1) / RATE_HZ)))
    across = float(across_view(result.palm[at], true, placement.apply(camera)))
    return ScreenFelt(clip.emotion, clip.cell, True, across, float(shown_s[at]) - clip.contact_frame / RATE_HZ)


def played(
    clip: RecordedClip, options: WebcamBenchOptions, placement: Placement, marker_set: MarkerSet
) -> tuple[TrialResult, Array, Array]:
    """What came of it, when each tick's pose was shown (T,), s after the clip began, and the camera in the frames' room
    (3,), m."""
    model, scene = parts()
    session = Session(model, {clip.emotion: 1.0}, marker_set, scene, tracking=WEBCAM, reach=SEEN_LATE)
    nothing = make_recording(RATE_HZ, MARKERS, np.zeros((0, len(MARKERS), 3)), np.zeros((0, len(MARKERS)), dtype=bool))
    partner = Partner("webcam", clip.emotion, clip.cell, False, nothing, marker_set, -1, None, None)
    inputs = list[TickInput]()
    with VirtualClock(0) as clock:
        begins = clock.now() + 100_000_000
        frames, camera = frames_of(clip, options, begins)
        link = FrameLink(clock, RATE_HZ / STEP / options.every, SentFrames(frames))
        with closing(LiveSource("webcam", lambda: link, None, link.rate_hz, VirtualScheduler(clock))) as source:
            zero = begins + round(1e9 * BEFORE_S)
            clock.wait_until(zero + round(1e6 * options.latency_ms))
            trial = LiveTrial(source, placement, clock)

            def noted() -> Any:
                for one in trial:
                    inputs.append(one)
                    yield one

            result = run_trial(0, partner, session, KinematicPlayOut(scene), noted(), trial.watch)
    return result, 1e-9 * np.array([one.at_ns - zero for one in inputs], dtype=float), camera


def _in_clip(seconds: float, clip: RecordedClip, options: WebcamBenchOptions) -> float:
    """The time in the clip, s, of a time since it began, in which the hand was held for a while."""
    frames = clip.frames[:: options.every]
    held = float(frames[np.argmin(np.abs(frames - clip.contact_frame))]) / RATE_HZ
    period = options.every * STEP / RATE_HZ
    return min(seconds, held) + max(seconds - held - round(options.hold_s / period) * period, 0.0)


def wrist_errors(clips: Sequence[RecordedClip], options: WebcamBenchOptions) -> dict[str, Any]:
    """How far raised wrists and knuckles are off by the filter alone: mm across the view and along it.

    ``along_less_bias`` is without what is constant over all of them: a placement takes that out.
    """
    gaps: dict[str, list[Array]] = {"wrist_mm": [], "knuckles_mm": []}
    for clip in clips:
        person = CameraPerson()
        rows = zip(clip.landmarks, clip.joints, clip.frames, strict=True)
        for found, truth, frame in list(rows)[:: options.every]:
            made = person.take(found)
            if truth[WRIST, 1] > truth[SHOULDER, 1] + RAISED_BELOW or frame > clip.contact_frame + _AFTER:
                continue
            for name, joint in (("wrist_mm", WRIST), ("knuckles_mm", KNUCKLES)):
                if made.valid[joint]:
                    gaps[name].append((made.positions[joint] - person.camera_in_room) @ TO_ROOM - truth[joint])
    return {name: _spread(np.array(rows)) for name, rows in gaps.items()}


def _spread(gaps: Array) -> dict[str, Any]:
    across, along = np.linalg.norm(gaps[:, :2], axis=1), np.abs(gaps[:, 2])
    steady = np.abs(gaps[:, 2] - np.median(gaps[:, 2]))
    named = {"across": across, "along": along, "along_less_bias": steady}
    return {name: _half_and_90(values) for name, values in named.items()} | {"pictures": len(gaps)}


def _half_and_90(values: Array) -> dict[str, float]:
    return {"median": round(1e3 * float(np.median(values)), 1), "p90": round(1e3 * float(np.percentile(values, 90)), 1)}


def _figures(felt: Sequence[ScreenFelt]) -> dict[str, Any]:
    met = [one for one in felt if one.met]
    across = np.array([one.across for one in met])
    late = 1e3 * np.abs([one.time_error for one in met])
    return {
        "trials": len(felt),
        "touched": sum(one.touched for one in felt),
        "met": len(met),
        "across_mm": _half_and_90(across) if met else None,
        "time_error_ms": round(float(np.median(late)), 1) if met else None,
        "missed": [f"{one.emotion}, {one.cell}" for one in felt if not one.touched],
        "rows": [
            {
                "emotion": one.emotion, "cell": one.cell, "met": one.met, "touched": one.touched,
                "across_mm": round(1e3 * one.across, 1) if one.met else None,
            }
            for one in felt
        ],
    }  # fmt: skip


def print_webcam(result: dict[str, Any]) -> None:
    """The figures, for people."""
    print(f"touched as seen on the screen  {result['touched']} of {result['trials']}, at {result['rate_hz']:g} Hz")
    if result["across_mm"] is not None:
        pair = result["across_mm"]
        print(f"palm from true palm, across    {pair['median']:.0f} / {pair['p90']:.0f} mm (median / 90 %)")
    for name in ("wrist", "knuckles"):
        row = result[f"{name}_mm"]
        shown = ", ".join(
            f"{key.replace('_', ' ')} {row[key]['median']:.0f} / {row[key]['p90']:.0f}" for key in list(row)[:3]
        )
        print(f"{name:<9} by the filter, mm      {shown}")
    if result["missed"]:
        print(f"missed: {'; '.join(result['missed'])}")
