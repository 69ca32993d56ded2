"""What a copy of this process does: from one beginning, which takes long, to many ends."""

import os
import pickle
import traceback
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


def forked(call: Callable[[], T]) -> T:
    """What ``call`` gives in a copy; nothing of what it does is left here."""
    reading, writing = os.pipe()
    if (copy := os.fork()) == 0:
        code = 1
        try:
            os.close(reading)
            found = pickle.dumps(call())
            with os.fdopen(writing, "wb") as pipe:
                pipe.write(found)
            code = 0
        except BaseException:  # nothing of the copy goes on to the test's end
            traceback.print_exc()
        finally:
            os._exit(code)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        said = pipe.read()
    _, status = os.waitpid(copy, 0)
    assert status == 0, "the copy failed: its error stands above"
    return pickle.loads(said)
