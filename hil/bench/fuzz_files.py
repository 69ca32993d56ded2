"""Files of each format but TOML, and what reads them."""

from __future__ import annotations

import io
import json
import struct
import zlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from highfive.calibration.pose_file import TakenPose, load_poses, save_poses
from highfive.hil.bench.fuzz_mcap import damaged_mcap, short_recording
from highfive.hil.bench.fuzz_mutations import (
    damaged_bytes,
    damaged_json,
    damaged_npz,
    damaged_safetensors,
    damaged_text,
)
from highfive.hil.bench.fuzz_reader import Seed, of_file
from highfive.hil.commands.import_motion import ImportOptions, import_motion
from highfive.hil.experiments.analysis.csv_rows import read_rows
from highfive.hil.recording.exports.trial_arrays import export_trials
from highfive.hil.recording.recording import read_recording
from highfive.hil.recording.session_reader import read_session
from highfive.mocap_bridge.files.c3d import read_c3d, write_c3d
from highfive.mocap_bridge.files.recording import make_recording, resample
from highfive.mocap_bridge.files.take_file import TakeWriter, take_to_c3d
from highfive.mocap_bridge.files.trial_table import read_table, read_without_contact
from highfive.mocap_bridge.files.xdf import read_xdf
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.model.evaluation.nuisi_windows import read_windows
from highfive.model.files import DEFAULT_MODEL
from highfive.model.gp.posterior import Posterior
from highfive.model.hgpdm.checkpoint import Checkpoint, is_checkpoint
from highfive.model.hgpdm.store import load_layer, load_model, save_layer, save_model

_OWNER = {"data": "d", "seed": 1}
_NAMES = ("human:RFIN", "human:RWRA", "human:RELB", "human:RSHO", "human:RFHD", "human:LFHD", "human:CLAV")


def c3d_seeds() -> list[Seed]:
    """Of real numbers, of whole ones (as some systems write them), and big-endian."""
    rng = np.random.default_rng(0)
    points = np.cumsum(rng.normal(0.0, 0.01, (6, len(_NAMES), 3)), axis=0) + rng.normal(1.0, 0.4, (1, len(_NAMES), 3))
    valid = rng.random(points.shape[:2]) > 0.1
    recording = make_recording(120.0, _NAMES, points, valid)
    recording = replace(recording, unlabelled=points[:, :1], unlabelled_valid=valid[:, :1])
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.c3d"
        write_c3d(path, recording)
        content = path.read_bytes()
    at = content.index(b"SCALE") + 5 + 2  # behind its name: where the next is
    whole = bytearray(content)
    whole[at + 2 : at + 6] = struct.pack("<f", 0.1)
    return [Seed(content, _c3d), Seed(bytes(whole), _c3d), Seed(content, _any_c3d)]


def _read_c3d(path: Path, trusted: bool) -> Any:
    recording = read_c3d(path, trust_unit=trusted)
    return [resample(recording.person(prefix), 100.0) for prefix in recording.prefixes]


_c3d = of_file("trial.c3d", lambda path: _read_c3d(path, True))
_any_c3d = of_file("trial.c3d", lambda path: _read_c3d(path, False))


def mcap_seeds() -> list[Seed]:
    """A short recording, read in each way."""
    content = short_recording()
    return [Seed(content, of_file("session.mcap", read), damaged_mcap) for read in (_recording, _session, _exported)]


def _recording(path: Path) -> Any:
    found = read_recording(path)
    return [found.arrays(topic) for topic in found.channels]


def _session(path: Path) -> Any:
    session = read_session(path)
    return session.complete, [one.arrays(topic) for one in session for topic in one.messages]


def _exported(path: Path) -> Any:
    return [trial.load() for trial in export_trials(read_session(path))]


def safetensors_seeds() -> list[Seed]:
    """The model that comes along with three inducing inputs a layer, and one layer."""
    model = load_model(DEFAULT_MODEL)
    layers = {name: _short(getattr(model, name)) for name in ("dynamics", "interaction", "human", "avatar")}
    latents = ("interaction_latents", "avatar_latents", "human_latents", "trial", "emotion")
    short = replace(
        model, **layers, **{name: getattr(model, name)[:3] for name in latents}, back=tuple(map(_short, model.back)),
        contact=None, arm_contact=None, ensemble=None,
        intent=None if model.intent is None else replace(model.intent, posterior=_short(model.intent.posterior)),
    )  # fmt: skip
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.safetensors"
        save_model(short, path)
        whole = path.read_bytes()
        save_layer(short.human, path)
        layer = path.read_bytes()
    return [
        Seed(whole, of_file("model.safetensors", load_model), damaged_safetensors),
        Seed(layer, of_file("layer.safetensors", load_layer), damaged_safetensors),
    ]


