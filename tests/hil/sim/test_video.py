import imageio_ffmpeg
import numpy as np
import pytest

from highfive.hil.sim.video import write_video
from highfive.model.errors import HighFiveError


def frames(count, height=65, width=97):
    for number in range(count):
        image = np.full((height, width, 3), 30, np.uint8)
        image[:, : (number + 1) * width // count] = (220, 120, 40)
        yield image


def test_a_film_comes_back_with_its_size_and_length(tmp_path):
    path = tmp_path / "film.mp4"
    assert write_video(path, frames(12), frames_per_second=24.0) == 12
    reader = imageio_ffmpeg.read_frames(str(path))
    facts = next(reader)
    read = [np.frombuffer(frame, np.uint8).reshape(64, 96, 3) for frame in reader]
    assert facts["codec"] == "h264"
    assert facts["pix_fmt"].startswith("yuv420p")
    assert facts["size"] == (96, 64)
    assert facts["fps"] == 24.0
    assert len(read) == 12
    assert np.abs(read[-1].mean(axis=(0, 1)) - (220, 120, 40)).max() < 12
    assert read[0].mean() < read[6].mean() < read[-1].mean()


def test_a_film_without_frames_or_folder_is_refused(tmp_path):
    with pytest.raises(HighFiveError, match="at least one"):
        write_video(tmp_path / "film.mp4", iter(()))
    with pytest.raises(HighFiveError, match="no folder"):
        write_video(tmp_path / "nowhere" / "film.mp4", frames(2))
