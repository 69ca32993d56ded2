"""The files that a page is made of, and the headers that go with them."""

from __future__ import annotations

import gzip
from dataclasses import dataclass
from functools import cache
from http import HTTPStatus
from pathlib import Path

from websockets.datastructures import Headers
from websockets.http11 import Response

FOLDER = Path(__file__).parent / "page"
TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    ".glb": "model/gltf-binary",
    ".json": "application/json",
    ".txt": "text/plain; charset=utf-8",
    ".wasm": "application/wasm",
}
BYTES = "application/octet-stream"
POLICY = (
    "default-src 'self'; connect-src 'self' ws: wss:; img-src 'self' data: blob:; object-src 'none'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
WEBCAM_POLICY = f"{POLICY}; script-src 'self' 'wasm-unsafe-eval'"
"""Where the page runs nets: compiled code of its own files, and no other, may run."""
_WORTH_ZIPPING = 1024


@dataclass(frozen=True)
class File:
    """What is sent for a path: its type, its bytes, and the same zipped where that is smaller."""

    kind: str
    plain: bytes
    zipped: bytes | None

    @classmethod
    def of(cls, kind: str, plain: bytes) -> File:
        """Zipped once."""
        zipped = gzip.compress(plain, 6, mtime=0) if len(plain) > _WORTH_ZIPPING else None
        return cls(kind, plain, zipped if zipped and len(zipped) < len(plain) else None)

    def response(self, accepts: str, policy: str = POLICY) -> Response:
        """The answer to a request that ``accepts`` these encodings."""
        zip_it = self.zipped is not None and "gzip" in accepts
        body = self.zipped if zip_it and self.zipped is not None else self.plain
        headers = _headers(self.kind, len(body), policy)
        if zip_it:
            headers["Content-Encoding"] = "gzip"
        return Response(HTTPStatus.OK, "OK", headers, body)


def refusal(status: HTTPStatus, line: str) -> Response:
    """An answer of one line."""
    body = f"{line}\n".encode()
    return Response(status, status.phrase, _headers(TYPES[".txt"], len(body)), body)


@cache
def page_files() -> dict[str, File]:
    """Path → file, of those that come with the package; ``/`` is the page."""
    files = {
        f"/{path.relative_to(FOLDER).as_posix()}": File.of(TYPES[path.suffix], path.read_bytes())
        for path in sorted(FOLDER.rglob("*"))
        if path.is_file() and path.suffix in TYPES
    }
    files["/"] = files.pop("/index.html")
    return files


def _headers(kind: str, length: int, policy: str = POLICY) -> Headers:
    return Headers(
        {
            "Content-Type": kind,
            "Content-Length": str(length),
            "Content-Security-Policy": policy,
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
            "Cross-Origin-Opener-Policy": "same-origin",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Cache-Control": "no-cache",
            "Connection": "close",
        }
    )
