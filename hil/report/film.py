"""The film of a session, the median high five of each style, and the picture strips of its report."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from highfive.hil.report.captions import Captions
from highfive.hil.report.stage import Stage, arm_stage, avatar_stage
from highfive.hil.session.session import RATE_HZ
from highfive.hil.sim.rendering import Image, NoPictures, Renderer, open_renderer
from highfive.hil.sim.scene import Scene
from highfive.hil.sim.video import write_video
from highfive.hil.sim.viewpoint import HANDS
from highfive.hil.trials.key_frames import key_frames_of, showpieces
from highfive.hil.trials.trial_result import TrialResult
from highfive.model.errors import HighFiveError
from highfive.model.files import written_whole
from highfive.model.geometry.rotations import Array

if TYPE_CHECKING:
    from highfive.hil.arm.arm_trial import ArmTrial
    from highfive.hil.arm.contact_outcome import ContactOutcome
    from highfive.hil.sim.arm_body import ArmTwin


@dataclass(frozen=True)
class _Quality:
    size: tuple[int, int]
    shadows: bool
    smooth: bool


FPS = 30
TICKS_A_FRAME = 4
"""Of 120 Hz; a quarter of the speed shows every tick."""
BUDGET_S = 35.0
"""Rendering may take so long; what the machine cannot draw in it is drawn smaller and plainer."""
_QUALITIES = (
    _Quality((1280, 720), shadows=True, smooth=True),
    _Quality((1280, 720), shadows=False, smooth=True),
    _Quality((960, 540), shadows=False, smooth=False),
)
"""Best first."""
_BEFORE, _AFTER = 48, 110
"""Ticks shown before the person starts, and after the palms part."""
_SLOW_BEFORE, _SLOW_AFTER = 44, 36
"""Ticks shown in slow motion before and after contact."""
_FADE, _TITLE, _DARK = 8, 40, 14
"""Frames of a change of camera, of the title, and of the fades from and to black."""
_FRAMED = 0.1
"""m, from :data:`highfive.hil.sim.viewpoint.HANDS`: palms that meet within it are well inside a close picture."""
_RING = 20
"""Ticks that the ring around the contact lasts."""

Progress = Callable[[str, int], Callable[[], None]]
"""Given a label and the number of steps, gives a function to call after each."""


@dataclass(frozen=True)
class Shot:
    """Ticks of a trial from one camera, one per frame; ``contact`` is the tick at which palms, or palm and plate, meet.

    Where the servo arm is drawn instead of the avatar, ``arm`` is how it met the hand.
    """

    result: TrialResult
    camera: str
    ticks: range
    contact: int
    slow: bool
    arm: ContactOutcome | None = None

    @property
    def shift(self) -> Array | None:
        """(3,) m, of the camera: what meets apart from where palms usually meet is not cut off."""
        if not self.slow:
            return None
        off = self.result.contact.where - HANDS
        return off - np.clip(off, -_FRAMED, _FRAMED)


@dataclass(frozen=True)
class Strip:
    """Pictures of one trial: label and picture of each moment; of the servo ``arm`` or of the avatar."""

    result: TrialResult
    pictures: tuple[tuple[str, Image], ...]
    arm: bool = False


@dataclass(frozen=True)
class Arms:
    """What the servo arm did, by the numbers of the trials, and a visible scene with it instead of the avatar."""

    scene: ArmTwin
    trials: Mapping[int, ArmTrial]


@dataclass(frozen=True)
class _Set:
    """Where shots are taken."""

    stage: Stage
    renderer: Renderer
    quality: _Quality

    def draw(self, shot: Shot, tick: int) -> Image:
        return self.renderer.render(self.stage.show(shot.result, tick), shot.camera, shot.shift)

    def close(self) -> None:
        self.renderer.close()


def picture_strips(scene: Scene, results: Sequence[TrialResult], arms: Arms | None = None) -> list[Strip] | NoPictures:
    """Five moments of each style's median trial, 480 × 400; or why there are none.

    Args:
        scene: built ``visible``.
        results: the trials.
        arms: what the servo arm did in them; it gets strips of its own.
    """
    shown = showpieces(results)
    strips = _strips(avatar_stage(scene), shown, _moments)
    if arms is None or isinstance(strips, NoPictures):
        return strips
    met = [result for result in shown if result.number in arms.trials]
    more = _strips(arm_stage(arms.scene, arms.trials), met, lambda r: _arm_moments(r, arms.trials[r.number]))
    if isinstance(more, NoPictures):
        return strips
    both = [*strips, *(replace(strip, arm=True) for strip in more)]
    return sorted(both, key=lambda strip: shown.index(strip.result))


def _strips(
    stage: Stage, results: Sequence[TrialResult], moments: Callable[[TrialResult], list[tuple[str, int]]]
) -> list[Strip] | NoPictures:
    opened = open_renderer(stage.scene, 640, 400)
    if isinstance(opened, NoPictures):
        return opened
    with opened as renderer:
        return [Strip(r, tuple((label, _drawn(renderer, stage, r, i)) for label, i in moments(r))) for r in results]


def _moments(result: TrialResult) -> list[tuple[str, int]]:
    at = key_frames_of(result)
    label = "palms meet" if result.contact.met else "nearest"
    just_before = max(at.contact - 12, at.half_way)
    after = min(at.contact + 36, at.end)
    chosen = {
        "start": at.start,
        "half way": at.half_way,
        "just before": just_before,
        label: at.contact,
        "release": after,
    }
    return list(chosen.items())


def _arm_moments(result: TrialResult, arm: ArmTrial) -> list[tuple[str, int]]:
    """The same moments, but for when plate and palm meet."""
    moments = dict(_moments(result))
    start, half_way, just_before, _, after = moments.values()
    met = min(_arm_contact(arm), len(result.times) - 1)
    label = "plate and palm meet" if arm.met.touched else "when the avatar meets it"
    late = min(max(after, met + 12), len(result.times) - 1)
    ticks = (start, half_way, min(just_before, met - 1), met, late)
    return list(zip(("start", "half way", "just before", label, "release"), (max(t, 0) for t in ticks), strict=True))


def _arm_contact(arm: ArmTrial) -> int:
    return arm.due + (round(arm.met.late * RATE_HZ) if arm.met.touched else 0)


def _drawn(renderer: Renderer, stage: Stage, result: TrialResult, tick: int) -> Image:
    picture = renderer.render(stage.show(result, tick), "wide")
    return np.ascontiguousarray(picture[:, 80:560])


def make_film(
    scene: Scene,
    results: Sequence[TrialResult],
    path: Path,
    progress: Progress = lambda label, total: lambda: None,
    arms: Arms | None = None,
) -> Path | NoPictures:
    """Writes an MP4 of each style's median high five, in real time and then close by at a quarter of the speed.

    Args:
        scene: built ``visible``.
        results: at least one trial.
        path: where the film goes; nothing is left there if it fails.
        progress: given the number of frames.
        arms: what the servo arm did in them; it is shown after the avatar, likewise.

    Returns:
        ``path``, or why there is no film: no OpenGL, or no trial.

    Raises:
        HighFiveError: the file cannot be written.
    """
    shown = showpieces(results)
    trials = {} if arms is None else arms.trials
    shots = [shot for result in shown for shot in _shots(result, trials.get(result.number))]
    if not shots:
        return NoPictures("film left out: no trial was finished")
    count = _TITLE + sum(len(shot.ticks) for shot in shots)
    opened = _open(avatar_stage(scene), shots[0], count)
    if isinstance(opened, NoPictures):
        return opened
    with ExitStack() as stack:
        sets = [stack.enter_context(closing(opened))]
        if arms is not None:
            other = _set(arm_stage(arms.scene, arms.trials), opened.quality)
            if isinstance(other, NoPictures):
                return other
            sets.append(stack.enter_context(closing(other)))
        frames = _counted(_frames(sets, shots, several=len(results) > len(shown)), progress("film", count))
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with written_whole(path) as partial:
                write_video(partial, frames, FPS)
        except OSError as error:
            raise HighFiveError(f"cannot write the film {path}: {error.strerror or error}") from None
    return path


def _shots(result: TrialResult, arm: ArmTrial | None) -> list[Shot]:
    at = key_frames_of(result)
    start, end = max(at.start - _BEFORE, 0), min(at.release + _AFTER, at.end)
    slow = range(max(at.contact - _SLOW_BEFORE, 0), min(at.contact + _SLOW_AFTER, at.end) + 1)
    # Counted from contact, so that one frame shows the contact itself.
    real = range(at.contact - (at.contact - start) // TICKS_A_FRAME * TICKS_A_FRAME, end + 1, TICKS_A_FRAME)
    shots = [Shot(result, "wide", real, at.contact, False), Shot(result, "close", slow, at.contact, True)]
    if arm is None:
        return shots
    met = min(_arm_contact(arm), at.end)
    slow = range(max(met - _SLOW_BEFORE, 0), min(met + _SLOW_AFTER, at.end) + 1)
    return [*shots, Shot(result, "wide", real, met, False, arm.met), Shot(result, "close", slow, met, True, arm.met)]


def _open(stage: Stage, shot: Shot, count: int) -> _Set | NoPictures:
    """The avatar's, of the best quality at which ``count`` frames can be drawn in the budget."""
    data = stage.show(shot.result, shot.ticks[0])
    for quality in _QUALITIES:
        opened = _set(stage, quality)
        if isinstance(opened, NoPictures) or quality is _QUALITIES[-1]:
            return opened
        opened.renderer.render(data, shot.camera)  # the first one also uploads everything
        start = time.perf_counter()
        for _ in range(3):
            opened.renderer.render(data, shot.camera)
        if count * (time.perf_counter() - start) / 3.0 <= BUDGET_S:
            return opened
        opened.close()
    raise AssertionError("the last quality is taken however slow it is")