def _short(layer: Posterior) -> Posterior:
    style = None if layer.style is None else layer.style[:3]
    few = {"inducing": layer.inducing[:3], "weights": layer.weights[:3], "reduction": layer.reduction[:3, :3]}
    return layer._replace(style=style, **few)


def npz_seeds() -> list[Seed]:
    """Windows of an interaction benchmark, and a checkpoint, packed and not."""
    rng, out = np.random.default_rng(0), io.BytesIO()
    arrays: dict[str, Any] = {}
    for part in ("train", "test"):
        arrays |= {f"{part}_input": rng.normal(0.0, 0.3, (60, 90)), f"{part}_target": rng.normal(0.0, 0.3, (60, 20))}
        arrays |= {f"{part}_sequence_lengths": np.array([30, 30]), f"{part}_action": np.array([0, 1])}
    arrays |= {"input_frames": np.array(5), "input_differences": np.array(1), "input_unit": np.array("m")}
    np.savez_compressed(out, **arrays)
    windows = Seed(out.getvalue(), of_file("windows.npz", read_windows), damaged_npz)
    out = io.BytesIO()
    np.savez(out, owner=np.array(json.dumps(_OWNER)), parameters=rng.normal(size=50), starts=np.array("[]"))
    return [windows, Seed(out.getvalue(), of_file("train.checkpoint.npz", _checkpoint), damaged_npz)]


def _checkpoint(path: Path) -> Any:
    return is_checkpoint(path), Checkpoint(path, _OWNER).load()


_JOINTS = ("Hips", "Head", "LeftArm", "RightShoulder", "RightArm", "RightForeArm", "RightHand", "RightHandMiddle1")


def bvh_seeds() -> list[Seed]:
    """A right arm and a head, as one chain."""
    lines, frames = ["HIERARCHY"], 3
    for depth, name in enumerate(_JOINTS):
        channels = "6 Xposition Yposition Zposition" if not depth else "3"
        lines += [f"{'JOINT' if depth else 'ROOT'} {name}", "{", "OFFSET 0.0 30.0 0.0"]
        lines += [f"CHANNELS {channels} Zrotation Xrotation Yrotation"]
    lines += ["End Site", "{", "OFFSET 0.0 8.0 0.0", "}", *["}"] * len(_JOINTS), "MOTION", f"Frames: {frames}"]
    values = " ".join(f"{0.5 * n:.2f}" for n in range(3 + 3 * len(_JOINTS)))
    lines += ["Frame Time: 0.0083333", *[values] * frames]
    return [Seed("\n".join(lines).encode(), of_file("motion.bvh", _imported), damaged_text)]


def trc_seeds() -> list[Seed]:
    """Seven markers."""
    head = [
        "PathFileType\t4\t(X/Y/Z)\ta.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"100\t100\t4\t{len(_NAMES)}\tmm\t100\t1\t4",
        "Frame#\tTime\t" + "\t\t\t".join(_NAMES),
        "\t\t" + "\t".join(f"{axis}{n}" for n in range(1, 1 + len(_NAMES)) for axis in "XYZ"),
    ]
    rows = ["\t".join([f"{k + 1}", f"{0.01 * k:.3f}", *_coordinates(k, 1e3)]) for k in range(4)]
    return [Seed("\n".join([*head, *rows]).encode(), of_file("motion.trc", _imported), damaged_text)]


def csv_seeds() -> list[Seed]:
    """Motion with commas, and with semicolons and decimal commas."""
    heads = ["time", *(f"{name}_{axis}" for name in _NAMES for axis in "xyz")]
    rows = [[f"{0.01 * k:.3f}", *_coordinates(k, 1.0)] for k in range(4)]
    comma = "\n".join(",".join(row) for row in (heads, *rows))
    semicolon = "\n".join(";".join(cell.replace(".", ",") for cell in row) for row in (heads, *rows))
    return [Seed(text.encode(), of_file("motion.csv", _imported), damaged_text) for text in (comma, semicolon)]


def _coordinates(frame: int, scale: float) -> list[str]:
    return [f"{scale * (0.3 * m + 0.01 * frame + 0.2 * axis):.4f}" for m in range(len(_NAMES)) for axis in range(3)]


def _imported(path: Path) -> Any:
    """As ``highfive import`` does: it is read, put into metres, and written as C3D."""
    units = None if path.suffix == ".trc" else "m"
    options = ImportOptions((path,), path.parent / "imported", units=units, up="z", overwrite=True)
    return import_motion(options, lambda label, total: lambda note="", done=None: None)


_TABLE = (
    "file,emotion,cell,repetition,split,contact\n"
    "a.c3d,angry,B2,1,train,yes\nb.c3d,sad,C1,2,test,\nc.c3d,sad,,,train,1\n"
)


