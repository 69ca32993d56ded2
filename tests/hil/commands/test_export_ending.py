"""``highfive export`` refuses a file's name that ends as another format does."""

from pathlib import Path

import pytest

from highfive.hil.commands.export import ExportOptions, export
from highfive.model.errors import HighFiveError


@pytest.mark.parametrize(("kind", "name"), [("bvh", "x.glb"), ("glb", "x.BVH"), ("bids", "x.csv")])
def test_an_ending_of_another_format_is_refused_and_nothing_is_made(tmp_path: Path, kind: str, name: str) -> None:
    options = ExportOptions(tmp_path / "session.mcap", kind, tmp_path / name)
    with pytest.raises(HighFiveError, match=f"and --to is {kind}; write --to"):
        export(options, lambda *_: lambda note="", done=None: None)
    assert not list(tmp_path.iterdir())
