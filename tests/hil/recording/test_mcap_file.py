"""Chunks that unpack to more than they say, or to more than is read: passed over, in little time and memory."""

import io
import struct
import time
from functools import cache
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from mcap.writer import CompressionType, Writer

from highfive.hil.recording.mcap_file import LARGEST_CHUNK, McapFile

_MAGIC = b"\x89MCAP0\r\n"


def record(code: int, body: bytes) -> bytes:
    return struct.pack("<BQ", code, len(body)) + body


def chunk(kind: str, data: bytes, size: int) -> bytes:
    head = struct.pack("<QQQII", 0, 1, size, 0, len(kind)) + kind.encode() + struct.pack("<Q", len(data))
    return record(6, head + data)


def plain(messages: int) -> bytes:
    """Records: a channel, and messages of it."""
    channel = record(
        4, struct.pack("<HH", 1, 0) + struct.pack("<I", 2) + b"/a" + struct.pack("<I", 4) + b"json" + bytes(4)
    )
    return channel + b"".join(record(5, struct.pack("<HIQQ", 1, n, n, n) + b"{}") for n in range(messages))


def written(path: Path, *chunks: bytes) -> McapFile:
    path.write_bytes(_MAGIC + record(1, struct.pack("<II", 0, 0)) + b"".join(chunks) + record(15, bytes(4)) + _MAGIC)
    return McapFile(path)


@pytest.mark.parametrize(("kind", "pack"), [("zstd", zstandard.compress), ("lz4", lz4.frame.compress), ("", bytes)])
def test_each_packing_is_read(tmp_path: Path, kind: str, pack) -> None:
    file = written(tmp_path / "a.mcap", chunk(kind, pack(plain(5)), len(plain(5))))
    assert [message.sequence for _, _, message in file.messages()] == [0, 1, 2, 3, 4]
    assert file.ended and not file.damaged


@cache
def bombs() -> list[tuple[str, bytes]]:
    zeros, unsized = bytes(1 << 20), zstandard.ZstdCompressor(level=1).compressobj()
    zstd = b"".join(unsized.compress(zeros) for _ in range(1024)) + unsized.flush()
    packer = lz4.frame.LZ4FrameCompressor()
    lz4s = packer.begin() + b"".join(packer.compress(zeros) for _ in range(256)) + packer.flush()
    return [("zstd", zstd), ("lz4", lz4s), ("zstd", zstandard.compress(bytes(1 << 28)))]


@pytest.mark.parametrize("number", range(3))
@pytest.mark.parametrize("said", [10, LARGEST_CHUNK, LARGEST_CHUNK + 1, 1 << 28, 1 << 62])
def test_a_bomb_is_passed_over_and_what_comes_after_it_is_read(tmp_path: Path, number: int, said: int) -> None:
    kind, data = bombs()[number]
    good = chunk("zstd", zstandard.compress(plain(3)), len(plain(3)))
    begun = time.process_time()
    file = written(tmp_path / "a.mcap", chunk(kind, data, said), good)
    assert [message.sequence for _, _, message in file.messages()] == [0, 1, 2]
    assert len(file.damaged) == 1
    assert time.process_time() - begun < 1.0


def test_many_chunks_that_unpack_to_far_more_than_the_file_has_are_not_all_unpacked(tmp_path: Path) -> None:
    """Each is small enough; together they would be a gigabyte."""
    content = record(0x80, bytes(4 << 20))  # of a kind that nobody knows
    one = chunk("zstd", zstandard.compress(content), len(content))
    file = written(tmp_path / "a.mcap", *[one] * 250)
    assert list(file.messages()) == []
    assert len(file.damaged) > 200


def test_what_the_library_writes_is_read(tmp_path: Path) -> None:
    out = io.BytesIO()
    writer = Writer(out, chunk_size=1000, compression=CompressionType.LZ4)
    writer.start()
    channel = writer.register_channel("/a", "json", 0)
    for number in range(500):
        writer.add_message(channel, number, b"{}" * 20, number)
    writer.finish()
    (tmp_path / "a.mcap").write_bytes(out.getvalue())
    assert len(list(McapFile(tmp_path / "a.mcap").messages())) == 500
