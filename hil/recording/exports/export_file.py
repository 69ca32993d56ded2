"""A file that is to be written: its name is known before anything is worked out for it."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from highfive.hil.recording.trial_spans import TrialSpan
from highfive.model.files import write_whole


@dataclass(frozen=True)
class ExportFile:
    """One file of an export.

    Attributes:
        name: below the folder of the export, with ``/``.
        write: makes it under a path; raises ``OSError`` or ``HighFiveError`` where it cannot be written.
        frames: ticks or frames in it; 0 where it holds none.
    """

    name: str
    write: Callable[[Path], None]
    frames: int


def of_bytes(name: str, content: Callable[[], bytes], frames: int = 0) -> ExportFile:
    """A file whose content is made when it is written."""
    return ExportFile(name, lambda path: write_whole(path, content()), frames)


def trial_names(stem: str, spans: Sequence[TrialSpan], ending: str) -> list[str]:
    """``STEM_trial01_happy.bvh`` and so on, the first high five being 1; a second one of a number is ``_trial01-2``.

    The avatar's style ends the name, or the person's emotion where no style was recorded.
    """
    numbers = [span.number for span in spans]
    times = [numbers[:place].count(number) + 1 for place, number in enumerate(numbers)]
    return [
        f"{stem}_trial{span.number + 1:02d}{f'-{time}' if time > 1 else ''}{_style(span)}{ending}"
        for span, time in zip(spans, times, strict=True)
    ]


def _style(span: TrialSpan) -> str:
    """As a part of a name: without blanks, signs and strokes, which a mixture of styles has."""
    words = re.findall(r"[\w.]+", span.text("style") or span.text("emotion"))
    return f"_{'-'.join(words)}" if words else ""
