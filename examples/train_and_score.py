"""A small model from recordings, and its scores beside plain regressions, on recordings that it has not seen.

    train_and_score.py out/captured

Without a folder (docs/data.md) one is simulated: angry high fives at nine places, one to learn from and one held out
each. One sees how far each method's palm is off at contact, before any correction, and that the model is far ahead of
the mean pose, though it is trained briefly; the defaults are better. Takes 60 s.
"""

import sys
from pathlib import Path

import highfive
from highfive.hil.sim.people.capture import capture

if sys.argv[1:]:
    data = Path(sys.argv[1])
else:
    data = Path("captured")
    capture(data, ("angry",), repetitions=2, test_repetitions=1)
model = highfive.train(data, inducing=30, iterations=10, distractors=False)  # few, for a first look
highfive.save_model(model, "my_model.safetensors")
scores = highfive.evaluate(data, "my_model.safetensors", inducing=30, gestures=False)["scores"]
for method, values in scores.items():
    print(f"{method:<12}palm at contact {100.0 * values['palm_at_contact']:.1f} cm")
