"""Recording what a live system sends: a raw file as it comes, a C3D file at the end, and after a crash."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from itertools import count
from pathlib import Path

from highfive.hil.runtime.folders import check_file
from highfive.mocap_bridge.files.take_file import ENDING, NoFrames, TakeWriter, being_written, take_to_c3d
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.model.errors import HighFiveError


def recover(path: Path) -> str:
    """Saves what a crash left of the recording ``path``, and says so in a line; '' where there is nothing.

    Raises:
        HighFiveError: another process is recording to that file, or what was left cannot be saved; it stays where it
            is, and is in the way of another recording to ``path``.
    """
    raw = path.with_name(path.name + ENDING)
    if not raw.exists():
        return ""
    if being_written(raw):
        raise HighFiveError(f"another process is recording to {path}; give another --record")
    saved = _free(path)
    try:
        _, came = take_to_c3d(raw, saved)
    except NoFrames:
        raw.unlink()
        return ""
    except HighFiveError as error:
        raise HighFiveError(
            f"an earlier recording to {path} cannot be saved: {error}; or give another --record"
        ) from None
    raw.unlink()
    return f"an earlier recording to {path} had not been finished: {came} frames of it are now in {saved}"


def _free(path: Path) -> Path:
    """``take-recovered.c3d``, or with a number behind it, whichever is not there yet."""
    names = (f"{path.stem}-recovered{'' if n == 1 else f'-{n}'}{path.suffix}" for n in count(1))
    return next(saved for name in names if not (saved := path.with_name(name)).exists())


class Recorder:
    """Takes every frame (see :data:`highfive.mocap_bridge.sources.tap.Tap`); a full disk ends the recording, not the
    stream.
    """

    def __init__(self, path: Path, overwrite: bool = False):
        """Begins the raw file; a C3D file that may be replaced stays until the recording is finished.

        Raises:
            HighFiveError: the C3D file is there already, is recorded to by another process, or cannot be written.
        """
        if path.suffix.lower() != ".c3d":
            raise HighFiveError(f"--record {path}: a recording is a C3D file; call it {path.with_suffix('.c3d')}")
        if not path.parent.is_dir():
            raise HighFiveError(f"--record {path}: no folder {path.parent}")
        check_file(path, overwrite, "--record")
        self._path, self._overwrite = path, overwrite
        self._lock = threading.Lock()
        self._writer = TakeWriter(path.with_name(path.name + ENDING))
        self.trouble = ""

    @property
    def frames(self) -> int:
        """Frames written so far."""
        return self._writer.frames

    def __call__(self, frames: Sequence[MarkerFrame], rate_hz: float) -> None:
        """Writes frames down."""
        with self._lock:
            if self.trouble:
                return
            try:
                self._writer.add(frames, rate_hz)
            except (OSError, ValueError) as error:
                self.trouble = f"recording stopped: {getattr(error, 'strerror', None) or error}"

    def finish(self) -> str:
        """Makes the C3D file and says so in a line; a recording without a frame leaves nothing.

        Raises:
            HighFiveError: the C3D file cannot be written; the raw file stays.
        """
        with self._lock:
            self._writer.close()
        raw = self._writer.path
        if not self.frames:
            raw.unlink(missing_ok=True)
            return ""
        frames, came = take_to_c3d(raw, self._path, replace=self._overwrite)
        raw.unlink()
        return f"{self._path}: {frames} frames, {frames - came} of them gaps"
