"""Messages that were damaged on their way."""

import numpy as np


def mutated(original: bytes, rng: np.random.Generator) -> bytearray:
    """Some bytes of a message changed, taken out or put in, or its end cut off."""
    data, places = bytearray(original), rng.integers(len(original), size=4)
    kind = rng.integers(6)
    if kind == 0:
        data[places[0]] = rng.integers(256)
    elif kind == 1:
        for place in places:
            data[place] ^= 1 << int(rng.integers(8))
    elif kind == 2:
        data[places[0] : places[0] + 4] = rng.choice(
            [b"\xff\xff\xff\xff", b"\0\0\0\0", b"\xff\xff\xff\x7f", b"\1\0\0\0"]
        )
    elif kind == 3:
        del data[places[0] :]
    elif kind == 4:
        del data[min(places[:2]) : max(places[:2])]
    else:
        data[places[0] : places[0]] = data[min(places[1:3]) : max(places[1:3])]
    return data
