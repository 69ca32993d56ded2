"""What a training will take is refused before a marker is solved, for as many as run at once."""

import pytest

from highfive.hil.commands.training_memory import checked_memory
from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.presets import DEFAULT

LENGTHS = [3.0] * 40  # s


def test_what_runs_at_once_adds_up_and_what_is_too_much_is_one_line() -> None:
    alone = checked_memory(LENGTHS, DEFAULT, 200, limit_gb=1000.0)
    assert checked_memory(LENGTHS, DEFAULT, 200, limit_gb=1000.0, at_once=3) == pytest.approx(3.0 * alone)
    assert checked_memory(LENGTHS * 100, DEFAULT, 200, limit_gb=1000.0) > 2.0 * alone
    checked_memory(LENGTHS, DEFAULT, 200, limit_gb=1.1 * alone)
    with pytest.raises(HighFiveError, match=r"3 times \d+ points need about .* GB, there are .*fewer --jobs"):
        checked_memory(LENGTHS, DEFAULT, 200, limit_gb=1.1 * alone, at_once=3)
