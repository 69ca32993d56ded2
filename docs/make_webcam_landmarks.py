"""Records what the page's nets see of simulated high fives, for ``hil/bench``; needs ``make webcam``.

``make_webcam_landmarks.py``: the 36 on which figures are measured, ``webcam_landmarks.npz``.
``make_webcam_landmarks.py --choice``: the 18 on which settings are chosen, ``webcam_choice.npz``.
``make_webcam_landmarks.py --tilted``: two each by a camera that looks down or up, ``webcam_tilted_*.npz``.
``make_webcam_landmarks.py --film FILE.mjpeg EMOTION CELL``: a video for ``highfive simulate --source webcam --camera``.
"""

import base64
import itertools
import json
import sys
from pathlib import Path

import numpy as np

from highfive.hil.bench.webcam_film import CHOICE_SEED, SEED, Film, FilmCamera, filmed_pair, truth
from highfive.hil.bench.webcam_recorded import CHOICE, RECORDED, STEP, TILTED, RecordedClip, save_clips
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.view.browser import Browser
from highfive.hil.view.live_page import LivePage
from highfive.mocap_bridge.wire.landmarks import HandLandmarks, Landmarks

CELLS = ("B2", "A1", "C3", "B1", "A3", "C2", "A2", "B3", "C1")
HEIGHT = {-10: 1.55, 15: 1.0}  # m over the floor, of a camera that is tilted so
VIDEO_STEP = 4  # frames of 120 Hz: 30 Hz, as Chromium plays it
BEGIN = """(async () => {
const { Net, NET } = await import('/webcam.js');
window.body = new Net('pose', {...NET, useCpuInference: true, smoothLandmarks: false});
window.hands = new Net('hands', {...NET, useCpuInference: true, maxNumHands: 4});
await Promise.all([body.ready, hands.ready]);
window.look = async (text, at) => {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const images = await Promise.all([0, 1].map(() => createImageBitmap(new Blob([bytes], { type: 'image/jpeg' }))));
  return JSON.stringify(await Promise.all([body.find(images[0], at), hands.find(images[1], at)]));
};
})()"""
APART_MS = 10_000  # from clip to clip: the nets' time does not go back


def main() -> None:
    """Films, looks, writes."""
    if sys.argv[1:2] == ["--film"]:
        film(Path(sys.argv[2]), *sys.argv[3:5])
        return
    if sys.argv[1:] == ["--tilted"]:
        for degrees, path in TILTED.items():
            record(
                path,
                CHOICE_SEED,
                [("neutral", "B2"), ("happy", "C3")],
                FilmCamera(height=HEIGHT[degrees], tilt=degrees),
            )
        return
    choice = sys.argv[1:] == ["--choice"]
    path, seed = (CHOICE, CHOICE_SEED) if choice else (RECORDED, SEED)
    pairs = [
        (emotion, cell)
        for c, cell in enumerate(CELLS)
        for e, emotion in enumerate(EMOTIONS)
        if not choice or (c + e) % 2 == 0
    ]
    record(path, seed, pairs, FilmCamera())


def record(path: Path, seed: int, pairs: list[tuple[str, str]], camera: FilmCamera) -> None:
    """High fives of pairs of a seed before a camera."""
    clips = []
    with LivePage({"mode": "session", "webcam": True}) as page, Browser() as browser, Film(camera) as made:
        browser.go(page.address)
        browser.evaluate("new Promise((done) => setTimeout(done, 2000))")
        browser.evaluate(BEGIN)
        for number, (emotion, cell) in enumerate(pairs):
            clips.append(recorded(browser, made, emotion, cell, seed, number * APART_MS))
            print(emotion, cell, len(clips[-1].frames), flush=True)
    save_clips(path, clips, camera.size)


def recorded(browser: Browser, made: Film, emotion: str, cell: str, seed: int, begins_ms: float) -> RecordedClip:
    """One high five through the nets."""
    trial = filmed_pair(emotion, cell, seed)
    joints, palm = truth(trial, made.camera)
    frames, found = [], []
    for frame, picture in made.pictures(trial, STEP, np.random.default_rng(1)):
        text, at = base64.b64encode(picture).decode(), begins_ms + 1e3 * frame / 120.0
        body, hands = json.loads(browser.evaluate(f"look('{text}', {at})"))
        frames.append(frame)
        found.append(as_landmarks(len(found), 1e3 * frame / 120.0, made.camera.size, body, hands))
    chosen = np.array(frames)
    return RecordedClip(emotion, cell, chosen, tuple(found), trial.contact_frame, joints[chosen], palm)


def as_landmarks(number: int, at_ms: float, size: tuple[int, int], body: dict | None, hands: list[dict]) -> Landmarks:
    """What the nets' worker answered, as the wire has it."""
    picture = sure = world = None
    if body is not None:
        rows = np.array(body["picture"])
        picture, sure, world = rows[:, :2], np.clip(rows[:, 2], 0.0, 1.0), np.array(body["world"])
    shown = tuple(
        HandLandmarks(hand["score"], np.array(hand["picture"])[:, :2], np.array(hand["world"])) for hand in hands
    )
    return Landmarks(number, at_ms, 0.0, size, int(body is not None), picture, sure, world, shown)


def film(path: Path, emotion: str, cell: str) -> None:
    """A video of one high five."""
    with Film(FilmCamera(size=(640, 360))) as made, path.open("wb") as file:
        pictures = made.pictures(filmed_pair(emotion, cell), VIDEO_STEP, np.random.default_rng(1))
        file.writelines(picture for _, picture in itertools.chain(pictures))


if __name__ == "__main__":
    main()
