"""Files that say more than they hold, never end, or take a parser for ever: one line, in little time and memory."""

import io
import json
import os
import resource
import time
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save

from highfive.model.errors import LONGEST, HighFiveError
from highfive.model.evaluation.nuisi_windows import read_windows
from highfive.model.files import check_size
from highfive.model.hgpdm.checkpoint import Checkpoint, Unfitting, is_checkpoint
from highfive.model.hgpdm.store import load_layer, load_model
from highfive.model.npz_file import read_npz
from highfive.model.toml_file import read_toml


@contextmanager
def little_memory(most_mb: int = 400) -> Iterator[None]:
    """What is allocated within may be so much."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + (most_mb << 20), before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        ("a\nb", "a\\nb"),
        ("\x1b[31m", "\\x1b[31m"),
        ("\ud800\u202e", "\\ud800\\u202e"),
        ("\u2028é\u2009 ü", "\\u2028é\u2009 ü"),
    ],
)
def test_an_error_is_a_line_whatever_it_quotes(said: str, shown: str) -> None:
    assert str(HighFiveError(said)) == shown


def test_a_long_error_is_cut_in_its_middle() -> None:
    text = str(HighFiveError("begin " + "x" * 100_000 + " end"))
    assert text.startswith("begin x") and text.endswith("x end") and len(text) <= LONGEST + 5


def test_a_pipe_a_device_and_a_large_file_are_refused_unread(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "large").write_bytes(bytes(11))
    for path in (tmp_path / "pipe", Path("/dev/zero"), tmp_path / "large", tmp_path):
        with pytest.raises(HighFiveError):
            check_size(path, 10)
    check_size(tmp_path / "large", 11)
    for read in (lambda path: read_toml(path, "it"), read_npz, load_model):
        with pytest.raises(HighFiveError):
            read(tmp_path / "pipe")


@pytest.mark.parametrize("key", ["a" + ".a" * 200_000 + " = 1", '"a"' + '."b"' * 5000 + " = 1", f"[{'1.1.' * 5000}a]"])
def test_a_key_of_many_parts_is_refused_and_numbers_are_not_its_parts(tmp_path: Path, key: str) -> None:
    path = tmp_path / "a.toml"
    path.write_text(key, encoding="utf-8")
    begun = time.process_time()
    with pytest.raises(HighFiveError, match="dots"):
        read_toml(path, "it")
    assert time.process_time() - begun < 1.0
    path.write_text(f"a = [{', '.join(['-0.5e-3'] * 3000)}]", encoding="utf-8")
    assert read_toml(path, "it") == {"a": [-0.5e-3] * 3000}


def bomb(path: Path, name: str) -> Path:
    """A list that says that a member unpacks to three gigabytes: what it says is what would be unpacked at most."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, bytes(1 << 20))
    content = bytearray(path.read_bytes())
    at = content.index(b"PK\x01\x02") + 24
    content[at : at + 4] = (3 << 30).to_bytes(4, "little")
    path.write_bytes(content)
    return path


def test_an_archive_that_unpacks_to_more_than_is_read_is_refused_before(tmp_path: Path) -> None:
    path = bomb(tmp_path / "train.checkpoint.npz", "owner.npy")
    begun = time.process_time()
    with little_memory():
        with pytest.raises(HighFiveError, match="unpacks to 1 arrays"):
            read_windows(path)
        with pytest.raises(Unfitting):
            Checkpoint(path, {}).load()
        assert not is_checkpoint(path)
    assert time.process_time() - begun < 1.0


def test_a_member_that_says_it_is_smaller_is_not_unpacked_further(tmp_path: Path) -> None:
    """The sizes in an archive's list are what is held against the limit: no more than they say is unpacked."""
    out = io.BytesIO()
    np.savez_compressed(out, a=np.zeros(30_000_000))
    content = bytearray(out.getvalue())
    at = content.index(b"PK\x01\x02") + 24  # in the list: so many bytes unpacked
    content[at : at + 4] = (1000).to_bytes(4, "little")
    path = tmp_path / "a.npz"
    path.write_bytes(content)
    with little_memory(), pytest.raises(HighFiveError, match="cut short or damaged"):
        read_npz(path)


def test_an_archive_with_many_arrays_is_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        for number in range(1001):
            archive.writestr(f"{number}.npy", b"")
    with pytest.raises(HighFiveError, match="1001 arrays"):
        read_npz(tmp_path / "a.npz")


@pytest.mark.parametrize(
    "description",
    [
        "[" * 100_000,
        '{"kind": "high-five hgpdm", "version": 4, "preset": {}, "stages": Infinity}',
        '{"kind": "high-five hgpdm", "version": 4, "preset": [], "emotions": 3, "stages": 1e400}',
        json.dumps({"kind": "high-five hgpdm", "version": 4, "preset": {"name": "x"}, "lag": 10**400}),
    ],
)
def test_a_model_with_an_odd_description_is_refused(tmp_path: Path, description: str) -> None:
    (tmp_path / "a.safetensors").write_bytes(save({"a": np.zeros(3)}, {"model": description}))
    with pytest.raises(HighFiveError):
        load_model(tmp_path / "a.safetensors")


def test_a_model_of_a_type_that_numpy_has_not_is_refused(tmp_path: Path) -> None:
    header = json.dumps({"a": {"dtype": "BF16", "shape": [2], "data_offsets": [0, 4]}}).encode()
    (tmp_path / "a.safetensors").write_bytes(len(header).to_bytes(8, "little") + header + bytes(4))
    for load in (load_model, load_layer):
        with pytest.raises(HighFiveError):
            load(tmp_path / "a.safetensors")
