"""Films: frames of the renderer as H.264 MP4."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from pathlib import Path

import imageio_ffmpeg
import numpy as np

from highfive.hil.sim.rendering import Image
from highfive.model.errors import HighFiveError


def write_video(path: Path, frames: Iterable[Image], frames_per_second: float = 30.0) -> int:
    """Writes frames (height, width, 3) of one size as an H.264 MP4 that browsers play; returns how many there were.

    An odd last row or column is left out: the format needs even sizes.

    Raises:
        HighFiveError: there is no frame, or the file cannot be written.
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise HighFiveError(f"cannot write {path}: there is no folder {path.parent}; make it first")
    writer, count = None, 0
    try:
        for frame in frames:
            even = np.ascontiguousarray(frame[: frame.shape[0] // 2 * 2, : frame.shape[1] // 2 * 2])
            if writer is None:
                writer = _open(path, even, frames_per_second)
            writer.send(even)
            count += 1
    except OSError as error:
        reason = " ".join(str(error).split())[:200]
        raise HighFiveError(f"cannot write {path}: {reason}; is the disk full or the place read-only?") from None
    finally:
        if writer is not None:
            writer.close()
    if count == 0:
        raise HighFiveError(f"no frames for {path}; a film needs at least one")
    return count


def _open(path: Path, frame: Image, frames_per_second: float):
    size = frame.shape[1], frame.shape[0]
    options = ["-crf", "20", "-preset", "medium", "-movflags", "+faststart"]
    writer = imageio_ffmpeg.write_frames(
        str(path),
        size,
        fps=frames_per_second,  # pyright: ignore[reportArgumentType]
        codec="libx264",
        pix_fmt_out="yuv420p",
        macro_block_size=2,
        quality=None,  # pyright: ignore[reportArgumentType] (leaves it to -crf)
        output_params=options,
        ffmpeg_log_level="error",
    )
    with warnings.catch_warnings():
        # JAX warns of every fork; this one becomes ffmpeg at once and touches nothing of ours.
        warnings.filterwarnings("ignore", "os.fork", RuntimeWarning)
        writer.send(None)
    return writer
