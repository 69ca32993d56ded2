"""The file under a recording."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path


class Sink:
    """An unbuffered file that keeps count of what is whole: a buffer would try again to write what failed."""

    def __init__(self, path: Path) -> None:
        """A new file."""
        self._file = path.open("wb", buffering=0)
        self._written = self._whole = 0

    def write(self, data: bytes) -> int:
        """All of it."""
        left = memoryview(data)
        while left:
            count = self._file.write(left) or 0
            self._written += count
            left = left[count:]
        return len(data)

    def tell(self) -> int:
        """Bytes that were written."""
        return self._written

    def flush(self) -> None:
        """Marks a place where a reader may stop."""
        self._whole = self._written

    def cut(self) -> None:
        """Drops what is not whole, where the file can be cut, and closes."""
        with suppress(OSError):
            self._file.truncate(self._whole)
        self._file.close()

    def close(self) -> None:
        """No more is written."""
        self._file.close()
