"""The style may change at any time, to any other, without a jump."""

from collections.abc import Callable, Iterable
from itertools import combinations

import numpy as np
import pytest

from highfive.hil.session.reach import Phase
from highfive.hil.session.session import RATE_HZ, Session, Tick
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.partners import simulated_partners
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.source import C3DSource
from highfive.model import DEFAULT_MODEL
from highfive.model.hgpdm.store import load_model
from highfive.model.online.belief_settings import BELIEF

EMOTIONS = load_model(DEFAULT_MODEL).emotions
SLACK = {False: 1.25, True: 1.5}
"""By whether it is corrected: motions that are mixed vary a little beside each other, and so does the correction."""


@pytest.fixture(scope="module")
def frames() -> list[MarkerFrame]:
    return list(C3DSource(simulated_partners(1, ("happy",), ("B2",), 11)[0].recording))


@pytest.fixture(scope="module")
def session() -> Session:
    person = simulated_partners(1, ("happy",), ("B2",), 11)[0]
    return Session(load_model(DEFAULT_MODEL), {EMOTIONS[0]: 1.0}, person.marker_set, build_scene())


@pytest.fixture(scope="module")
def unchanged(session: Session, frames: list[MarkerFrame]) -> dict[str, list[Tick]]:
    return {emotion: play(session, frames, lambda number, tick, emotion=emotion: emotion) for emotion in EMOTIONS}


def play(session: Session, frames: list[MarkerFrame], style: Callable[[int, Tick | None], str]) -> list[Tick]:
    ticks: list[Tick] = []
    session.set_style({style(0, None): 1.0})
    session.reset()
    for number, frame in enumerate(frames):
        session.set_style({style(number, ticks[-1] if ticks else None): 1.0})
        ticks.append(session.step(frame))
    return ticks


def hinges(ticks: Iterable[Tick], corrected: bool) -> np.ndarray:
    return np.array([(tick.pose if corrected else tick.generated).hinges for tick in ticks])


def largest_steps(angles: np.ndarray) -> tuple[float, float]:
    """Largest change of a hinge's speed, rad/s, and of its acceleration, rad/s², from tick to tick."""
    return tuple(float(np.abs(np.diff(angles, n=n, axis=0)).max() * RATE_HZ ** (n - 1)) for n in (2, 3))


@pytest.mark.parametrize(("one", "other"), list(combinations(EMOTIONS, 2)))
@pytest.mark.slow
def test_a_change_at_any_phase_adds_no_more_than_the_smoothing_lets_through(
    session: Session, frames: list[MarkerFrame], unchanged: dict[str, list[Tick]], one: str, other: str
) -> None:
    changes: dict[int, str] = {}

    def style(number: int, last: Tick | None) -> str:
        """The other style at 0.1 s; from then on back and forth, 0.04 s into each new phase."""
        phase = "waiting" if last is None or last.target.phase is Phase.IDLE else last.target.phase.value
        since.append(phase)
        if number >= 12 and len(since) > 5 and since[-5:] == [phase] * 5 and phase not in changes.values():
            changes[number] = phase
        return (one, other)[len(changes) % 2]

    since: list[str] = []
    ticks = play(session, frames, style)
    assert list(changes.values()) == ["waiting", "approach", "touch", "release"]
    for corrected in (False, True):
        pure = [hinges(unchanged[emotion], corrected) for emotion in (one, other)]
        usual = np.max([largest_steps(angles) for angles in pure], axis=0)
        # A step of the weights behind two smoothings of time constant τ starts with an acceleration of 1 / τ², and
        # is at most 1 / (e τ) fast; by the product rule, what two motions differ by is moved so, and their speeds too.
        apart, tau = pure[0] - pure[1], BELIEF.style_time
        place, speed, turn = (np.abs(np.diff(apart, n=n, axis=0) if n else apart).max() * RATE_HZ**n for n in (0, 1, 2))
        rise, bend = 1.0 / (np.e * tau), 1.0 / tau**2
        start = place * bend * np.array([1.0 / RATE_HZ, 1.0])
        start += np.array([2.0 * rise * speed, 3.0 * rise * turn + 3.0 * bend * speed]) / RATE_HZ
        assert np.all(largest_steps(hinges(ticks, corrected)) <= SLACK[corrected] * usual + start)
    # The change is one: half a second after the last, everything is as in the style that was arrived at.
    assert max(changes) < len(ticks) - 60
    arrived = unchanged[style(len(frames), ticks[-1])]
    np.testing.assert_allclose(hinges(ticks[-1:], False), hinges(arrived[-1:], False), atol=np.radians(1.0))
