"""Very many different byte strings, a hundred for a number: Hypothesis would draw the same few again and again."""

import numpy as np

EXTREMES = (0, 1, 2, 3, 8, 0xFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFE, 0xFFFFFFFF)


def a_hundred(seed: int, longest: int = 300) -> list[bytes]:
    """Bytes of any value, small ones, words of which many are extreme, and text; up to ``longest`` of them."""
    rng = np.random.default_rng(seed)
    return [_some(rng, int(rng.integers(0, rng.choice([5, 17, 65, longest + 1])))) for _ in range(100)]


def _some(rng: np.random.Generator, length: int) -> bytes:
    match rng.integers(4):
        case 0:
            return rng.bytes(length)
        case 1:
            return rng.integers(0, 4, length, dtype=np.uint8).tobytes()
        case 2:
            words = rng.integers(0, 12, length // 4 + 1, dtype=np.uint32)
            extreme = rng.random(len(words)) < 0.3
            words[extreme] = rng.choice(np.array(EXTREMES, dtype=np.uint32), int(extreme.sum()))
            return words.tobytes()[:length]
        case _:
            return rng.integers(32, 127, length, dtype=np.uint8).tobytes()
