"""A plan with a number that is none is refused in one line."""

import re
from pathlib import Path

import pytest

from highfive.hil.experiments.plan import draw_plan
from highfive.hil.experiments.plan_file import plan_toml, read_plan
from highfive.hil.experiments.protocol_file import TEMPLATES, read_protocol
from highfive.model.errors import HighFiveError


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e999"])
def test_a_number_that_is_none_is_refused(tmp_path: Path, value: str) -> None:
    text = plan_toml(draw_plan(read_protocol(TEMPLATES / "high_five.toml"), 1)).decode()
    path = tmp_path / "plan.toml"
    path.write_text(text, encoding="utf-8")
    assert read_plan(path).trials
    changed, count = re.subn(r"= (\{[^}]*?= )?1\.0\b", lambda found: found.group().replace("1.0", value), text, count=1)
    assert count
    path.write_text(changed, encoding="utf-8")
    with pytest.raises(HighFiveError, match="finite"):
        read_plan(path)
