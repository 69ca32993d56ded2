"""The one exception root of the project."""

from __future__ import annotations

from unicodedata import category

_ACTING = frozenset(("Cc", "Cf", "Cs", "Zl", "Zp"))
"""Unicode's control, format and surrogate characters, and ends of lines and paragraphs."""

LONGEST = 1000
"""Characters of a message that are shown: what a file holds may be long."""


class HighFiveError(Exception):
    """Something a user can put right.

    The message says, in one line, what was got, what was expected and what to do. The command line prints it without a
    traceback and exits with code 2. What it quotes of a file cannot do more to a terminal than stand in that line.
    """

    def __str__(self) -> str:
        """The message; signs that are none to be printed are written out, and of a long one the middle is left out."""
        return printable(super().__str__())


def printable(text: str) -> str:
    """The text as one line, with what a terminal would act upon written out (``\\x1b``), and not too long."""
    if len(text) > LONGEST:
        text = f"{text[: LONGEST * 2 // 3]} … {text[-LONGEST // 3 :]}"
    if text.isprintable():
        return text
    return "".join(sign.encode("unicode_escape").decode() if category(sign) in _ACTING else sign for sign in text)
