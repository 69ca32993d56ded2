from collections.abc import Callable

import numpy as np

from model.compiled import compiled_entry


def made_from_text(text: str) -> Callable:
    """A function that stands in no file, so that there is no place beside it to store its machine code."""
    names: dict[str, Callable] = {}
    exec(compile(text, "<text>", "exec"), names)
    return names["function"]


def test_a_place_that_cannot_be_written_to_is_no_obstacle():
    function = compiled_entry(made_from_text("def function(x):\n    return 2.0 * x"))
    assert function(1.5) == 3.0


def test_infinity_and_not_a_number_keep_their_meaning():
    function = compiled_entry(made_from_text("def function(x):\n    return (x - x) * 0.0, 1.0 / (x - x)"))
    np.testing.assert_array_equal(function(np.inf), [np.nan, np.nan])
    np.testing.assert_array_equal(function(1.0), [0.0, np.inf])
