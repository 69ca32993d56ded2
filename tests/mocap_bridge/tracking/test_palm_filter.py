import numpy as np
import pytest

from highfive.mocap_bridge.frames import PalmPose
from highfive.mocap_bridge.tracking.palm_filter import PalmFilter, PalmFilterSettings
from highfive.model.geometry import rotations

DT = 1.0 / 120.0
TIME = np.arange(600) * DT


def palm(position, normal=(0.0, 1.0, 0.0), fingers=(0.0, 0.0, -1.0), velocity=(0.0, 0.0, 0.0)):
    return PalmPose(*(np.array(vector, dtype=float) for vector in (position, normal, fingers, velocity)))


def smooth(palms):
    one = PalmFilter()
    return [one(p, DT) for p in palms]


def waving(noise, seed=0):
    """Palms of a hand that waves and turns, with noise in metres and in the directions."""
    rng = np.random.default_rng(seed)
    turn = rotations.from_rotation_vector(np.stack([0.8 * np.sin(3 * TIME), 0.5 * np.cos(2 * TIME), TIME], axis=-1))
    normal, fingers = rotations.rotate(turn, [0.0, 1.0, 0.0]), rotations.rotate(turn, [0.0, 0.0, -1.0])
    normal = normal + rng.normal(scale=10 * noise, size=normal.shape)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    fingers -= normal * np.sum(fingers * normal, axis=-1, keepdims=True)
    fingers /= np.linalg.norm(fingers, axis=-1, keepdims=True)
    position = np.stack([0.2 * np.sin(4 * TIME), 0.1 * np.cos(5 * TIME), 1.0 + 0.3 * np.sin(2 * TIME)], axis=-1)
    position += rng.normal(scale=noise, size=position.shape)
    return [palm(*vectors) for vectors in zip(position, normal, fingers, strict=True)]


def plainly_smooth(palms, settings):
    """The same as it is written down: alpha-beta-gamma and a critically damped low pass, vector by vector."""
    palm, *others = palms
    position, velocity, acceleration = palm.position, palm.velocity, np.zeros(3)
    directions, turning = np.array([palm.normal, palm.fingers]), np.zeros((2, 3))
    said = [palm]
    for one in others:
        forget = np.exp(-min(settings.slow + settings.faster * np.linalg.norm(velocity), settings.fastest) * DT)
        predicted = position + velocity * DT + 0.5 * acceleration * DT**2
        innovation = one.position - predicted
        position = predicted + (1.0 - forget**3) * innovation
        velocity = velocity + acceleration * DT + 1.5 * (1.0 - forget) ** 2 * (1.0 + forget) / DT * innovation
        acceleration = acceleration + (1.0 - forget) ** 3 / DT**2 * innovation
        away = np.array([one.normal, one.fingers]) - directions
        turning = turning + (settings.turning**2 * away - 2.0 * settings.turning * turning) * DT
        directions = directions + turning * DT
        normal = directions[0] / np.linalg.norm(directions[0])
        fingers = directions[1] - normal * (directions[1] @ normal)
        said.append(PalmPose(position, normal, fingers / np.linalg.norm(fingers), velocity))
    return said


@pytest.mark.parametrize("settings", [PalmFilterSettings(), PalmFilterSettings(faster=250.0, fastest=150.0)])
def test_it_is_what_the_plain_filter_gives(settings):
    one, palms = PalmFilter(settings), waving(1e-3)
    for found, plain in zip([one(p, DT) for p in palms], plainly_smooth(palms, settings), strict=True):
        for name in ("position", "normal", "fingers", "velocity"):
            np.testing.assert_allclose(getattr(found, name), getattr(plain, name), rtol=1e-9, atol=1e-11)


def test_what_it_said_stays_as_it_was():
    one, palms = PalmFilter(), waving(1e-3)[:4]
    said = [one(p, DT) for p in palms]
    again = [p.position.copy() for p in said]
    one(palm([1.0, 2.0, 3.0]), DT)
    np.testing.assert_array_equal([p.position for p in said], again)


@pytest.mark.parametrize("acceleration", [[0.0, 0.0, 0.0], [0.4, -0.2, 0.3]])
def test_it_does_not_lag_behind_a_constant_acceleration(acceleration):
    start, speed, acceleration = np.array([1.0, 0.1, 1.2]), np.array([-0.3, 0.2, 0.1]), np.array(acceleration)
    truth = start + speed * TIME[:, None] + 0.5 * acceleration * TIME[:, None] ** 2
    last = smooth([palm(p) for p in truth])[-1]  # whose first velocity was wrong
    np.testing.assert_allclose(last.position, truth[-1], atol=1e-9)
    np.testing.assert_allclose(last.velocity, speed + acceleration * TIME[-1], atol=1e-7)