def _set(stage: Stage, quality: _Quality) -> _Set | NoPictures:
    renderer = open_renderer(stage.scene, *quality.size, shadows=quality.shadows, smooth=quality.smooth)
    return renderer if isinstance(renderer, NoPictures) else _Set(stage, renderer, quality)


def _frames(sets: Sequence[_Set], shots: Sequence[Shot], *, several: bool) -> Iterator[Image]:
    """The avatar's set first, then the arm's, if there is one."""
    still = sets[0].draw(shots[0], shots[0].ticks[0])
    captions = Captions(still.shape[0])
    chosen = "of each style the median high five of this session" * several
    title = captions.title(still, simulated=all(shot.result.simulated for shot in shots), chosen=chosen)
    for i in range(_TITLE):
        yield _mixed(np.zeros_like(title), title, (i + 1) / _DARK)
    before, left = title, sum(len(shot.ticks) for shot in shots)
    for shot in shots:
        here, frame = sets[shot.arm is not None], before
        for i, tick in enumerate(shot.ticks):
            frame = here.draw(shot, tick).copy()
            since = tick - shot.contact
            if shot.slow and shot.arm is None and shot.result.contact.met and since >= 0:
                where = pixel_of(here.stage.data, shot.camera, shot.result.contact.where, frame.shape[:2])
                captions.ring(frame, where, since / _RING)
            captions.caption(frame, shot.result, slow=shot.slow, after_contact=since >= 0, arm=shot.arm)
            yield _mixed(np.zeros_like(frame), _mixed(before, frame, (i + 1) / _FADE), left / _DARK)
            left -= 1
        before = frame


def pixel_of(data: mujoco.MjData, camera: str, point: Array, size: tuple[int, int]) -> tuple[float, float]:
    """Column and row at which ``point`` (3,) m of the world is in a picture of ``size`` (height, width)."""
    model, height = data.model, size[0]
    number = model.camera(camera).id
    x, y, z = (point - data.cam_xpos[number]) @ data.cam_xmat[number].reshape(3, 3)
    focal = 0.5 * height / np.tan(0.5 * np.radians(model.cam_fovy[number]))
    return 0.5 * size[1] + focal * x / -z, 0.5 * height - focal * y / -z


def _mixed(before: Image, after: Image, part: float) -> Image:
    """Part of the way from one picture to the other; all of it from 1 on."""
    if part >= 1.0:
        return after
    weight = round(256 * part)
    return ((before.astype(np.uint16) * (256 - weight) + after.astype(np.uint16) * weight) >> 8).astype(np.uint8)


def _counted(frames: Iterator[Image], advance: Callable[[], None]) -> Iterator[Image]:
    for frame in frames:
        yield frame
        advance()
