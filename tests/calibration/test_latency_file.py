"""Latencies in a file: as they were, or one line."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from highfive.calibration.latency_file import KeptLatency, load_latencies, save_latencies
from highfive.model.errors import HighFiveError

DATE = "2026-11-25T10:00:00+00:00"


@pytest.mark.slow
@given(
    st.dictionaries(st.text(min_size=1, max_size=8), st.integers(0, 2_000_000), min_size=1, max_size=4),
    st.text(max_size=8),
)
def test_what_is_written_is_read(
    tmp_path_factory: pytest.TempPathFactory, micros: dict[str, int], reference: str
) -> None:
    path = tmp_path_factory.mktemp("latencies") / "latencies.toml"
    try:
        kept = {name: KeptLatency(us / 1000, 0.5, 7, reference, "session.mcap", DATE) for name, us in micros.items()}
        "".join((*kept, reference)).encode()
    except UnicodeEncodeError:
        return
    save_latencies(path, kept, replace=False)
    assert load_latencies(path) == kept


REST = 'bound_ms = 1\nevents = 5\nreference = "a"\nsource = "b"\n'


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[meta]\nformat = 2\n[stream]",
        "[meta]\nformat = 1",
        "[meta]\nformat = 1\n[stream]\nx = 3",
        f'[meta]\nformat = 1\n[stream.x]\nlatency_ms = -1\n{REST}date = "2026-01-01"',
        f'[meta]\nformat = 1\n[stream.x]\nlatency_ms = nan\n{REST}date = "2026-01-01"',
        f'[meta]\nformat = 1\n[stream.x]\nlatency_ms = 1\n{REST}date = "now"',
        f"[meta]\nformat = 1\n[stream.x]\nlatency_ms = 1\n{REST}",
    ],
)
def test_what_is_no_latency_is_one_line(text: str, tmp_path: Path) -> None:
    (tmp_path / "l.toml").write_text(text)
    with pytest.raises(HighFiveError, match=r"l\.toml holds no latencies") as error:
        load_latencies(tmp_path / "l.toml")
    assert "\n" not in str(error.value)
