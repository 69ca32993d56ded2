"""One raised hand, met in four moods and in a blend of two: the whole tick, markers in, the avatar's pose out.

One sees how fast the avatar's palm gets, how far it moves, and that it ends on the person's palm whatever the mood.
Takes 7 s.
"""

import numpy as np

import highfive

person = highfive.simulated_person("neutral", "B2", seed=0)
for style in ({"neutral": 1.0}, {"happy": 1.0}, {"angry": 1.0}, {"sad": 1.0}, {"angry": 0.5, "sad": 0.5}):
    session = highfive.open_session(person.marker_set, style=style)
    ticks = [session.step(frame) for frame in person.frames()]  # tracker, model, contact correction
    palms = np.array([tick.palm.position for tick in ticks])
    gaps = np.linalg.norm(palms - person.palm, axis=1)
    speeds = np.linalg.norm(np.diff(palms[: gaps.argmin() + 1], axis=0), axis=1) * 120.0  # until the palms meet
    name = " + ".join(f"{weight:.0%} {emotion}" for emotion, weight in style.items())
    print(
        f"{name:<20} peak speed {speeds.max():.2f} m/s, way {speeds.sum() / 120.0:.2f} m, "
        f"nearest {1e3 * gaps.min():.0f} mm at {gaps.argmin() / 120.0:.2f} s"
    )
