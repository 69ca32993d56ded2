"""The messages of an MCAP file as they stand in it; what of it is damaged is passed over."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import lz4.frame
import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, DataEnd, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from zstandard import ZstdError

from highfive.model.errors import HighFiveError
from highfive.model.files import check_size

_MAGIC = b"\x89MCAP0\r\n"  # at both ends

Place = tuple[int, int]
"""Of a message: where in the file its chunk begins, and its place among the chunk's records. Later ones are greater."""

LARGEST_FILE = 1 << 40
"""Bytes: it is read piece by piece, and only has to end."""
LARGEST_CHUNK = 32 << 20
"""Bytes that a chunk may unpack to: our own have 8 MB at most, and all of it is in memory at once."""
_PACKED = 40
"""All chunks may unpack to so many times the bytes that were read: ours do to three times."""
_ALWAYS = 16 << 20
"""Bytes to which they may, however little was read."""

# What a file that ends anywhere, is damaged, or is no MCAP at all, makes the library raise.
_UNREADABLE = (
    McapError, struct.error, zlib.error, ZstdError, ValueError, KeyError, RuntimeError, OverflowError, MemoryError,
    EOFError,
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
            check_size(self.path, LARGEST_FILE)
            size = self.path.stat().st_size
            with self.path.open("rb") as file:
                if size == 0:
                    raise HighFiveError(f"{self.path} is empty; a recording of a session starts with its settings")
                file.seek(at)
                unpacked = 0
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
                    most = min(LARGEST_CHUNK, _ALWAYS + _PACKED * (file.tell() - at) - unpacked)
                    size = record.uncompressed_size if isinstance(record, Chunk) else 0
                    unpacked += size if size <= most else 0
                    for number, held in enumerate(self._records(record, offset, most)):
                        if isinstance(held, Channel):
                            self.channels[held.id] = held
                        elif isinstance(held, Message) and held.channel_id in self.channels:
                            yield (offset, number), self.channels[held.channel_id], held
        except OSError as error:
            raise HighFiveError(f"cannot read the recording {self.path}: {error.strerror or error}") from None

    def _records(self, record: object, offset: int, most: int) -> list[object]:
        """What is in a chunk, of which it may unpack to ``most`` bytes; of another record itself."""
        if not isinstance(record, Chunk):
            return [record]
        try:
            plain = replace(record, compression="", data=_unpacked(record, most))
            return [*breakup_chunk(plain, validate_crc=True)]
        except _UNREADABLE:
            self.damaged.add(offset)
            return []


def _unpacked(chunk: Chunk, most: int) -> bytes:
    """What a chunk holds.

    Raises:
        ValueError: it is more than ``most`` bytes, or not as many as it says.
    """
    size = chunk.uncompressed_size
    if size > most:
        raise ValueError(f"a chunk of {size} bytes")
    match chunk.compression:
        case "":
            plain = chunk.data
        case "lz4":
            unpacker = lz4.frame.LZ4FrameDecompressor()
            plain = unpacker.decompress(chunk.data, max_length=size + 1)
        case "zstd":
            with zstandard.ZstdDecompressor(max_window_size=LARGEST_CHUNK).stream_reader(chunk.data) as unpacker:
                plain = unpacker.read(size + 1)
        case other:
            raise ValueError(f"a chunk that is packed by {other!r}")
    if len(plain) != size:
        raise ValueError(f"a chunk of {len(plain)} bytes that says it has {size}")
    return plain
