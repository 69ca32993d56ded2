"""``highfive serve``: a recording sent out as a live system, with whatever goes wrong on demand."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from highfive.hil.runtime.shutdown import until_ended
from highfive.mocap_bridge.files.c3d import read_c3d
from highfive.mocap_bridge.files.recording import Recording, columns_of_person, resample
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.markers.one_person import shows_right_arm
from highfive.mocap_bridge.servers.faults import Fault, Faults, parse_fault
from highfive.mocap_bridge.servers.serving import LOOPBACK, Server, serve
from highfive.mocap_bridge.sources.registry import BUILT_IN, scheme_named
from highfive.mocap_bridge.sources.scheme import Address
from highfive.model.errors import HighFiveError

STREAM_NAME = "HighFive"
"""Name of the LSL stream."""

RATES = (1.0, 2000.0)
"""Lowest and highest frame rate that is sent, Hz."""


@dataclass(frozen=True)
class ServeOptions:
    """What to send, and how.

    Attributes:
        protocol: one of :data:`highfive.mocap_bridge.sources.registry.BUILT_IN`.
        file: the recording.
        loop: begin again at the end, until ended.
        port: where to listen; None is the protocol's own, 0 any that is free.
        host: the address to listen at; only this machine unless set otherwise.
        faults: as :func:`highfive.mocap_bridge.servers.faults.parse_fault` reads them.
        rate_hz: frames per second; None is the recording's.
        person: prefix of the one person to send; None sends all.
        seconds: end after so long; None at the recording's end.
        seed: of what is random in the faults.
    """

    protocol: str
    file: Path
    loop: bool = False
    port: int | None = None
    host: str = LOOPBACK
    faults: tuple[str, ...] = ()
    rate_hz: float | None = None
    person: str | None = None
    seconds: float | None = None
    seed: int = 0


def serve_recording(options: ServeOptions, say: Callable[[str], None]) -> dict[str, Any]:
    """Sends the recording until its end, or until ended; ``say`` gets lines about it.

    Raises:
        HighFiveError: no such file, protocol, person, marker or fault; the port is taken.
    """
    if options.protocol not in BUILT_IN:
        raise HighFiveError(f"unknown protocol {options.protocol!r}; there are {', '.join(BUILT_IN)}")
    if not options.host:
        raise HighFiveError("--host is empty; give an address, or 0.0.0.0 to let in the whole network")
    faults = [parse_fault(text) for text in options.faults]
    recording = _recording(options)
    _check_markers(faults, recording.names)
    count, timer = 0, None

    def sent(_: MarkerFrame) -> None:
        nonlocal count
        count += 1

    with until_ended() as end:
        server = make_server(options, recording)
        try:
            address = address_of(options, server.port)
            for line in _description(options, recording, address):
                say(line)
            if options.seconds is not None:
                timer = threading.Timer(min(options.seconds, threading.TIMEOUT_MAX), end.set)
                timer.daemon = True
                timer.start()
            serve(recording, server, Faults(faults, options.seed), options.loop, end, sent)
        finally:
            if timer is not None:
                timer.cancel()
            server.close()
    say(f"{count} frame{'' if count == 1 else 's'} sent")
    return {
        "protocol": options.protocol,
        "address": str(address),
        "source": options.file.name,
        "rate_hz": recording.rate_hz,
        "markers": len(recording.names),
        "persons": list(recording.prefixes),
        "faults": list(options.faults),
        "frames_sent": count,
    }


def _recording(options: ServeOptions) -> Recording:
    recording = read_c3d(options.file)
    if options.person is not None:
        columns = columns_of_person(recording.names, options.person, recording.source)
        names = tuple(recording.names[m] for m in columns)
        recording = replace(
            recording, names=names, points=recording.points[:, columns], valid=recording.valid[:, columns]
        )
    rate = recording.rate_hz if options.rate_hz is None else options.rate_hz
    if not RATES[0] <= rate <= RATES[1]:
        raise HighFiveError(f"{rate:g} frames per second; expected {RATES[0]:g} to {RATES[1]:g} (--rate)")
    return resample(recording, rate)


def _check_markers(faults: Sequence[Fault], labels: Sequence[str]) -> None:
    """Finds a wrong marker in a fault at once, not when the fault is due."""
    known = {label.rpartition(":")[2] for label in labels} | set(labels)
    for fault in faults:
        for name in fault.names:
            if name not in known:
                raise HighFiveError(f"fault {fault.kind}: no marker {name!r}; there are {', '.join(labels)}")


def make_server(options: ServeOptions, recording: Recording) -> Server:
    """The server of the protocol, listening; its library is imported only where it is needed.

    Raises:
        HighFiveError: the port is taken or not allowed.
    """
    port = scheme_named(options.protocol).port if options.port is None else options.port
    rate = recording.rate_hz
    if options.protocol == "vicon":
        from highfive.mocap_bridge.servers.vicon import ViconServer  # noqa: PLC0415

        return ViconServer(rate_hz=rate, host=options.host, port=port)
    if options.protocol == "qtm":
        from highfive.mocap_bridge.servers.qtm import QtmServer  # noqa: PLC0415

        return QtmServer(host=options.host, port=port, names=recording.names, rate_hz=rate)
    if options.protocol == "natnet":
        from highfive.mocap_bridge.servers.natnet import NatNetServer  # noqa: PLC0415

        return NatNetServer(host=options.host, port=port, names=recording.names, rate_hz=rate)
    from highfive.mocap_bridge.servers.lsl import LslServer  # noqa: PLC0415

    if options.port is not None:
        raise HighFiveError("an LSL stream is found by its name; --port does not go with it")
    return LslServer(recording.names, rate, STREAM_NAME, local_only=options.host == LOOPBACK)


def address_of(options: ServeOptions, port: int) -> Address:
    """What a client gives to get the stream."""
    if options.protocol == "lsl":
        return Address("lsl", STREAM_NAME)
    host = LOOPBACK if options.host in ("", "0.0.0.0") else options.host
    return Address(options.protocol, host, port)


def _description(options: ServeOptions, recording: Recording, address: Address) -> list[str]:
    """What is sent, from where, and how to listen to it."""
    persons = [prefix for prefix in recording.prefixes if prefix]
    whole = sorted(persons, key=lambda prefix: not shows_right_arm(recording.person(prefix), None))
    who = f" --person {whole[0]}" if len(recording.prefixes) > 1 and persons else ""
    whose = f"of {' and '.join(persons)}" if persons else "without a person's name"
    loose = f", {recording.unlabelled.shape[1]} without a label" if recording.unlabelled.shape[1] else ""
    faults = f"; faults: {', '.join(options.faults)}" if options.faults else ""
    return [
        f"serving {address}   listen with: highfive stream '{address}'{who}",
        f"  {len(recording.names)} markers {whose}{loose}, labelled as in {recording.source}, "
        f"{recording.rate_hz:g} Hz, {len(recording)} frames{', again and again' if options.loop else ''}{faults}",
    ]
