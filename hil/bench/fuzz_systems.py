"""What motion capture systems, LSL streams and servos send, through what hears them."""

from __future__ import annotations

import socket
import struct
import time
from pathlib import Path
from typing import Any

import numpy as np

from highfive.hil.bench.fuzz_mutations import damaged_bytes, damaged_text
from highfive.hil.bench.fuzz_reader import Seed
from highfive.hil.drivers.bus.instruction_packets import ping, write
from highfive.hil.drivers.bus.packet_decoder import Decoder
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.natnet_columns import Columns, marker_frame
from highfive.mocap_bridge.sources.qtm import QtmLink
from highfive.mocap_bridge.sources.vicon import ViconLink
from highfive.mocap_bridge.wire import lsl, natnet, qtm, vicon
from highfive.mocap_bridge.wire.natnet_frame import Frame, decode_frame, encode_frame, labelled_markers
from highfive.mocap_bridge.wire.natnet_model import MarkerSet, decode_model, encode_model

_MOST_SENT = 150_000
"""Bytes that fit into a socket that nobody reads yet."""
_POINTS = np.linspace(-500.0, 1500.0, 18, dtype=np.float32).reshape(6, 3)
_WAIT_S = 0.5


def vicon_seeds() -> list[Seed]:
    """A greeting, subjects, and frames."""
    subject = vicon.Subject(1, "Anna", tuple((m, f"M{m}") for m in range(6)))
    ids = np.array([[1, m] for m in range(6)], np.uint32)
    labelled = vicon.Labelled(ids, 1e-3 * _POINTS.astype(float))
    static = vicon.Packet(period=vicon.TICKS_HZ // 120, y_up=False, subjects=(subject,))
    frames = [
        vicon.Packet(
            number=n, labelled=labelled, unlabelled=np.ones((1, 3)), latencies=(("a", 0.005),), rates=(("a", 120.0),)
        )
        for n in range(3)
    ]
    greeting = vicon.Packet(enums=frozenset(int(kind) for kind in vicon.Kind))
    sent = [greeting, static, *frames, vicon.Packet(number=3, unchanged=frozenset({int(vicon.Kind.LABELED_RECONS)}))]
    content = b"".join(vicon.encode(packet) for packet in sent)
    return [Seed(content, _vicon, ends=True), Seed(vicon.encode(frames[0])[8:], lambda data, _: vicon.decode(data))]


def _vicon(content: bytes, folder: Path) -> Any:
    with socket.create_server(("127.0.0.1", 0)) as server:
        ours = socket.create_connection(server.getsockname())
        theirs, _ = server.accept()
    with theirs:
        theirs.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
        theirs.sendall(content[:_MOST_SENT])
        theirs.shutdown(socket.SHUT_WR)
        link = ViconLink(ours, "there", False, time.monotonic() + _WAIT_S)
        try:
            return _all(link)
        finally:
            link.close()


def _all(link: ViconLink | QtmLink) -> list[MarkerFrame]:
    """Frames until the connection ends, which is an error of ours."""
    frames: list[MarkerFrame] = []
    while True:
        frames += link.receive(_WAIT_S)
        for frame in frames:
            assert np.isfinite(frame.positions).all(), "NaN past the bridge"


def qtm_seeds() -> list[Seed]:
    """Greeting, answer, parameters, and frames."""
    parameters = qtm.encode_parameters([f"A:M{m}" for m in range(6)], 120.0)
    content = b"".join(
        (
            qtm.encode_text(qtm.Kind.COMMAND, qtm.GREETING),
            qtm.encode_text(qtm.Kind.COMMAND, "Version set to 1.25"),
            qtm.encode_text(qtm.Kind.XML, parameters),
            *(qtm.encode_data(8333 * n, n, _POINTS, _POINTS[:2]) for n in range(3)),
            qtm.encode(qtm.Kind.EVENT, b"\x0b"),
            qtm.encode_text(qtm.Kind.XML, parameters),
            qtm.encode_data(8333, 7, _POINTS, _POINTS[:1], tuple(qtm.Component)),
        )
    )
    xml = Seed(parameters.encode(), lambda data, _: qtm.decode_parameters(data), damaged_text)
    data = qtm.encode_data(8333, 7, _POINTS, _POINTS[:1])[8:]
    return [Seed(content, _qtm, ends=True), xml, Seed(data, lambda data, _: qtm.decode_data(data))]


def _qtm(content: bytes, folder: Path) -> Any:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        theirs.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
        theirs.sendall(content[:_MOST_SENT])
        theirs.shutdown(socket.SHUT_WR)
        return _all(QtmLink(ours, "there", time.monotonic() + _WAIT_S))


def natnet_seeds() -> list[Seed]:
    """Datagrams of each kind, of three versions."""
    seeds = []
    for version in ((3, 0), (4, 0), (4, 1)):
        points = 1e-3 * _POINTS
        labelled = labelled_markers(np.arange(6) + 65537, points, np.full(6, 10))
        frame = Frame(77, (("Anna", points), ("all", points)), points[:2] + 1, labelled, 12.5, False)
        sets = [MarkerSet("Anna", tuple(f"M{m}" for m in range(6))), MarkerSet("all", ("a", "b"))]
        model = encode_model(sets, version)
        columns = Columns(decode_model(natnet.decode(model)[1], version))
        sent = (
            natnet.encode_server_info(natnet.ServerInfo("Motive", version, "239.255.42.99", 1511)),
            model,
            encode_frame(frame, version),
        )

        def heard(content: bytes, folder: Path, version: Any = version, columns: Columns = columns) -> Any:
            return _natnet(content, version, columns)

        seeds += [Seed(datagram, heard) for datagram in sent]
    return seeds


def _natnet(content: bytes, version: Any, columns: Columns) -> Any:
    kind, body = natnet.decode(content)
    if kind == natnet.Kind.SERVER_INFO:
        return natnet.decode_server_info(body)
    if kind == natnet.Kind.MODEL:
        return Columns(decode_model(body, version))
    if kind != natnet.Kind.FRAME:
        return None
    frame = decode_frame(body, version)
    made = marker_frame(frame, columns, True, 1_000_000) if columns.fit(frame) else None
    assert made is None or np.isfinite(made.positions).all(), "NaN past the bridge"
    return made


def lsl_seeds() -> list[Seed]:
    """A stream's description with its samples behind."""
    rows = "".join(
        "<channel>" + "".join(f"<{name}>{text}</{name}>" for name, text in row.items()) + "</channel>"
        for row in lsl.channel_descriptions([f"Anna:M{m}" for m in range(6)])
    )
    xml = f'<?xml version="1.0"?><info><name>m</name><desc><channels>{rows}</channels></desc></info>'
    content = _POINTS.astype("<f4").tobytes() + xml.encode()
    settings = b"[lab]\nKnownPeers = {10.0.0.1, 10.0.0.2}\n[multicast]\nResolveScope = link\n"
    return [
        Seed(content, _lsl, damaged_text),
        Seed(content, _lsl, damaged_bytes),
        Seed(settings, lambda data, _: lsl.library_settings(data.decode("utf-8", "replace"), True), damaged_text),
    ]


def _lsl(content: bytes, folder: Path) -> Any:
    size = 4 * _POINTS.size
    samples = np.frombuffer(content[:size].ljust(size, b"\0"), "<f4").reshape(1, -1)
    xml = content[size:].decode("utf-8", "replace")
    labels = lsl.channel_labels(xml, samples.shape[1])
    points, valid, impossible = lsl.markers_of(lsl.parse_description(xml, samples.shape[1]), samples)
    assert np.isfinite(points[valid]).all(), "NaN past the bridge"
    return labels, points, impossible


def bus_seeds() -> list[Seed]:
    """Packets of servos, one after the other."""
    status = bytes.fromhex("fffffd00010800550006042669260000")
    return [Seed(ping(1) + write(1, 64, b"\1") + status + struct.pack("<I", 7), _bus)]


def _bus(content: bytes, folder: Path) -> Any:
    decoder = Decoder()
    return [decoder.feed(content[at : at + 37]) for at in range(0, len(content), 37)], decoder.idle()
