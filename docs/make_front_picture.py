"""Draws docs/high_five.png: of a session's happy high fives the median one, as it was played. Needs OpenGL."""

from pathlib import Path

from PIL import Image

from highfive.hil.report.stage import avatar_stage
from highfive.hil.session.session import Session
from highfive.hil.sim.people.grid import CELLS
from highfive.hil.sim.playout import KinematicPlayOut
from highfive.hil.sim.rendering import NoPictures, open_renderer
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.key_frames import contact_tick, showpieces
from highfive.hil.trials.partners import simulated_partners
from highfive.hil.trials.trial import run_trial
from highfive.model import DEFAULT_MODEL
from highfive.model.hgpdm.store import load_model

EMOTION, SEED = "happy", 0
WIDTH, HEIGHT = 1280, 640


def main() -> None:
    """Plays the session (tracker, model, correction, contact check) and draws the tick of first touch."""
    scene = build_scene(visible=True)
    renderer = open_renderer(scene, WIDTH, HEIGHT)
    if isinstance(renderer, NoPictures):
        raise SystemExit(renderer.reason)
    partners = simulated_partners(len(CELLS), (EMOTION,), CELLS, SEED)
    session = Session(load_model(DEFAULT_MODEL), {EMOTION: 1.0}, partners[0].marker_set, scene)
    playout = KinematicPlayOut(scene)
    results = [run_trial(number, partner, session, playout) for number, partner in enumerate(partners)]
    (shown,) = showpieces(results)
    data = avatar_stage(scene).show(shown, contact_tick(shown))
    Image.fromarray(renderer.render(data, "wide")).save(Path(__file__).with_name("high_five.png"), optimize=True)
    print(f"{shown.title}: {1e3 * shown.touch_error:.1f} mm from the true palm as they touch")


if __name__ == "__main__":
    main()
