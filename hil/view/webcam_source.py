"""The webcam of a page as a live source: landmarks that the page sends, made into frames of joint centres."""

from __future__ import annotations

from collections.abc import Sequence

from highfive.hil.view.live_page import LivePage
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.camera_person import CameraPerson
from highfive.mocap_bridge.sources.live import LiveSource
from highfive.mocap_bridge.sources.scheduler import THREADS, Scheduler
from highfive.mocap_bridge.wire.errors import LinkError
from highfive.mocap_bridge.wire.landmarks import decode_landmarks

USUAL_HZ = 5.0
"""Pictures a second until some have come."""


class WebcamLink:
    """The page's end, as a :class:`highfive.mocap_bridge.sources.live.Link`."""

    rate_hz = 0.0

    def __init__(self, page: LivePage, person: CameraPerson) -> None:
        """Takes what ``page`` gets, and follows ``person``, who outlives a connection."""
        self._page, self._person = page, person

    def receive(self, timeout_s: float) -> Sequence[MarkerFrame]:
        """The frames of the pictures that have come; what is wrong beside them is dropped.

        Raises:
            LinkError: the page's server is gone, or nothing of what came are landmarks.
        """
        assert self._page.tracked is not None
        found = self._page.tracked.wait(timeout_s)
        if not found and not self._page.alive:
            raise LinkError("the page's server has ended")
        frames, wrong = list[MarkerFrame](), None
        for data in found:
            try:
                frames.append(self._person.take(decode_landmarks(data)))
            except LinkError as error:
                wrong = error
        if wrong is not None and not frames:
            raise wrong
        return frames

    def close(self) -> None:
        """The page stays."""


class WebcamSource(LiveSource):
    """Follows whoever stands before the page's webcam.

    Attributes:
        person: as the filter has her.
    """

    def __init__(self, page: LivePage, person: CameraPerson, scheduler: Scheduler = THREADS) -> None:
        """Begins to listen."""
        self.person = person
        super().__init__("webcam", lambda: WebcamLink(page, person), None, USUAL_HZ, scheduler)
