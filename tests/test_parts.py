"""CI's slow tests in parts: every file is in one of them, and they take about as long as each other."""

from hypothesis import given
from hypothesis import strategies as st
from parts import shared_out

seconds = st.dictionaries(st.text(min_size=1, max_size=5), st.floats(0.1, 100.0), max_size=40)


@given(seconds, st.integers(1, 7))
def test_each_file_is_in_one_part_and_no_part_is_longer_than_the_longest_file_beyond_another(
    takes: dict[str, float], parts: int
) -> None:
    part_of = shared_out(takes, parts)
    assert part_of.keys() == takes.keys()
    load = [sum(takes[name] for name, part in part_of.items() if part == k) for k in range(parts)]
    assert max(load) - min(load) <= max(takes.values(), default=0.0) + 1e-9


@given(seconds, st.randoms(use_true_random=False))
def test_the_order_in_which_files_were_found_changes_nothing(takes: dict[str, float], random) -> None:
    names = list(takes)
    random.shuffle(names)
    assert shared_out({name: takes[name] for name in names}, 3) == shared_out(takes, 3)
