"""Sends a C3D file as the laboratory's system would: ``send.py FILE [HOST [PORT]]``, at the file's own rate."""

from __future__ import annotations

import socket
import sys
import time

from highfive.mocap_bridge.files.c3d import read_c3d


def send(path: str, host: str = "127.0.0.1", port: int = 9763) -> None:
    """Every frame once, in its time."""
    recording = read_c3d(path)
    start = time.monotonic()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for number, (points, valid) in enumerate(zip(recording.points, recording.valid, strict=True)):
            seconds = number / recording.rate_hz
            time.sleep(max(0.0, start + seconds - time.monotonic()))
            words = [str(number), f"{seconds:.6f}"]
            for name, point, seen in zip(recording.names, points, valid, strict=True):
                words += [name.replace(" ", "_"), *(f"{c:.5f}" if seen else "nan" for c in point)]
            out.sendto(" ".join(words).encode("ascii"), (host, port))


if __name__ == "__main__":
    send(sys.argv[1], *sys.argv[2:3], *map(int, sys.argv[3:4]))
