"""What a stream of the Lab Streaming Layer says about itself, and how its samples become markers: pure functions.

Channels are described as the XDF convention for motion capture has it (github.com/sccn/xdf/wiki/MoCap-Meta-Data):
marker, object, type (PositionX, PositionY, PositionZ) and unit, all of them optional. Without them the label says
which coordinate of which marker a channel is (``RFIN_X``).
"""

from __future__ import annotations

import configparser
import io
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.wire.lost_samples import LostSamples
from highfive.mocap_bridge.wire.plausible import plausible
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

MAX_DESCRIPTION = 4_000_000
"""Longest description that is read, characters; a thousand markers take 600,000."""

MAX_CHANNELS = 10_000
"""A stream with more channels is no motion capture."""

METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
_UNIT = re.compile(r"(milli|centi|)met(er|re)s?")
_LABEL = re.compile(r"(?P<marker>.+)[_. /:-](?P<axis>[XYZxyz])")
_TYPE = re.compile(r"position[_ ]?(?P<axis>[xyz])", re.IGNORECASE)
_FRAME = {"frame", "framenumber", "frame_number", "frame number"}
_LATEST = 1e12  # s; a time stamp beyond this is none
_SLOWEST, _FASTEST = 1e-3, 1e6  # Hz; what is outside is no rate


class DescriptionError(HighFiveError):
    """A stream's description or samples cannot be read as markers."""


@dataclass(frozen=True)
class Layout:
    """Which channel holds what.

    Attributes:
        names: M markers, with the person (XDF's ``object``) before a colon where one is given.
        columns: (M, 3) channel of each coordinate.
        factors: (M, 3) m for one unit of each channel.
        frame_column: channel that holds the frame number, or -1.
        channels: channels a sample has.
        captured: samples are stamped with when the cameras saw them: XDF's ``acquisition/compensated_lag`` is the lag
            that time stamps have already been put back by.
    """

    names: tuple[str, ...]
    columns: NDArray[np.intp]
    factors: Array
    frame_column: int
    channels: int
    captured: bool = False


def parse_description(xml: str, channels: int) -> Layout:
    """Reads the description of a stream with so many ``channels``.

    Markers of which a coordinate is missing, and channels that are no coordinates, are left out.

    Raises:
        DescriptionError: it is no XML, too long, describes no marker or one twice, or has an unknown unit.
    """
    if not 0 < channels <= MAX_CHANNELS:
        raise DescriptionError(f"the stream has {channels} channels; expected 3 a marker, at most {MAX_CHANNELS}")
    found: dict[str, dict[str, tuple[int, float]]] = {}
    frame_column = -1
    for column, channel in enumerate(_channels(xml, channels)):
        label = _text(channel, "label")
        if label.lower() in _FRAME:
            frame_column = column
            continue
        marker, axis = _marker(channel, label)
        if not axis:
            continue
        axes = found.setdefault(marker, {})
        if axis in axes:
            raise DescriptionError(
                f"channels {axes[axis][0] + 1} and {column + 1} are both {axis} of marker {marker!r}"
            )
        axes[axis] = column, _factor(_text(channel, "unit"), label or marker)
    whole = {marker: axes for marker, axes in found.items() if len(axes) == 3}
    if not whole:
        raise DescriptionError(
            "the stream's channels name no marker; expected labels such as RFIN_X, RFIN_Y, RFIN_Z, or for each channel "
            "marker and type (PositionX, PositionY, PositionZ) in its metadata"
        )
    return Layout(
        names=tuple(whole),
        columns=np.array([[axes[a][0] for a in "xyz"] for axes in whole.values()], dtype=np.intp),
        factors=np.array([[axes[a][1] for a in "xyz"] for axes in whole.values()]),
        frame_column=frame_column,
        channels=channels,
        captured=_compensated(xml),
    )


