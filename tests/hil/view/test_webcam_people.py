"""The nets before pictures that nobody rendered for them: a real person; and before two people at once. Slow."""

import importlib
import io
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from paths import ROOT
from PIL import Image

from highfive.hil.bench.webcam_film import Film, FilmCamera, filmed_pair, jpeg, truth
from highfive.hil.view.browser import Browser
from highfive.hil.view.live_page import LivePage
from highfive.mocap_bridge.sources.camera_settings import SHOULDER
from highfive.mocap_bridge.wire.landmarks import Landmarks, decode_landmarks

pytestmark = pytest.mark.slow
ABOUT = {"mode": "session", "title": "webcam", "emotions": ["neutral"], "webcam": True}
FETCH = ROOT / "packaging" / "webcam" / "fetch.py"
NEAR, FAR = 2.0, 3.2  # m


@pytest.fixture(scope="module")
def nets(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The real nets, as ``make webcam`` fetches them, as a package that can be imported."""
    folder = tmp_path_factory.mktemp("nets") / "high_five_webcam"
    done = subprocess.run([sys.executable, FETCH, folder], capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"the nets cannot be fetched: {done.stderr}"
    with pytest.MonkeyPatch.context() as patch:
        sys.modules.pop("high_five_webcam", None)
        patch.syspath_prepend(folder.parent)
        importlib.invalidate_caches()
        yield
    sys.modules.pop("high_five_webcam", None)
    importlib.invalidate_caches()


def seen_by_the_page(video: Path, pictures: int, settled: str = "true") -> Iterator[tuple[Landmarks, str]]:
    """What the nets find in the last of so many pictures, once the page says that it has settled, and what it says."""
    with LivePage(ABOUT, port=0, tracks=True) as page, Browser((800, 450), camera=video) as browser:
        assert page.tracked is not None
        browser.go(page.address)
        count, found = 0, None
        for _ in range(60):
            for data in page.tracked.wait(10.0):
                count, found = count + 1, decode_landmarks(data)
            if found is not None and count >= pictures and browser.evaluate(settled):
                break
        assert found is not None
        yield found, browser.evaluate("highfive.webcam.line.textContent")


@pytest.fixture
def portrait(tmp_path: Path) -> Path:
    """Grace Hopper, as Matplotlib ships her: head and shoulders, no hand, no hips."""
    with Image.open(Path(matplotlib.get_data_path()) / "sample_data" / "grace_hopper.jpg") as photograph:
        height = 480
        picture = photograph.convert("RGB").resize((round(height * photograph.width / photograph.height), height))
    canvas = Image.new("RGB", (640, height), (128, 128, 128))
    canvas.paste(picture, ((640 - picture.width) // 2, 0))
    path = tmp_path / "portrait.mjpeg"
    path.write_bytes(30 * jpeg(np.asarray(canvas)))
    return path


@pytest.fixture
def two(tmp_path: Path) -> Path:
    """The near person at the left of the picture, and somebody further away at its right."""
    halves = []
    for distance in (NEAR, FAR):
        with Film(FilmCamera(size=(1280, 720), distance=distance)) as film:
            _, picture = next(film.pictures(filmed_pair("neutral", "B2"), 4, np.random.default_rng(0)))
        halves.append(np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"))[:, 320:960])
    path = tmp_path / "two.mjpeg"
    path.write_bytes(30 * jpeg(np.hstack(halves)))
    return path


def test_a_real_person_is_found_and_told_to_step_back(nets: None, portrait: Path) -> None:
    ((found, said),) = seen_by_the_page(portrait, 3)
    assert found.picture is not None and found.visibility is not None
    nose, left_ear, right_ear, left, right = found.picture[[0, 7, 8, 11, 12]]
    assert found.visibility[[0, 7, 8, 11, 12]].min() > 0.9
    assert right_ear[0] < nose[0] < left_ear[0] and right[0] < nose[0] < left[0]  # she faces the camera
    assert max(left_ear[1], right_ear[1], nose[1]) < min(left[1], right[1])
    assert 0.4 < nose[0] < 0.6 and 0.15 < nose[1] < 0.4
    assert not found.hands
    assert said.startswith("A step back: your hips should be seen.")


def test_of_two_people_the_nearer_one_is_followed_and_it_is_said(nets: None, two: Path) -> None:
    ((found, said),) = seen_by_the_page(two, 4, "highfive.webcam.line.textContent.includes('Two people')")
    joints, _ = truth(filmed_pair("neutral", "B2"), FilmCamera())
    focal = 640.0 / np.tan(np.radians(35.0))
    there = (640.0 - 320.0 + focal * joints[0, SHOULDER, 0] / joints[0, SHOULDER, 2]) / 1280.0
    assert found.picture is not None and found.persons == 2
    assert abs(found.picture[12, 0] - there) < 0.03
    assert "Two people are in view: the nearer one counts." in said
