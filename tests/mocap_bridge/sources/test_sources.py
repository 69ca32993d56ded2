import numpy as np

from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.sources.source import C3DSource, Connection


def source(rate=120.0, frames=10, start_ns=0):
    points = np.arange(frames * 3, dtype=float).reshape(frames, 1, 3) + 1.0
    valid = np.ones((frames, 1), dtype=bool)
    valid[4] = False
    return C3DSource(make_recording(rate, ["RFIN"], points, valid), start_ns=start_ns)


def test_stepping_gives_every_frame_once_in_order():
    frames = list(source())
    assert [frame.number for frame in frames] == list(range(10))
    assert [bool(frame.valid[0]) for frame in frames] == [n != 4 for n in range(10)]
    steps = np.diff([frame.source_time_ns for frame in frames])
    assert set(steps.tolist()) <= {8333333, 8333334}


def test_the_newest_frame_is_the_one_of_the_time_requested_whoever_asks_how_often():
    replay = source(start_ns=5_000_000_000)
    assert replay.newest(4_999_999_999) is None
    assert replay.health(0).connection is Connection.CONNECTING
    for frame in replay:
        for late in (0, 1_000_000, 8_000_000):
            newest = replay.newest(frame.arrival_time_ns + late)
            assert newest is not None
            assert newest.number == frame.number
            health = replay.health(frame.arrival_time_ns + late)
            assert (health.connection, health.age_ns, health.lost) == (Connection.LIVE, late, 0)
            assert health.received == frame.number + 1


def test_after_the_end_the_last_frame_grows_old():
    replay = source()
    last = replay.newest(10_000_000_000)
    assert last is not None
    assert last.number == 9
    health = replay.health(10_000_000_000)
    assert health.connection is Connection.ENDED
    assert health.age_ns == 10_000_000_000 - last.arrival_time_ns


def test_another_rate_is_resampled():
    replay = source(rate=60.0, frames=30)
    assert len(replay) == 59
    np.testing.assert_allclose(replay.frame(2).positions[0], [4.0, 5.0, 6.0])
    np.testing.assert_allclose(replay.frame(1).positions[0], [2.5, 3.5, 4.5])
    assert not replay.frame(7).valid[0]
    assert not replay.frame(8).valid[0]
