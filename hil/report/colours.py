"""One colour and one mark an emotion, the same in every figure, film and table.

Okabe & Ito's palette (2008), which people with any colour vision tell apart; the marks say it again without colour.
"""

from matplotlib.colors import to_hex, to_rgb

_EMOTIONS = {
    "neutral": ("#009E73", "o"),
    "happy": ("#E69F00", "^"),
    "angry": ("#D55E00", "s"),
    "sad": ("#3A86C8", "v"),
}
_OTHERS = (("#CC79A7", "D"), ("#8C6BB1", "P"), ("#7F7F7F", "X"))

_METHODS = {
    "hgpdm": ("#0072B2", "o"),
    "adapted": ("#56B4E9", "P"),
    "sparse_gp": ("#D55E00", "s"),
    "knn": ("#CC79A7", "^"),
    "ridge": ("#009E73", "D"),
    "mean": ("#7F7F7F", "X"),
    "constant_velocity": ("#7F7F7F", "v"),
    "minimum_jerk": ("#BCBD22", "<"),
    "gaussian_mixture": ("#8C564B", ">"),
}

PERSON = "#8C6BB1"
PARTNER = "#CC79A7"


def colour_of(emotion: str) -> str:
    """Hex colour of an emotion."""
    return _look(emotion)[0]


def blend_of(start: str, end: str, weight: float) -> str:
    """Hex colour between those of two emotions, ``weight`` (0 to 1) of the second."""
    pairs = zip(to_rgb(colour_of(start)), to_rgb(colour_of(end)), strict=True)
    red, green, blue = ((1.0 - weight) * first + weight * second for first, second in pairs)
    return to_hex((red, green, blue))


def mark_of(emotion: str) -> str:
    """Matplotlib marker of an emotion."""
    return _look(emotion)[1]


def method_look(method: str) -> tuple[str, str]:
    """Hex colour and matplotlib marker of a method that is scored."""
    return _METHODS.get(method) or _OTHERS[sum(method.encode()) % len(_OTHERS)]


def _look(emotion: str) -> tuple[str, str]:
    # Emotions of other labs' data: the same one always looks the same.
    return _EMOTIONS.get(emotion) or _OTHERS[sum(emotion.encode()) % len(_OTHERS)]