def test_constant_directions_are_kept_and_a_step_is_approached_without_overshoot():
    aside = np.array([1.0, 0.0, 0.0])
    ahead = np.array([0.0, 1.0, 0.0])
    out = smooth([palm([0, 0, 0], ahead)] * 10 + [palm([0, 0, 0], (ahead + 0.2 * aside) / np.sqrt(1.04))] * 200)
    aside_part = np.array([p.normal @ aside for p in out])
    np.testing.assert_array_equal(aside_part[:10], 0.0)
    assert (np.diff(aside_part[10:]) > -1e-12).all()
    assert aside_part[-1] == pytest.approx(0.2 / np.sqrt(1.04), abs=1e-6)


def test_at_rest_the_variance_falls_as_theory_says():
    """Fading-memory filter of degree two: Morrison 1969; Brookner 1998, "Tracking and Kalman Filtering Made Easy"."""
    noise = 1e-6  # m; so little that the speed it feigns does not widen the band
    measured = np.random.default_rng(3).normal(scale=noise, size=(6000, 3))
    out = np.array([p.position for p in smooth([palm(position) for position in measured])])[600:]
    t = np.exp(-PalmFilterSettings().slow * DT)
    theory = (1 - t) * (1 + 6 * t + 16 * t**2 + 24 * t**3 + 19 * t**4) / (1 + t) ** 5
    assert out.var() / noise**2 == pytest.approx(theory, rel=0.15)


def test_a_hand_at_rest_does_not_shake():
    """What a joint that follows the palm sees of its noise are the differences from tick to tick."""
    rng = np.random.default_rng(3)
    position, tilt = rng.normal(scale=0.001, size=(600, 3)), rng.normal(scale=0.03, size=(600, 2))
    measured = [
        palm(p, np.array([a, 1.0, b]) / np.sqrt(1.0 + a * a + b * b)) for p, (a, b) in zip(position, tilt, strict=True)
    ]
    out = smooth(measured)
    for vector, share in (("position", 0.35), ("normal", 0.1)):
        before, after = (np.array([getattr(p, vector) for p in palms])[120:] for palms in (measured, out))
        assert np.diff(after, axis=0).std() < share * np.diff(before, axis=0).std()


def test_directions_stay_unit_vectors_at_right_angles():
    for p in smooth(waving(0.005)):
        assert p.normal @ p.normal == pytest.approx(1.0, abs=1e-12)
        assert p.fingers @ p.fingers == pytest.approx(1.0, abs=1e-12)
        assert p.normal @ p.fingers == pytest.approx(0.0, abs=1e-12)


def test_turning_and_shifting_the_world_turns_and_shifts_the_output():
    turn, shift = rotations.normalize(np.array([0.3, -0.4, 0.5, 0.7])), np.array([2.0, -1.0, 0.5])
    measured = waving(0.002)

    def moved(p):
        vectors = (rotations.rotate(turn, v) for v in (p.normal, p.fingers, p.velocity))
        return PalmPose(rotations.rotate(turn, p.position) + shift, *vectors)

    for here, there in zip(smooth(measured), smooth([moved(p) for p in measured]), strict=True):
        for vector in ("position", "normal", "fingers", "velocity"):
            np.testing.assert_allclose(getattr(there, vector), getattr(moved(here), vector), atol=1e-9)


def test_the_first_palm_and_the_first_after_a_reset_are_taken_as_they_are():
    measured = waving(0.002)
    used, fresh = PalmFilter(), PalmFilter()
    assert used(measured[0], DT) is measured[0]
    for p in measured[1:100]:
        used(p, DT)
    used.reset()
    for p in measured[200:260]:
        a, b = used(p, DT), fresh(p, DT)
        for vector in ("position", "normal", "fingers", "velocity"):
            np.testing.assert_array_equal(getattr(a, vector), getattr(b, vector))


def test_the_callers_palm_is_left_alone():
    measured = waving(0.002)[:3]
    before = [p.position.copy() for p in measured]
    smooth(measured)
    for p, position in zip(measured, before, strict=True):
        np.testing.assert_array_equal(p.position, position)


def test_settings_reach_the_filter():
    measured = waving(0.002)[:20]
    slow, usual = PalmFilter(PalmFilterSettings(slow=2.0, faster=0.1)), PalmFilter()
    for p in measured:
        left, right = slow(p, DT), usual(p, DT)
    assert not np.array_equal(left.position, right.position)
    turning = PalmFilter(PalmFilterSettings(turning=1.0))
    for p in measured:
        left = turning(p, DT)
    assert not np.array_equal(left.normal, right.normal)
