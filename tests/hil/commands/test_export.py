"""``highfive export``: what it writes, says and refuses."""

import json
import os
import shutil
from pathlib import Path

import pytest
from command_line import failing, running
from disk import files_no_larger_than
from mcap.writer import Writer
from shipped import shipped_recording, shipped_trials

from highfive.hil.view import SHIPPED_RECORDING

run, fails = running("export"), failing("export")
TRIALS = [f"session_trial0{n}_{style}" for n, style in enumerate(("neutral", "happy", "angry", "sad"), 1)]
FILES = {
    "bvh": [f"{name}.bvh" for name in TRIALS],
    "csv": [f"session_{name}.csv" for name in ("person", "avatar", "markers", "contacts")],
    "npz": ["session.npz"],
    "c3d": [*(f"{name}.c3d" for name in TRIALS), "trials.csv"],
}


@pytest.fixture
def session(tmp_path) -> Path:
    folder = tmp_path / "session-1"
    folder.mkdir()
    shutil.copy(SHIPPED_RECORDING, folder / "session.mcap")
    return folder


def there(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()} - {"session.mcap"}


@pytest.mark.slow
@pytest.mark.parametrize("kind", FILES)
def test_files_lie_beside_the_recording_and_json_names_them(run, session, kind):
    code, out, _ = run(session, "--to", kind, "--json")
    said = json.loads(out)
    assert code == 0
    assert said["files"] == [str(session / name) for name in FILES[kind]]
    assert there(session) == set(FILES[kind])
    assert said["frames"] == 918 and said["trials"] == [1, 2, 3, 4] and said["complete"]
    assert said["duration"] == pytest.approx(sum(it.times[-1] - it.times[0] for it in shipped_trials()), abs=1e-5)


def test_bids_is_a_folder(run, session):
    assert run(session / "session.mcap", "--to", "bids")[0] == 0
    assert "session_bids/sub-01/motion/sub-01_task-highfive_tracksys-person_run-04_motion.tsv" in there(session)


def test_one_high_five_under_a_name_of_its_own(run, session, tmp_path):
    code, out, _ = run(session, "--to", "bvh", "--trial", "3", "--out", tmp_path / "new" / "angry.bvh", "--json")
    assert code == 0 and json.loads(out)["trials"] == [3] and json.loads(out)["frames"] == 147
    assert there(tmp_path / "new") == {"angry.bvh"}


@pytest.mark.slow
def test_out_is_a_folder_or_begins_the_names(run, session, tmp_path):
    run(session, "--to", "csv", "--out", tmp_path / "one")
    assert there(tmp_path / "one") == set(FILES["csv"])
    run(session, "--to", "csv", "--out", tmp_path / "two" / "mine.csv")
    assert there(tmp_path / "two") == {name.replace("session", "mine") for name in FILES["csv"]}


@pytest.mark.parametrize(
    "kind", ["bvh", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("csv", "npz", "c3d", "bids"))]
)
@pytest.mark.slow
def test_what_is_there_stays_unless_it_may_be_replaced(run, fails, session, kind):
    assert run(session, "--to", kind)[0] == 0
    before = {name: (session / name).read_bytes() for name in there(session)}
    one = sorted(before)[-1]
    (session / one).write_text("mine")
    assert "--overwrite" in fails(session, "--to", kind)
    assert (session / one).read_text() == "mine"
    assert run(session, "--to", kind, "--overwrite")[0] == 0
    assert kind == "npz" or {name: (session / name).read_bytes() for name in there(session)} == before


def test_a_recording_without_an_end_is_exported_as_far_as_it_goes(run, session):
    path = session / "session.mcap"
    path.write_bytes(path.read_bytes()[: int(0.7 * path.stat().st_size)])
    os.utime(path, (0, path.stat().st_mtime + 600.0))  # however slow the machine is, it was written just now
    code, out, err = run(session, "--to", "npz", "--json")
    assert code == 0 and "session.mcap is still being written: exported is what there is of it" in err
    os.utime(path, (0, path.stat().st_mtime - 1200.0))
    code, out, err = run(session, "--to", "npz", "--json", "--overwrite")
    said = json.loads(out)
    assert code == 0 and not said["complete"] and 100 < said["frames"] < 918
    assert "session.mcap has no end" in err


def test_a_high_five_of_a_single_tick_is_left_out_of_what_moves(run, fails, session):
    """A recording of the first high five, and of the first tick of the second."""
    recording, end = shipped_recording(), shipped_trials()[1].span.start_ns
    with (session / "session.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        for topic, messages in recording.channels.items():
            channel = writer.register_channel(topic, "json", writer.register_schema(topic, "jsonschema", b"{}"))
            for message in messages:
                if message.time_ns <= end:
                    writer.add_message(channel, message.time_ns, json.dumps(message.data).encode(), message.time_ns)
        writer.finish()
    code, out, err = run(session, "--to", "bvh", "--json")
    assert code == 0 and "left out: 1 high five of a single tick" in err
    assert json.loads(out)["trials"] == [1] and json.loads(out)["frames"] == 246
    assert there(session) == {"session_trial01.bvh"}  # its /trial comes after its tick, and says nothing of it
    assert "csv and npz hold single ticks" in fails(session, "--to", "bids", "--trial", "2")
    assert json.loads(run(session, "--to", "npz", "--json")[1])["trials"] == [1, 2]


@pytest.mark.parametrize("content", [b"", b"junk" * 999, b"\x89MCAP0\r\n", b"\x89MCAP0\r\n" + b"\xff" * 99])
def test_what_is_no_recording_is_refused(fails, tmp_path, content):
    path = tmp_path / "session.mcap"
    path.write_bytes(content)
    assert "session.mcap" in fails(path, "--to", "csv")
    assert there(tmp_path) == set()


def test_refusals(fails, session, tmp_path):
    assert "No such file" in fails(tmp_path / "none.mcap", "--to", "csv")
    assert "bvh, glb, c3d, csv, npz, bids" in fails(session, "--to", "fbx")
    assert "no high five 5 in the recording; it holds 1, 2, 3, 4;" in fails(session, "--to", "bvh", "--trial", "5")
    assert "is a folder" in fails(session, "--to", "npz", "--out", _folder(tmp_path / "x" / "session.npz").parent)
    assert there(session) == set()


def _folder(path: Path) -> Path:
    path.mkdir(parents=True)
    return path


@pytest.mark.parametrize("kind", ["bvh", "csv", "c3d", "bids"])
def test_a_full_disk_is_one_line_and_leaves_nothing_half_done(run, session, kind):
    with files_no_larger_than(100_000):
        code, out, err = run(session, "--to", kind)
    (line,) = [line for line in err.splitlines() if line.startswith("error:")]
    assert code == 2 and out == "" and "cannot write" in line
    assert there(session) == set()
    assert [path.name for path in session.iterdir()] == ["session.mcap"]


@pytest.mark.parametrize(("kind", "name"), [("bvh", "x.glb"), ("glb", "x.BVH"), ("bids", "x.csv")])
def test_an_ending_of_another_format_is_refused_and_nothing_is_made(fails, tmp_path: Path, kind: str, name: str):
    assert f"and --to is {kind}; write --to" in fails(tmp_path / "session.mcap", "--to", kind, "--out", tmp_path / name)
    assert not list(tmp_path.iterdir())
