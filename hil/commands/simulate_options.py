"""What a session is asked to play."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from highfive.hil.publish.wanted import Wanted
from highfive.model import DEFAULT_MODEL

if TYPE_CHECKING:
    from highfive.hil.arm.arm_options import ArmOptions


@dataclass(frozen=True)
class PageOptions:
    """Where the live page is.

    Attributes:
        port: of this machine; None for the usual one, or a free one where that is in use.
        open_browser: opens the page here at once.
        https: served to the whole network, with a certificate of its own.
        port_name: the option that chooses the port.
    """

    port: int | None = None
    open_browser: bool = True
    https: bool = False
    port_name: str = "--port"

    @property
    def host(self) -> str:
        """The address that is listened on: this machine's own, or all that it has."""
        return "0.0.0.0" if self.https else "127.0.0.1"


@dataclass(frozen=True)
class WebcamOptions:
    """The person before a webcam (``source`` is then ``webcam``).

    Attributes:
        height: hers, m; None for a usual one.
        field_of_view: across the camera's picture, °; None for a usual one.
        video: a file that a browser without a window takes for its camera (.mjpeg or .y4m); None for a real camera.
    """

    height: float | None = None
    field_of_view: float | None = None
    video: Path | None = None


@dataclass(frozen=True)
class SimulateOptions:
    """What to simulate.

    Attributes:
        trials: number of trials; None is one for every emotion and cell, or one per style for a recording.
        emotions: emotions to go through; empty is all that the model knows.
        cells: cells of the grid to go through; empty is all.
        style: style weights by emotion, used in every trial instead of its emotion; empty for none.
        source: a C3D file of a real person, or the address of a live system; None simulates a person.
        human: prefix of that person's markers.
        marker_set: name or path of that person's marker set; None finds one.
        model: the model's file, or the name of a model of one's own.
        data: folder that such a model learns from.
        seed: seed of the simulated people.
        lost: s before palms would meet, from which on nothing is seen of the person; None for never.
        physics: drive the avatar by actuators against contact forces.
        correct: correct the palm.
        pictures: draw the film and the pictures.
        film_view: from where; see :func:`highfive.hil.sim.viewpoint.viewpoint`.
        place: keeps where a live person stands, for the next session; None for not.
        latency_ms: what cameras, network and screen take beyond what a live source says of itself.
        latencies: of streams, as ``calibrate event`` measured them; None for none.
        view: the live page that shows it; None for none.
        headset: registration of a headset that the live person wears beside a lab's system; None for none.
        webcam: where the source is the webcam of the live page.
        publish: the ways in which other programs hear it.
        publish_network: also those on other computers.
        record_lsl: names of LSL streams that are recorded beside it.
        arm: a servo arm that takes part, at the pace of the clock; None for none.
        overwrite: write into a folder that holds something.
    """

    trials: int | None = None
    emotions: tuple[str, ...] = ()
    cells: tuple[str, ...] = ()
    style: Mapping[str, float] | None = None
    source: str | None = None
    human: str | None = None
    marker_set: str | None = None
    model: Path | str = DEFAULT_MODEL
    data: Path | None = None
    seed: int = 0
    lost: float | None = None
    physics: bool = False
    correct: bool = True
    pictures: bool = True
    film_view: str = "wide"
    place: Path | None = None
    latency_ms: float = 0.0
    latencies: Path | None = None
    view: PageOptions | None = None
    headset: Path | None = None
    webcam: WebcamOptions = WebcamOptions()
    publish: tuple[Wanted, ...] = ()
    publish_network: bool = False
    record_lsl: tuple[str, ...] = ()
    arm: ArmOptions | None = None
    overwrite: bool = False