def channel_labels(xml: str, channels: int) -> tuple[str, ...]:
    """A name for each of a stream's channels, whatever they are; one without a label has its number, from 1 on.

    Raises:
        DescriptionError: it is no XML, too long, or describes more channels than there are.
    """
    if not 0 < channels <= MAX_CHANNELS:
        raise DescriptionError(f"the stream has {channels} channels; at most {MAX_CHANNELS} are read")
    labels = [_text(channel, "label") for channel in _channels(xml, channels)]
    return tuple((labels[k] if k < len(labels) else "") or str(k + 1) for k in range(channels))


def _channels(xml: str, channels: int) -> list[ElementTree.Element]:
    if len(xml) > MAX_DESCRIPTION:
        raise DescriptionError(
            f"the stream's description has {len(xml)} characters, at most {MAX_DESCRIPTION} are read"
        )
    if "<!" in xml:  # no description needs a document type, and entities can grow without bound
        raise DescriptionError("the stream's description holds a document type or a comment; it is not read")
    try:
        described = ElementTree.fromstring(xml).findall("./desc/channels/channel")
    except (ElementTree.ParseError, ValueError, RecursionError) as error:  # ValueError: lone surrogates, null bytes
        raise DescriptionError(f"the stream's description is no XML ({error})") from None
    if len(described) > channels:
        raise DescriptionError(f"the stream describes {len(described)} channels, but has {channels}")
    return described


def _compensated(xml: str) -> bool:
    """Whether the sender says by how much it puts its time stamps back; the amount is of no matter then."""
    try:
        return math.isfinite(float(ElementTree.fromstring(xml).findtext("desc/acquisition/compensated_lag", "")))
    except ValueError:
        return False


def _text(channel: ElementTree.Element, name: str) -> str:
    return (channel.findtext(name) or "").strip()


def _marker(channel: ElementTree.Element, label: str) -> tuple[str, str]:
    """Marker, with its person, and axis (x, y or z; '' where it is no coordinate) of a channel."""
    kind, named = _TYPE.fullmatch(_text(channel, "type")), _LABEL.fullmatch(label)
    if kind is None and (named is None or _text(channel, "type").lower() not in ("", "position", "mocap", "marker")):
        return "", ""
    axis = (kind or named)["axis"].lower()  # pyright: ignore[reportOptionalSubscript]
    marker = _text(channel, "marker") or (named["marker"] if named is not None else label)
    person = _text(channel, "object")
    if person and ":" not in marker and person != marker:
        marker = f"{person}:{marker}"
    return (marker, axis) if marker else ("", "")


def _factor(unit: str, label: str) -> float:
    """Metres in a unit; XDF strongly prefers metres, so that none given means them."""
    spelt = _UNIT.fullmatch(unit.lower())
    short = {"milli": "mm", "centi": "cm", "": "m"}[spelt[1]] if spelt else unit.lower() or "m"
    if short not in METRES:
        raise DescriptionError(f"channel {label!r} is in {unit!r}; expected meters, centimeters or millimeters")
    return METRES[short]


def markers_of(layout: Layout, samples: Array) -> tuple[Array, NDArray[np.bool_], NDArray[np.int64]]:
    """Positions (T, M, 3), m, validity (T, M), and how many were impossible (T,), from samples (T, channels).

    A coordinate that is no number hides a marker; see also :func:`highfive.mocap_bridge.wire.plausible.plausible`.

    Raises:
        DescriptionError: the samples have another number of channels than was described.
    """
    if samples.ndim != 2 or samples.shape[1] != layout.channels:
        raise DescriptionError(f"a sample has shape {samples.shape[1:]}, expected ({layout.channels},)")
    with np.errstate(over="ignore", invalid="ignore"):
        points = samples[:, layout.columns].astype(float) * layout.factors
    return plausible(points, np.ones(points.shape[:2], dtype=bool))


def checked_times(stamps: Array) -> Array:
    """The time stamps, s.

    Raises:
        DescriptionError: one of them is no time.
    """
    if not np.all(np.abs(stamps) < _LATEST):
        raise DescriptionError("a sample's time stamp is no time")
    return stamps


