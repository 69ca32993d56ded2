"""A recording's messages from bytes to fields; what cannot be decoded is left out, and counted."""

from __future__ import annotations

import json
import logging
import re
import struct
from collections.abc import Collection, Mapping
from typing import Any, TypeGuard

from google.protobuf.message import DecodeError
from mcap.records import Channel, Message
from mcap.well_known import MessageEncoding

from highfive.hil.recording import schemas
from highfive.hil.recording.mcap_file import McapFile, Place
from highfive.hil.recording.viewer_messages import cloud_points
from highfive.hil.runtime.console import counted

LOG = logging.getLogger(__name__)

MARKERS = "/markers"
"""The one topic of points that is read back; the others are for viewers."""
ALL = (*schemas.TOPICS, MARKERS)
"""Topics that are read back, beside other programs' streams."""

_LONG = re.compile(rb"\d{19}")  # else no number is looked at: there are many

# What a message that is not as it should be makes its decoding raise.
_MALFORMED = (DecodeError, struct.error, ValueError, KeyError, TypeError, AttributeError, RecursionError)


class Decoder:
    """Attributes:
    names: of the markers, as the last high five said them.
    labels: of other programs' streams by topic, as far as they have been said.
    malformed: places of messages that were left out.
    """

    def __init__(
        self, topics: Collection[str] = ALL, names: tuple[str, ...] = (), labels: Mapping[str, list[str]] | None = None
    ) -> None:
        """Of the messages on some topics."""
        self._topics = frozenset(topics)
        self._streams = self._topics >= frozenset(ALL)
        self.names, self.labels = names, dict(labels or {})
        self.malformed: set[Place] = set()

    def __call__(self, place: Place, channel: Channel, message: Message) -> dict[str, Any] | None:
        """What a message says: rows are rows, points and channels have their names. None where it is left out.

        A ``/trial`` that cannot be decoded says nothing, but a high five begins there.
        """
        topic = channel.topic
        if topic not in self._topics and not self._labelled(topic, message.data):
            return None
        try:
            if channel.message_encoding == MessageEncoding.JSON:
                return self._of_json(topic, message.data)
            return self._points(message.data) if topic == MARKERS else None
        except _MALFORMED:
            self.malformed.add(place)
            return {} if topic == "/trial" else None

    def _labelled(self, topic: str, content: bytes) -> bool:
        """Of another program's stream, and wanted, or with labels that others are read by."""
        return topic.startswith(schemas.STREAMS) and (self._streams or b'"labels"' in content)

    def _of_json(self, topic: str, content: bytes) -> dict[str, Any]:
        data = json.loads(content, parse_int=_whole if _LONG.search(content) else None)
        if not isinstance(data, dict):
            raise ValueError("no JSON object")
        if topic in schemas.TOPICS:
            data = schemas.restored(topic, data)
            if topic == "/trial" and _are_texts(names := data.get("markers")):
                self.names = tuple(names)
        elif topic.startswith(schemas.STREAMS):
            if _are_texts(labels := data.get("labels")):
                self.labels[topic] = labels
            data["labels"] = self.labels.get(topic, [])
        return data

    def _points(self, content: bytes) -> dict[str, Any]:
        points = cloud_points(content)
        if len(points["positions"]) != len(self.names):
            raise ValueError("other markers than the high five has")
        return {"names": list(self.names), **points}


def say_what_is_left_out(file: McapFile, malformed: Collection[Place], said: tuple[int, int] = (0, 0)) -> None:
    """In one line, where anything is; ``said``: malformed messages and damaged chunks of which it was said before."""
    messages, chunks = len(malformed) - said[0], len(file.damaged) - said[1]
    more = " more" if any(said) else ""
    found = [counted(messages, f"{more} malformed message".strip())] if messages else []
    found += [counted(chunks, f"{more} damaged chunk".strip())] if chunks else []
    if found:
        LOG.warning("%s: left out: %s", file.path.name, " and ".join(found))


def _whole(digits: str) -> int:
    """Raises ValueError beyond 64 bits: no array holds it, nor does a float."""
    if -(2**63) <= (number := int(digits)) < 2**64:
        return number
    raise ValueError("a whole number of more than 64 bits")


def _are_texts(value: object) -> TypeGuard[list[str]]:
    return isinstance(value, list) and all(isinstance(one, str) for one in value)
