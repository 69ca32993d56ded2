"""Recordings for fuzzing: a short one, and how it is damaged within its chunks, whose sums then fit again."""

from __future__ import annotations

import io
import struct
from collections.abc import Sequence
from functools import cache
from random import Random

import lz4.frame
import zstandard
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from highfive.hil.bench.fuzz_mutations import damaged_bytes, damaged_json
from highfive.hil.view import SHIPPED_RECORDING

_TICKS = 2
_CHUNK, _MESSAGE = 6, 5  # opcodes
_HUGE = (0, 1, 1 << 20, 1 << 31, 1 << 40, 2**63, 2**64 - 1)


def short_recording() -> bytes:
    """The beginning of the recording that comes along: its settings, one high five's head, and some ticks."""
    out, kept, channels = io.BytesIO(), dict[str, int](), dict[int, int]()
    with SHIPPED_RECORDING.open("rb") as file:
        writer = Writer(out, chunk_size=30_000, compression=CompressionType.ZSTD)
        writer.start()
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            topic = channel.topic
            kept[topic] = kept.get(topic, 0) + 1
            if schema is None or topic in ("/tf", "/skeleton") or topic.startswith("/plot") or kept[topic] > _TICKS:
                continue
            if channel.id not in channels:
                of = writer.register_schema(schema.name, schema.encoding, b"{}")
                channels[channel.id] = writer.register_channel(topic, channel.message_encoding, of)
            writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
        writer.finish()
    return out.getvalue()


def damaged_mcap(rng: Random, content: bytes, others: Sequence[bytes]) -> bytes:
    """A record that is missing, twice or elsewhere, a message or a chunk that is damaged, or one that unpacks to far
    more than it says; a third by bytes.
    """
    if rng.random() < 0.33:
        return damaged_bytes(rng, content, others)
    records = list(_records(content))
    at, kind = rng.randrange(len(records)), rng.randrange(10)
    if kind == 0:
        del records[at]
    elif kind == 1:
        records[at:at] = [records[at]] * rng.choice((1, 2, 50))
    elif kind == 2:
        records.insert(rng.randrange(len(records)), records.pop(at))
    else:
        chunks = [place for place, (code, _) in enumerate(records) if code == _CHUNK]
        place = rng.choice(chunks)
        records[place] = _CHUNK, _rechunked(rng, records[place][1], kind)
    return _joined(records)


def _records(content: bytes) -> Sequence[tuple[int, bytes]]:
    found, at = [], 8
    while at + 9 <= len(content) - 8:
        code, size = struct.unpack_from("<BQ", content, at)
        found.append((code, content[at + 9 : at + 9 + size]))
        at += 9 + size
    return found


def _joined(records: Sequence[tuple[int, bytes]]) -> bytes:
    magic = b"\x89MCAP0\r\n"
    return magic + b"".join(struct.pack("<BQ", code, len(body)) + body for code, body in records) + magic


def _rechunked(rng: Random, body: bytes, kind: int) -> bytes:
    start, end, size, _, length = struct.unpack_from("<QQQII", body)
    packed = body[32 + length + 8 :]
    inner = zstandard.decompress(packed, size)
    if kind < 8:
        inner = _damaged_inside(rng, inner)
        size = len(inner)
    if kind == 8:  # says another size
        size = rng.choice(_HUGE)
    name, data = rng.choice((("zstd", zstandard.compress), ("lz4", lz4.frame.compress), ("", bytes), ("x", bytes)))
    data = data(inner)
    if kind == 9 and rng.random() < 0.2:
        name, data = rng.choice(_bombs())
        size = rng.choice((len(data), 1 << 30, 1 << 62, 100))
    head = struct.pack("<QQQII", start, end, size, 0, len(name))
    return head + name.encode() + struct.pack("<Q", len(data)) + data


@cache
def _bombs() -> list[tuple[str, bytes]]:
    """A gigabyte in some ten kilobytes; frames that say no size, and one that says a wrong one."""
    zeros = bytes(1 << 20)
    zstd = zstandard.ZstdCompressor(level=1).compressobj()
    endless = b"".join(zstd.compress(zeros) for _ in range(1024)) + zstd.flush()
    sized = zstandard.ZstdCompressor(level=1).compressobj(size=1 << 30)
    said = b"".join(sized.compress(zeros) for _ in range(1024)) + sized.flush()
    with lz4.frame.LZ4FrameCompressor() as lz4s:
        large = lz4s.begin() + b"".join(lz4s.compress(zeros) for _ in range(400)) + lz4s.flush()
    wrong = bytes.fromhex("28b52ffde0ffffffffffffff0f010000")
    return [("zstd", endless), ("zstd", said), ("lz4", large), ("zstd", wrong)]


def _damaged_inside(rng: Random, inner: bytes) -> bytes:
    records, at = [], 0
    while at + 9 <= len(inner):
        code, size = struct.unpack_from("<BQ", inner, at)
        records.append((code, inner[at + 9 : at + 9 + size]))
        at += 9 + size
    messages = [place for place, (code, _) in enumerate(records) if code == _MESSAGE]
    for _ in range(rng.choice((1, 1, 2, 5))):
        if not messages or rng.random() < 0.15:
            place = rng.randrange(len(records))
            records[place] = records[place][0], damaged_bytes(rng, records[place][1], [records[0][1]])
            continue
        place = rng.choice(messages)
        body = records[place][1]
        head, data = bytearray(body[:22]), body[22:]
        if rng.random() < 0.1:
            head = bytearray(damaged_bytes(rng, bytes(head), [body])[:22].ljust(22, b"\0"))
        damage = damaged_json if data[:1] == b"{" else damaged_bytes
        records[place] = _MESSAGE, bytes(head) + damage(rng, data, [data])
    return b"".join(struct.pack("<BQ", code, len(body)) + body for code, body in records)