class FrameCounter:
    """Frame numbers from time stamps, so that lost samples leave a gap.

    A number is given at once, but a sample may only have been stamped late: what was lost shows some half a second
    afterwards (:mod:`highfive.mocap_bridge.wire.lost_samples`). One counter serves all connections to a stream: what
    is lost while it is gone shows when it is back.
    """

    def __init__(self, rate_hz: float = 0.0):
        """Args: ``rate_hz`` is the nominal rate; 0 where there is none."""
        self._rate = 0.0
        self._samples = LostSamples(0.0)
        self._number = -1
        self._next = 0  # number of the next sample, less what was lost
        self.set_rate(rate_hz)

    def set_rate(self, rate_hz: float) -> None:
        """The nominal rate that the stream has now, Hz."""
        rate_hz = rate_hz if _SLOWEST <= rate_hz <= _FASTEST else 0.0
        if rate_hz != self._rate:
            self._rate, self._samples, self._next = rate_hz, LostSamples(rate_hz), self._number + 1

    def next(self, stamp: float, arrival: float, stated: float = math.nan) -> int:
        """Number of a sample; ``stated`` is what the stream itself says, if it does.

        Args:
            stamp: when it was sent, s.
            arrival: when it arrived, s on a clock that is never set.
            stated: the frame number in the sample.
        """
        if 0.0 <= stated < 2.0**53:
            self._number = int(stated)
            return self._number
        self._samples.add(stamp, arrival)
        self._number = max(self._number + 1, self._next + self._samples.total)
        self._next += 1
        return self._number


def channel_descriptions(names: Sequence[str], unit: str = "meters") -> list[dict[str, str]]:
    """Metadata of the channels that send these markers: three each, as :func:`parse_description` reads it."""
    described = []
    for name in names:
        person, _, marker = name.rpartition(":")
        for axis in "XYZ":
            entry = {"label": f"{name}_{axis}", "marker": marker, "object": person}
            described.append({k: v for k, v in entry.items() if v} | {"type": f"Position{axis}", "unit": unit})
    return described


def samples_of(order: Sequence[str], names: Sequence[str], points: Array, valid: NDArray[np.bool_]) -> Array:
    """One sample (3 M,) in the fixed order of the stream from markers in any order; what is hidden or absent is NaN."""
    column = {name: m for m, name in enumerate(names)}
    columns = np.array([column.get(name, -1) for name in order], dtype=np.intp)
    there = columns >= 0
    shown = there & (valid[columns] if len(valid) else there)
    return np.where(shown[:, None], points[columns] if len(points) else np.nan, np.nan).reshape(-1)


_MOST_SETTINGS = 1 << 16
"""Characters of the user's own settings: Python takes a reader's squared time for values of many lines."""


def library_settings(text: str, local_only: bool) -> str:
    """Settings for liblsl: those of the user's own file ``text``, less noise, and on this machine alone if requested.

    Streams of this machine are requested directly too, where there is no multicast. What cannot be read is left out.
    """
    settings = configparser.ConfigParser(strict=False, interpolation=None)
    settings.optionxform = str  # pyright: ignore[reportAttributeAccessIssue]  (names keep their capitals)
    try:
        settings.read_string(text if len(text) <= _MOST_SETTINGS else "")
    except configparser.Error:
        settings.clear()
    for section in ("lab", "multicast", "log"):
        if not settings.has_section(section):
            settings.add_section(section)
    peers = [peer.strip() for peer in settings.get("lab", "KnownPeers", fallback="{}").strip("{} ").split(",")]
    peers = [peer for peer in peers if peer and peer != "127.0.0.1"] if not local_only else []
    settings.set("lab", "KnownPeers", "{" + ", ".join(["127.0.0.1", *peers]) + "}")
    if local_only:
        settings.set("multicast", "ResolveScope", "machine")
    if not settings.has_option("log", "level"):
        settings.set("log", "level", "-3")
    out = io.StringIO()
    settings.write(out)
    return out.getvalue()
