"""The messages of an MCAP file as they stand in it; what of it is damaged is passed over."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, DataEnd, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from zstandard import ZstdError

from highfive.model.errors import HighFiveError

_MAGIC = b"\x89MCAP0\r\n"  # at both ends

Place = tuple[int, int]
"""Of a message: where in the file its chunk begins, and its place among the chunk's records. Later ones are greater."""

# What a file that ends anywhere, is damaged, or is no MCAP at all, makes the library raise.
_UNREADABLE = (
    McapError, struct.error, zlib.error, ZstdError, ValueError, KeyError, RuntimeError, OverflowError, MemoryError,
)  # fmt: skip


class McapFile:
    """Attributes:
    path: of it.
    channels: by number, as far as they have been read.
    damaged: where chunks begin that cannot be read; one that ends the file is not among them.
    ended: the end of its messages has been read; a file that is cut short has none.
    """

    def __init__(self, path: Path) -> None:
        """Of a path; nothing is read yet."""
        self.path = path
        self.channels: dict[int, Channel] = {}
        self.damaged: set[int] = set()
        self.ended = False

    def messages(self, at: int = 0) -> Iterator[tuple[Place, Channel, Message]]:
        """From a chunk on: messages in order, each with its place and channel, as far as the file goes.

        Raises:
            HighFiveError: there is no such file, or it is empty.
        """
        try:
            size = self.path.stat().st_size
            with self.path.open("rb") as file:
                if size == 0:
                    raise HighFiveError(f"{self.path} is empty; a recording of a session starts with its settings")
                file.seek(at)
                records = StreamReader(file, skip_magic=at > 0, emit_chunks=True, record_size_limit=size).records
                while True:
                    offset = file.tell()
                    try:
                        record = next(records, None)
                    except _UNREADABLE:
                        return
                    if record is None or isinstance(record, DataEnd):
                        file.seek(-len(_MAGIC), 2)
                        self.ended = self.ended or (record is not None and file.read() == _MAGIC)
                        return
                    for number, held in enumerate(self._records(record, offset)):
                        if isinstance(held, Channel):
                            self.channels[held.id] = held
                        elif isinstance(held, Message) and held.channel_id in self.channels:
                            yield (offset, number), self.channels[held.channel_id], held
        except OSError as error:
            raise HighFiveError(f"cannot read the recording {self.path}: {error.strerror or error}") from None

    def _records(self, record: object, offset: int) -> list[object]:
        if not isinstance(record, Chunk):
            return [record]
        try:
            return [*breakup_chunk(record, validate_crc=True)]
        except _UNREADABLE:
            self.damaged.add(offset)
            return []
