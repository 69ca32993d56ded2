"""Words and rings drawn over the frames of a film."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pictures
from PIL import ImageColor, ImageDraw, ImageFont

from highfive.hil.report.colours import colour_of
from highfive.hil.sim.rendering import Image
from highfive.hil.trials.trial_result import TrialResult

if TYPE_CHECKING:
    from highfive.hil.arm.contact_outcome import ContactOutcome

_FONTS = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
_INK = (255, 255, 255)


def who_is_who(result: TrialResult, *, arm: bool) -> tuple[str, str]:
    """Who answers and in which style, and who is answered, for the two lines of a caption."""
    answers = "servo arm" if arm else "avatar"
    return (
        f"{answers}: {result.style}" if result.style else answers,
        "simulated person" if result.simulated else "person",
    )


class Captions:
    """Draws for frames of one height; sizes below are pixels of a frame 720 high."""

    def __init__(self, height: int) -> None:
        """Args: ``height`` of the frames, pixels."""
        self._scale = height / 720.0
        self._labels = lru_cache(maxsize=32)(self._label)

    def title(self, still: Image, *, simulated: bool, chosen: str = "") -> Image:
        """The opening: the name of the project over a darkened picture, and in a line which trials are ``chosen``."""
        page = Pictures.fromarray((still * 0.35).astype(np.uint8))
        draw, middle = ImageDraw.Draw(page), 0.5 * page.width
        who = "simulated people" if simulated else "people"
        draw.text((middle, 0.46 * page.height), "High Five", _INK, self._font(84, bold=True), anchor="mm")
        below = f"an avatar meets the raised hands of {who}"
        draw.text((middle, 0.58 * page.height), below, _INK, self._font(30), anchor="mm")
        draw.text((middle, 0.65 * page.height), chosen, _INK, self._font(22), anchor="mm")
        return np.array(page)

    def caption(
        self, frame: Image, result: TrialResult, *, slow: bool, after_contact: bool, arm: ContactOutcome | None = None
    ) -> None:
        """Who answers whom, and in which style, below on the left; speed, and how near palms came, on the right.

        Where ``arm`` says how the servo arm met the hand, it is the arm that is shown.
        """
        self._put(frame, self._labels(*who_is_who(result, arm=arm is not None), colour_of(result.style)), left=True)
        if slow:
            apart = f"palms {1e3 * result.error:.1f} mm apart, as tracked"
            if not np.isnan(result.touch_error):
                apart = f"{1e3 * result.touch_error:.1f} mm from the true palm as they touch"
            if arm is not None:
                apart = f"{1e3 * arm.error:.0f} mm from plate to palm" + ("" if arm.touched else ": missed")
            elif not result.contact.met:
                apart = "out of reach, " + apart if result.out_of_reach else "missed, " + apart
            self._put(frame, self._labels("¼ speed", apart if after_contact else "", ""), left=False)

    def ring(self, frame: Image, where: tuple[float, float], part: float) -> None:
        """A ring that grows from ``where`` (column, row) and fades as ``part`` goes from 0 to 1."""
        if part > 1.0:
            return
        radius, width = (14.0 + 90.0 * part**0.6) * self._scale, 3.0 * self._scale
        reach = radius + 2.0 * width
        rows = slice(max(int(where[1] - reach), 0), max(int(where[1] + reach), 0))
        columns = slice(max(int(where[0] - reach), 0), max(int(where[0] + reach), 0))
        patch = frame[rows, columns]
        if patch.size == 0:
            return
        y, x = np.mgrid[rows.start : rows.start + patch.shape[0], columns.start : columns.start + patch.shape[1]]
        away = np.abs(np.hypot(x - where[0], y - where[1]) - radius)
        alpha = 0.8 * (1.0 - part) * np.clip(1.5 - away / width, 0.0, 1.0)[..., None]
        patch[:] = (patch + alpha * (255.0 - patch)).astype(np.uint8)

    def _font(self, size: float, *, bold: bool = False) -> ImageFont.FreeTypeFont:
        return ImageFont.truetype(_FONTS / ("DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"), size * self._scale)

    def _label(self, first: str, second: str, colour: str) -> NDArray[np.uint8]:
        """RGBA picture of a large and a small line on a dark plate, with a bar of ``colour`` on its left."""
        big, small, s = self._font(34, bold=True), self._font(22), self._scale
        bar = 8 * s if colour else 0.0
        width = int(max(big.getlength(first), small.getlength(second)) + 36 * s + bar)
        plate = Pictures.new("RGBA", (width, int((92 if second else 58) * s)), (20, 24, 28, 165))
        draw = ImageDraw.Draw(plate)
        if colour:
            draw.rectangle((0, 0, bar, plate.height), ImageColor.getrgb(colour))
        draw.text((bar + 18 * s, 30 * s), first, _INK, big, anchor="lm")
        draw.text((bar + 18 * s, 68 * s), second, _INK, small, anchor="lm")
        return np.array(plate)

    def _put(self, frame: Image, label: NDArray[np.uint8], *, left: bool) -> None:
        margin = int(36 * self._scale)
        height, width = label.shape[:2]
        top, start = frame.shape[0] - margin - height, margin if left else frame.shape[1] - margin - width
        patch = frame[top : top + height, start : start + width]
        alpha = label[..., 3:].astype(np.uint16)
        patch[:] = ((patch * (255 - alpha) + label[..., :3] * alpha) // 255).astype(np.uint8)
