"""A model answers a hand: wrist and knuckles in, the avatar's joints and the contact that it expects out."""

import numpy as np

import highfive

model = highfive.load_model()
responder = highfive.Responder(model, "happy", rate_hz=120.0)
for height in np.linspace(1.0, 1.4, 60):
    hand = np.array([[0.60, -0.20, height], [0.55, -0.20, height + 0.09]])  # wrist, knuckles, m
    answer = responder.step(hand)
print(f"contact in {answer.time_to_contact:.2f} s at {answer.contact_point.round(2)} m, joints {answer.joints.shape}")