def table_seeds() -> list[Seed]:
    """``trials.csv``, and a table of answers."""
    rows = "participant,item,value,condition\nP01,natural,5,\nP02,stiff,3,\n"
    columns, more = ("participant", "item", "value"), ("condition",)
    return [
        Seed(_TABLE.encode(), of_file("trials.csv", lambda path: read_table(path.parent)), damaged_text),
        Seed(_TABLE.encode(), of_file("trials.csv", lambda path: read_without_contact(path.parent)), damaged_text),
        Seed(rows.encode(), of_file("own.csv", lambda path: read_rows(path, columns, more)), damaged_text),
    ]


def json_seeds() -> list[Seed]:
    """The poses that a calibration keeps while it is under way."""
    pose = TakenPose(np.zeros(6), np.zeros(6), np.ones(6), np.zeros((3, 3)), np.ones(3, bool))
    with TemporaryDirectory() as folder:
        save_poses(Path(folder) / "poses.json", "arm", ("a", "b", "c"), [pose, pose])
        content = (Path(folder) / "poses.json").read_bytes()
    return [Seed(content, of_file("p.json", lambda path: load_poses(path, "arm", ("a", "b", "c"), 6)), damaged_json)]


def xdf_seeds() -> list[Seed]:
    """Numbers, texts, and measurements of a clock."""
    content = b"XDF:" + _chunk(1, b"<info><version>1.0</version></info>")
    for number, (kind, form) in enumerate((("EEG", "float32"), ("Markers", "string")), start=1):
        header = (
            f"<info><name>{kind}</name><type>{kind}</type><channel_count>1</channel_count><nominal_srate>100</nominal_srate>"
            f"<channel_format>{form}</channel_format><desc><channels><channel><label>a</label></channel></channels></desc></info>"
        )
        content += _chunk(2, struct.pack("<I", number) + header.encode())
        value = struct.pack("<f", 1.5) if number == 1 else b"\x01\x05hello"
        samples = b"".join((b"\x08" + struct.pack("<d", 0.01 * k) if k % 2 == 0 else b"\0") + value for k in range(6))
        content += _chunk(3, struct.pack("<I", number) + b"\x01\x06" + samples) + _chunk(5, bytes(16))
        content += b"".join(_chunk(4, struct.pack("<Idd", number, t, 0.001 * t)) for t in range(4))
    return [Seed(content, of_file("a.xdf", _synchronised))]


def _chunk(tag: int, body: bytes) -> bytes:
    return b"\x04" + struct.pack("<IH", len(body) + 2, tag) + body


def _synchronised(path: Path) -> Any:
    return [stream.on_recorder_clock(stream.stamps) for stream in read_xdf(path)]


def take_seeds() -> list[Seed]:
    """What ``stream --record`` writes while frames come: read into C3D when the recording ends, or after a crash."""
    with TemporaryDirectory() as folder:
        contents = []
        for counted in (True, False):
            writer = TakeWriter(Path(folder) / f"{counted}.raw")
            writer.add([_frame(k, counted) for k in range(8)], 120.0)
            writer.close()
            contents.append((Path(folder) / f"{counted}.raw").read_bytes())
    return [Seed(content, of_file("take.raw", _converted), _damaged_take) for content in contents]


def _frame(number: int, counted: bool) -> MarkerFrame:
    points, seen = np.ones((3, 3)) * 0.1 * number, np.array([True, True, number % 2 == 0])
    at = 8_333_333 * number
    return MarkerFrame(("a", "b", "c"), points, seen, number, at, at, np.zeros((1, 3)), counted=counted)


def _converted(path: Path) -> Any:
    return take_to_c3d(path, path.parent / "take.c3d", replace=True)


_BLOCK = struct.Struct("<cII")


def _damaged_take(rng: Random, content: bytes, others: Sequence[bytes]) -> bytes:
    """Damaged within blocks, whose sums then fit again; a third by bytes."""
    if rng.random() < 0.33:
        return damaged_bytes(rng, content, others)
    blocks, at = list[tuple[bytes, bytes]](), 16
    while at < len(content):
        kind, size, _ = _BLOCK.unpack_from(content, at)
        at += _BLOCK.size + size
        blocks.append((kind, content[at - size : at]))
    for _ in range(rng.choice((1, 1, 3))):
        place = rng.randrange(len(blocks))
        kind, body = blocks[place]
        damage = damaged_json if kind == b"N" else damaged_bytes
        blocks[place] = rng.choice((kind, kind, kind, b"S", b"F")), damage(rng, body, [body])
        if rng.random() < 0.2:
            blocks.insert(rng.randrange(len(blocks)), blocks.pop(place))
    return content[:16] + b"".join(_BLOCK.pack(kind, len(body), zlib.crc32(body)) + body for kind, body in blocks)
