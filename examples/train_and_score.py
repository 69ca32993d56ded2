"""A model from a folder of recordings (docs/data.md), and its scores beside plain regressions.

highfive capture --repetitions 2 --out out/captured
train_and_score.py out/captured
"""

import sys

import highfive

model = highfive.train(sys.argv[1], inducing=60, iterations=30)  # few, for a first look; the defaults are better
highfive.save_model(model, "my_model.safetensors")
scores = highfive.evaluate(sys.argv[1], "my_model.safetensors")["scores"]
for method, values in scores.items():
    print(f"{method:<12}palm at contact {100.0 * values['palm_at_contact']:.1f} cm")
