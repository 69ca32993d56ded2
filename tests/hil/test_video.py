import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

from hil.sim.video import Overlay, draw_overlay, picture_strip, write_video
from model.errors import HighFiveError


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


def test_overlays_write_on_a_copy():
    frame = np.full((240, 320, 3), 128, np.uint8)
    plain = draw_overlay(frame, Overlay())
    np.testing.assert_array_equal(plain, frame)
    written = draw_overlay(frame, Overlay("happy", "simulated person", 0.5, 4.0))
    assert np.all(frame == 128)
    changed = np.any(written != frame, axis=-1)
    assert changed[200:, :120].any()  # caption, lower left
    assert changed[:40, 200:].any()  # slow motion, upper right
    bar = written[-1].astype(int)
    assert np.all(bar[10:150] == bar[20])
    assert np.any(bar[10] != bar[300])  # the bar is half full


def test_a_strip_holds_all_pictures_side_by_side(tmp_path):
    images = [np.full((60, 80, 3), shade, np.uint8) for shade in (40, 120, 200)]
    picture_strip(tmp_path / "strip.png", images, ["start", "reach", "contact"])
    strip = np.asarray(Image.open(tmp_path / "strip.png"))
    assert strip.shape[1] == 3 * 80 + 2 * 6
    for number, shade in enumerate((40, 120, 200)):
        assert np.all(strip[:60, number * 86 : number * 86 + 80] == shade)
    with pytest.raises(HighFiveError, match="3 and 1"):
        picture_strip(tmp_path / "strip.png", images, ["start"])
