"""Films and picture strips: frames of the renderer with captions, as H.264 MP4 and PNG."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from PIL import Image as Pillow
from PIL import ImageDraw, ImageFont

from hil.sim.rendering import Image
from model.errors import HighFiveError

INK, PAPER, ACCENT = (255, 255, 255), (28, 32, 38), (244, 162, 60)


@dataclass(frozen=True)
class Overlay:
    """What is written over a frame.

    Attributes:
        caption: lower left, such as the emotion.
        note: smaller, below the caption.
        progress: fraction of the film so far, shown as a thin bar at the bottom; None for no bar.
        slow_motion: by how much the frame is slowed down, 1 for real time.
    """

    caption: str = ""
    note: str = ""
    progress: float | None = None
    slow_motion: float = 1.0


def draw_overlay(frame: Image, overlay: Overlay) -> Image:
    """The frame (height, width, 3) with its overlay; the input is not changed."""
    picture = Pillow.fromarray(frame)
    pen = ImageDraw.Draw(picture, "RGBA")
    height, width = frame.shape[:2]
    margin = max(height // 40, 6)
    if overlay.caption:
        large, small = _font(height // 18), _font(height // 34)
        wide = max(large.getlength(overlay.caption), small.getlength(overlay.note))
        tall = height // 18 + (height // 28 if overlay.note else 0)
        box = (margin, height - 3 * margin - tall, 3 * margin + wide, height - 1.5 * margin)
        pen.rounded_rectangle(box, radius=margin, fill=(*PAPER, 170))
        pen.text((2 * margin, box[1] + 0.75 * margin), overlay.caption, font=large, fill=INK, anchor="lt")
        pen.text((2 * margin, box[3] - 0.75 * margin), overlay.note, font=small, fill=(*INK, 210), anchor="ls")
    if overlay.slow_motion > 1.0:
        font, words = _font(height // 28), f"slow motion {overlay.slow_motion:g}x"
        left = width - 3 * margin - font.getlength(words)
        box = (left, margin, width - margin, 2 * margin + height // 24)
        pen.rounded_rectangle(box, radius=margin, fill=(*ACCENT, 230))
        pen.text((left + margin, 0.5 * (box[1] + box[3])), words, font=font, fill=PAPER, anchor="lm")
    if overlay.progress is not None:
        thickness = max(height // 160, 2)
        pen.rectangle((0, height - thickness, width, height), fill=(*PAPER, 120))
        pen.rectangle((0, height - thickness, width * float(overlay.progress), height), fill=ACCENT)
    return np.asarray(picture)


def _font(size: int) -> ImageFont.FreeTypeFont:
    # Pillow's own font: looks the same on every machine.
    return ImageFont.load_default(size=max(size, 9))  # pyright: ignore[reportReturnType]


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
    writer.send(None)
    return writer


def picture_strip(path: Path, images: Sequence[Image], captions: Sequence[str]) -> None:
    """Writes images of one height side by side as a PNG, each with a caption below it.

    Raises:
        HighFiveError: no images, or not as many captions as images.
    """
    if not images or len(images) != len(captions):
        raise HighFiveError(f"a picture strip needs a caption an image: got {len(images)} and {len(captions)}")
    gap, height = 6, images[0].shape[0]
    band = max(height // 9, 18)
    width = sum(image.shape[1] for image in images) + gap * (len(images) - 1)
    strip = Pillow.new("RGB", (width, height + band), (255, 255, 255))
    pen, left, font = ImageDraw.Draw(strip), 0, _font(band // 2)
    for image, caption in zip(images, captions, strict=True):
        strip.paste(Pillow.fromarray(image), (left, 0))
        pen.text((left + image.shape[1] / 2, height + band / 2), caption, font=font, fill=PAPER, anchor="mm")
        left += image.shape[1] + gap
    strip.save(path)
