"""A model answers a raised hand, ahead of time: where and when will the palms meet?

A simulated person raises a hand; the model sees wrist and knuckles, 120 times a second. One sees the forecast sharpen
as the hand comes: time left and place, each ± a standard deviation, beside what then happened. Takes 4 s.
"""

import numpy as np

import highfive

person = highfive.simulated_person("happy", "B2", seed=1)
session = highfive.open_session(person.marker_set)  # its tracker gives the hand; a lab's own (2, 3) m would do
responder = highfive.Responder(highfive.load_model(), "happy", rate_hz=120.0)
meeting = person.palm[person.contact_frame]
for number, frame in enumerate(person.frames()):
    left = (person.contact_frame - number) / 120.0
    if left < 0.0:
        break
    answer = responder.step(session.step(frame).person.hand_points)
    if number % 12 == 0 and left < 0.75 and (contact := answer.contact) is not None:
        spread = np.sqrt(np.trace(contact.covariance[:3, :3]))
        off = np.linalg.norm(contact.point - meeting)
        print(
            f"{left:.2f} s before: contact in {contact.time:.2f} ± {contact.deviation:.2f} s, "
            f"{1e2 * off:.1f} cm from the place (said: ± {1e2 * spread:.1f} cm)"
        )
print(f"the answer is a pose: {answer.joints.size} joint coordinates, palm at {answer.palm.round(2)} m")
