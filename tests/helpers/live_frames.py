"""Frames of a made-up person, sent live by any of the servers."""

import contextlib
import itertools
import threading
import time

import numpy as np

from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.source import Connection

NAMES = tuple(f"Anna:M{m}" for m in range(12))
OWN = tuple(name.removeprefix("Anna:") for name in NAMES)
POINTS = np.random.default_rng(4).uniform(-1.0, 2.0, size=(12, 3))
RATE = 120.0


def frame(number, names=NAMES, loose=2, hidden=()):
    """Every marker has a place of its own, and moves 1 mm a frame."""
    valid = np.array([name not in hidden for name in names])
    points = POINTS[[NAMES.index(name) for name in names]] + np.array([0.001 * number, 0.0, 0.0])
    time_ns = round(number * 1e9 / RATE)
    return MarkerFrame(tuple(names), points, valid, number, time_ns, time_ns, POINTS[:loose] + 0.1)


@contextlib.contextmanager
def running(run):
    """Runs ``run(ended)`` in a thread until the end of the block, which sets ``ended``."""
    ended = threading.Event()
    thread = threading.Thread(target=run, args=(ended,))
    thread.start()
    try:
        yield thread
    finally:
        ended.set()
        thread.join()


@contextlib.contextmanager
def playing(server, frames=None, rate=RATE):
    """Sends frames at their rate in a thread until the end of the block."""
    frames = frames or (frame(k) for k in itertools.count())

    def send(ended):
        for one in frames:
            server.send(one)
            if ended.wait(1.0 / rate):
                return

    with running(send):
        yield


def arrived(source):
    """The newest frame after some, and what was sent as it: names, points and state are right, whatever its time."""
    first = source.first()
    until(lambda: source.newest(0).number > first.number + 5)
    got = source.newest(0)
    sent = frame(got.number)
    assert got.names == OWN
    np.testing.assert_allclose(got.positions, sent.positions, atol=2e-7)
    np.testing.assert_allclose(got.unlabelled, sent.unlabelled, atol=2e-7)
    assert got.valid.all()
    return got, sent


def in_order(source):
    health = source.health(time.monotonic_ns())
    return (health.connection, health.lost, health.trouble) == (Connection.LIVE, 0, "")


PATIENCE_S = 60.0
"""Only what hangs takes so long, s: nothing is judged by it."""


def until(condition):
    """Waits for that; a test that would wait for ever fails."""
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.002)


def ends(call):
    """Makes the call, of what must not wait for anybody; a test that would hang in it fails."""
    thread = threading.Thread(target=call, daemon=True)
    thread.start()
    thread.join(PATIENCE_S)
    assert not thread.is_alive(), "it does not come back"


def live(source):
    return source.health(time.monotonic_ns()).connection is Connection.LIVE
