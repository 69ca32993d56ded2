"""The film of a session, the median high five of each style, and the picture strips of its report."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled bindings ship no type stubs.)

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from hil.captions import Captions
from hil.moments import moments_of, showpieces
from hil.sim.rendering import Image, NoPictures, Renderer, open_renderer
from hil.sim.scene import Scene
from hil.sim.video import write_video
from hil.trial import TrialResult
from model.errors import HighFiveError
from model.rotations import Array


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
_RING = 20
"""Ticks that the ring around the contact lasts."""

Progress = Callable[[str, int], Callable[[], None]]
"""Told a label and the number of steps, gives a function to call after each."""


@dataclass(frozen=True)
class Shot:
    """Ticks of a trial from one camera, one a frame; ``contact`` is the tick at which the palms meet."""

    result: TrialResult
    camera: str
    ticks: range
    contact: int
    slow: bool


@dataclass(frozen=True)
class Strip:
    """Pictures of one trial: label and picture of each moment."""

    result: TrialResult
    pictures: tuple[tuple[str, Image], ...]


class _Stage:
    """Puts avatar and person of a trial into the scene."""

    def __init__(self, scene: Scene) -> None:
        self._scene, self.data = scene, scene.make_data()
        self._result: TrialResult | None = None
        self._tick = 0

    def show(self, result: TrialResult, tick: int) -> mujoco.MjData:
        # The person's feet follow the trunk on a leash, so where they are depends on all ticks before.
        if result is not self._result or tick < self._tick:
            self.data = self._scene.make_data()
            self._result, self._tick = result, -1
        for i in range(self._tick + 1, tick + 1):
            self._scene.set_person(self.data, result.people[i])
        self._tick = tick
        self._scene.set_pose(self.data, result.poses[tick])
        mujoco.mj_kinematics(self._scene.model, self.data)
        return self.data


def picture_strips(scene: Scene, results: Sequence[TrialResult]) -> list[Strip] | NoPictures:
    """Five moments of each style's median trial, 480 × 400; or why there are none. ``scene`` is built ``visible``."""
    opened = open_renderer(scene, 640, 400)
    if isinstance(opened, NoPictures):
        return opened
    with opened as renderer:
        stage = _Stage(scene)
        return [
            Strip(r, tuple((label, _drawn(renderer, stage, r, i)) for label, i in _moments(r)))
            for r in showpieces(results)
        ]


def _moments(result: TrialResult) -> list[tuple[str, int]]:
    at = moments_of(result)
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


def _drawn(renderer: Renderer, stage: _Stage, result: TrialResult, tick: int) -> Image:
    picture = renderer.render(stage.show(result, tick), "wide")
    return np.ascontiguousarray(picture[:, 80:560])


def make_film(
    scene: Scene, results: Sequence[TrialResult], path: Path, progress: Progress = lambda label, total: lambda: None
) -> Path | NoPictures:
    """Writes an MP4 of each style's median high five, in real time and then close by at a quarter of the speed.

    Args:
        scene: built ``visible``.
        results: at least one trial.
        path: where the film goes; nothing is left there if it fails.
        progress: told the number of frames.

    Returns:
        ``path``, or why there is no film: no OpenGL, or no trial.

    Raises:
        HighFiveError: the file cannot be written.
    """
    shown = showpieces(results)
    shots = [shot for result in shown for shot in _shots(result)]
    if not shots:
        return NoPictures("film left out: no trial was finished")
    count = _TITLE + sum(len(shot.ticks) for shot in shots)
    stage = _Stage(scene)
    opened = _open(scene, stage, shots[0], count)
    if isinstance(opened, NoPictures):
        return opened
    with opened as renderer:
        frames = _counted(_frames(renderer, stage, shots, several=len(results) > len(shown)), progress("film", count))
        partial = path.with_name(f"{path.stem}.partial{path.suffix}")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_video(partial, frames, FPS)
            os.replace(partial, path)
        except OSError as error:
            raise HighFiveError(f"cannot write the film {path}: {error.strerror or error}") from None
        finally:
            with suppress(OSError):
                partial.unlink(missing_ok=True)
    return path


def _shots(result: TrialResult) -> tuple[Shot, Shot]:
    at = moments_of(result)
    start, end = max(at.start - _BEFORE, 0), min(at.release + _AFTER, at.end)
    slow = range(max(at.contact - _SLOW_BEFORE, 0), min(at.contact + _SLOW_AFTER, at.end) + 1)
    # Counted from contact, so that one frame shows the contact itself.
    real = range(at.contact - (at.contact - start) // TICKS_A_FRAME * TICKS_A_FRAME, end + 1, TICKS_A_FRAME)
    return Shot(result, "wide", real, at.contact, False), Shot(result, "close", slow, at.contact, True)


def _open(scene: Scene, stage: _Stage, shot: Shot, count: int) -> Renderer | NoPictures:
    """A renderer of the best quality at which ``count`` frames can be drawn in the budget."""
    data = stage.show(shot.result, shot.ticks[0])
    for quality in _QUALITIES:
        renderer = open_renderer(scene, *quality.size, shadows=quality.shadows, smooth=quality.smooth)
        if isinstance(renderer, NoPictures) or quality is _QUALITIES[-1]:
            return renderer
        renderer.render(data, shot.camera)  # the first one also uploads everything
        start = time.perf_counter()
        for _ in range(3):
            renderer.render(data, shot.camera)
        if count * (time.perf_counter() - start) / 3.0 <= BUDGET_S:
            return renderer
        renderer.close()
    raise AssertionError("the last quality is taken however slow it is")


def _frames(renderer: Renderer, stage: _Stage, shots: Sequence[Shot], *, several: bool) -> Iterator[Image]:
    still = renderer.render(stage.show(shots[0].result, shots[0].ticks[0]), shots[0].camera)
    captions = Captions(still.shape[0])
    chosen = "of each style the median high five of this session: neither its best nor its worst" * several
    title = captions.title(still, simulated=all(shot.result.simulated for shot in shots), chosen=chosen)
    for i in range(_TITLE):
        yield _mixed(np.zeros_like(title), title, (i + 1) / _DARK)
    before, left = title, sum(len(shot.ticks) for shot in shots)
    for shot in shots:
        frame = before
        for i, tick in enumerate(shot.ticks):
            frame = renderer.render(stage.show(shot.result, tick), shot.camera).copy()
            since = tick - shot.contact
            if shot.slow and shot.result.contact.met and since >= 0:
                where = pixel_of(stage.data, shot.camera, shot.result.contact.where, frame.shape[:2])
                captions.ring(frame, where, since / _RING)
            captions.caption(frame, shot.result, slow=shot.slow, after_contact=since >= 0)
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
