"""A session on Foxglove's live server: the messages that viewers draw of a recording, while they happen."""

from __future__ import annotations

import json
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

from mcap_protobuf.schema import build_file_descriptor_set

from highfive.hil.arm_model.arm_folder import DEFAULT_ARM
from highfive.hil.publish.publisher import ArmPosture, SessionEvent, ShownPicture
from highfive.hil.recording import schemas, viewer_messages
from highfive.hil.recording.recorded_tick import RecordedTick
from highfive.hil.recording.recorder import DRAWN_EVERY
from highfive.model.errors import HighFiveError

BACKLOG = 8
"""Messages that may wait for a viewer; of more the oldest is left out for it."""
HERE, EVERYWHERE = "127.0.0.1", "0.0.0.0"
_EVENT = "/event"


class FoxglovePublisher:
    """Serves ``/tf``, ``/markers``, ``/skeleton``, ``/log`` and ``/event``; messages are stamped with the session's
    clock. Viewers can change nothing.
    """

    waiting = 8

    def __init__(self, port: int, *, local_only: bool = True, arm: str = DEFAULT_ARM) -> None:
        """Serves from now on.

        Args:
            port: TCP port; 0 takes a free one.
            local_only: for this computer alone; otherwise for whoever reaches it.
            arm: name or folder of the one that takes part, if one does.

        Raises:
            HighFiveError: the package ``foxglove-sdk`` is not installed, or the port is in use.
        """
        if find_spec("foxglove") is None:
            raise HighFiveError("--publish foxglove needs foxglove-sdk: pip install 'high-five[foxglove]'")
        import foxglove  # noqa: PLC0415  (an extra)  # pyright: ignore[reportMissingImports]

        # Kept: channels and server know it only as long as it is there.
        context: Any = foxglove.Context()
        self._context = context
        host = HERE if local_only else EVERYWHERE
        try:
            self._server: Any = foxglove.start_server(
                name="High Five", host=host, port=port, message_backlog_size=BACKLOG, context=context
            )
        except Exception as error:  # its own kind of error, which it does not name
            raise HighFiveError(
                f"cannot serve Foxglove on port {port}: {' '.join(str(error).split())}; "
                "choose another one, as in --publish foxglove://:8766"
            ) from None
        self.port = int(self._server.port)
        self.name = f"foxglove://:{self.port}"
        self._channels: dict[str, Any] = {}
        for topic, kind in viewer_messages.TOPICS.items():
            described = build_file_descriptor_set(kind).SerializeToString()
            schema = foxglove.Schema(name=kind.DESCRIPTOR.full_name, encoding="protobuf", data=described)
            self._channels[topic] = foxglove.Channel(topic, schema=schema, message_encoding="protobuf", context=context)
        said = json.dumps(schemas.schema_of(_EVENT)).encode()
        schema = foxglove.Schema(name=schemas.TOPICS[_EVENT][0], encoding="jsonschema", data=said)
        self._channels[_EVENT] = foxglove.Channel(_EVENT, schema=schema, message_encoding="json", context=context)
        self._transforms, self._count = viewer_messages.Transforms(arm), 0

    def tick(self, tick: RecordedTick) -> None:
        """The markers and, as often as a recording has them, the bodies' places and bones: what somebody looks at."""
        at, played, person = tick.at_ns, tick.played, tick.person
        makers: dict[str, Callable[[], Any]] = {"/markers": lambda: viewer_messages.point_cloud(at, tick.markers)}
        if self._count % DRAWN_EVERY == 0:
            makers["/tf"] = lambda: self._transforms.body(at, played, person)
            makers["/skeleton"] = lambda: viewer_messages.skeleton(at, played, person)
        self._count += 1
        for topic, make in makers.items():
            if self._channels[topic].has_sinks():
                self._channels[topic].log(make().SerializeToString(), log_time=at)

    def event(self, event: SessionEvent) -> None:
        """As JSON, and as a line of the log."""
        at = event.at_ns
        said = json.dumps(event.record(), ensure_ascii=False)
        self._channels[_EVENT].log(said.encode(), log_time=at)
        line = " ".join([event.name, *(f"{name} {value}" for name, value in event.record().items() if name != "event")])
        self._channels["/log"].log(viewer_messages.log(at, "INFO", line).SerializeToString(), log_time=at)

    def shown(self, picture: ShownPicture) -> None:
        """Nobody asks for it."""

    def arm(self, posture: ArmPosture) -> None:
        """Its bodies' places."""
        if self._channels["/tf"].has_sinks():
            places = self._transforms.arm(posture.time_ns, posture.joints)
            self._channels["/tf"].log(places.SerializeToString(), log_time=posture.time_ns)

    def close(self) -> None:
        """Serves no more."""
        self._server.stop()
