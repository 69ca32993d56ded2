"""A published session: what it costs a tick, and what arrives at a program that listens."""

from __future__ import annotations

import multiprocessing
import socket
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from importlib.util import find_spec
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
import pylsl

from highfive.hil.arm.lifecycle import at_their_time
from highfive.hil.publish.background import BackgroundPublisher
from highfive.hil.publish.foxglove_server import FoxglovePublisher
from highfive.hil.publish.lsl import LslPublisher
from highfive.hil.publish.lsl_streams import AVATAR, EVENTS, PERSON, avatar_stream, events_stream, person_stream
from highfive.hil.publish.publisher import SessionEvent
from highfive.hil.publish.vmc import VmcPublisher
from highfive.hil.recording.recorded_tick import recorded_tick
from highfive.hil.runtime.console import Bar
from highfive.hil.runtime.threads import quick_switching
from highfive.hil.session.session import RATE_HZ, Session, Tick, TickInput
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.playout import KinematicPlayOut, PlayState
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.events import TrialEvents
from highfive.hil.trials.partners import simulated_partners
from highfive.hil.trials.trial import as_captured, run_trial
from highfive.mocap_bridge.sources.lsl import configure
from highfive.mocap_bridge.sources.source import C3DSource
from highfive.model import DEFAULT_MODEL
from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.store import load_model

_FOUND_S, _LAST_S = 30.0, 2.0


@dataclass(frozen=True)
class PublishBenchOptions:
    """Pairs of high fives, published and not, and the seed of the simulated person."""

    pairs: int = 8
    seed: int = 0


@dataclass
class Heard:
    """What a program got: stamps (s) and channel labels of each LSL stream; VMC frames and Foxglove's ``/markers``."""

    stamps: dict[str, list[float]] = field(default_factory=dict)
    labels: dict[str, list[str]] = field(default_factory=dict)
    vmc: int = 0
    foxglove: int = 0


def listen(foxglove_port: int, said: Connection) -> None:
    """A program that hears everything, in a process of its own.

    Args:
        foxglove_port: of the server; 0 for none.
        said: takes the UDP port for VMC, then ``ready``; what comes back ends it; then takes what was :class:`Heard`.
    """
    configure(local_only=True)
    heard, over = Heard(), threading.Event()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(0.1)
        said.send(receiver.getsockname()[1])
        said.recv()  # everything is published from now on
        found = pylsl.resolve_bypred(" or ".join(f"name='{n}'" for n in (PERSON, AVATAR, EVENTS)), 3, _FOUND_S)
        inlets = {info.name(): pylsl.StreamInlet(info, recover=False) for info in found}
        for name, inlet in inlets.items():
            inlet.open_stream(_FOUND_S)
            described = inlet.info(_FOUND_S)
            heard.labels[name] = [str(label) for label in described.get_channel_labels() or []]
            heard.stamps[name] = []
        jobs = [threading.Thread(target=_hear_vmc, args=(receiver, heard, over))]
        if foxglove_port:
            jobs.append(threading.Thread(target=_hear_foxglove, args=(foxglove_port, heard, over)))
        for job in jobs:
            job.start()
        said.send("ready")
        while not said.poll():
            _hear_lsl(inlets, heard)
        end = time.monotonic() + _LAST_S
        while time.monotonic() < end:
            _hear_lsl(inlets, heard)
        over.set()
        for job in jobs:
            job.join()
    said.send(heard)


def _hear_lsl(inlets: dict[str, pylsl.StreamInlet], heard: Heard) -> None:
    for name, inlet in inlets.items():
        heard.stamps[name] += list(inlet.pull_chunk(0.0, 1024, as_numpy=False)[1])
    time.sleep(0.02)


def _hear_vmc(receiver: socket.socket, heard: Heard, over: threading.Event) -> None:
    while not over.is_set():
        try:
            heard.vmc += b"/VMC/Ext/T\0" in receiver.recv(65536)
        except TimeoutError:
            continue


def _hear_foxglove(port: int, heard: Heard, over: threading.Event) -> None:
    import json  # noqa: PLC0415

    from websockets.sync.client import connect  # noqa: PLC0415
    from websockets.typing import Subprotocol  # noqa: PLC0415

    markers = 0
    with connect(f"ws://127.0.0.1:{port}", subprotocols=[Subprotocol("foxglove.sdk.v1")], max_queue=None) as link:
        while not over.is_set():
            try:
                data = link.recv(0.1)
            except TimeoutError:
                continue
            if isinstance(data, bytes):
                heard.foxglove += data[1] == markers
                continue
            for channel in json.loads(data).get("channels", []):
                markers = channel["id"] if channel["topic"] == "/markers" else markers
                if channel["topic"] in ("/tf", "/markers", "/skeleton"):
                    wanted = [{"id": channel["id"], "channelId": channel["id"]}]
                    link.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))


def bench_publish(options: PublishBenchOptions, bar: Bar) -> dict[str, Any]:
    """All ways at once; Foxglove is left out where its package is not installed.

    Raises:
        HighFiveError: a way cannot begin, or nobody could listen.
    """
    advance = bar("published session", 2 * options.pairs)
    scene, model = build_scene(), load_model(DEFAULT_MODEL)
    emotion = next(iter(EMOTIONS))
    partner = simulated_partners(1, (emotion,), ("B2",), options.seed)[0]
    session, playout = Session(model, {emotion: 1.0}, partner.marker_set, scene), KinematicPlayOut(scene)
    names = partner.marker_set.names
    took: dict[bool, list[float]] = {True: [], False: []}
    handing: dict[bool, list[float]] = {True: [], False: []}
    sent = {PERSON: 0, AVATAR: 0, EVENTS: 0}
    with ExitStack() as stack:
        foxglove = FoxglovePublisher(0) if find_spec("foxglove") else None
        listener, said = _listener(0 if foxglove is None else foxglove.port)
        lsl, vmc = LslPublisher(names, (RATE_HZ, RATE_HZ)), VmcPublisher("127.0.0.1", _told(said))
        ways = [BackgroundPublisher(one) for one in (lsl, vmc, foxglove) if one is not None]
        for way in ways:
            stack.callback(way.close)
        said.send("begin")
        _told(said)
        stack.enter_context(quick_switching())
        for turn in range(2 * options.pairs):
            published = turn % 2 == 0
            inputs = as_captured(at_their_time(C3DSource(partner.recording, RATE_HZ)))
            over: list[float] = []
            keep = _handing(ways if published else [], TrialEvents(), sent, over)
            result = run_trial(turn, partner, session, playout, inputs, keep=keep)
            took[published] += (result.tick_ms + np.array(over))[1:].tolist()
            handing[published] += over[1:]
            advance()
        said.send("over")
        heard: Heard = said.recv()
        listener.join()
    usual, ratio = _parts(took[False]), {}
    for part, published in _parts(took[True]).items():
        ratio[part] = round(published / usual[part], 3)
    poses = np.array(heard.stamps[AVATAR])
    apart = [float(np.min(np.abs(poses - stamp))) for stamp in heard.stamps[EVENTS]] if len(poses) else []
    expected = {
        stream.name: [channel["label"] for channel in stream.channels]
        for stream in (person_stream(names, RATE_HZ, 0.0), avatar_stream(RATE_HZ), events_stream())
    }
    return {
        "tick_ms": usual,
        "tick_ratio": ratio["p99"],
        "tick_ratio_p50": ratio["p50"],
        "handing_over_ms": _parts(handing[True]),
        "recording_alone_ms": _parts(handing[False]),
        "sent": sent,
        "lost": {name: sent[name] - len(heard.stamps[name]) for name in sent},
        "label_errors": sum(heard.labels[name] != expected[name] for name in expected),
        "event_to_pose_ms": round(1e3 * max(apart, default=float("nan")), 4),
        "vmc": {"frames": heard.vmc, "left_out": ways[1].dropped},
        "foxglove": None if foxglove is None else {"messages": heard.foxglove, "left_out": ways[2].dropped},
    }


def _parts(values: list[float]) -> dict[str, float]:
    return {f"p{part}": round(float(np.percentile(values, part)), 3) for part in (50, 99)}


def _handing(
    ways: list[BackgroundPublisher], events: TrialEvents, sent: dict[str, int], over: list[float]
) -> Callable[[TickInput, Tick, PlayState, float], None]:
    """Hands ticks over as a session does, beside what it makes for its recording anyway; what all of that takes goes to
    ``over``, ms.
    """

    def keep(begins: TickInput, tick: Tick, state: PlayState, tick_ms: float) -> None:
        start = time.perf_counter_ns()
        news = [recorded_tick(begins, tick, state.pose, tick_ms)]
        happened = [SessionEvent(event, begins.at_ns) for event in events(tick, state)]
        for way in ways:
            for one in (*news, *happened):
                way.give(one)
        if ways:
            sent[AVATAR] += 1
            sent[PERSON] += tick.sighting is not None
            sent[EVENTS] += len(happened)
        over.append(1e-6 * (time.perf_counter_ns() - start))

    return keep


def _listener(foxglove_port: int) -> tuple[Any, Connection]:
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=listen, args=(foxglove_port, there), daemon=True)
    process.start()
    there.close()
    return process, here


def _told(said: Connection) -> Any:
    try:
        return said.recv()
    except EOFError:
        raise HighFiveError("the program that listens has ended: LSL streams cannot be heard on this machine") from None


def print_publish(result: dict[str, Any]) -> None:
    """The figures, for people."""
    over, alone = result["handing_over_ms"], result["recording_alone_ms"]
    lost, sent = result["lost"], result["sent"]
    usual = result["tick_ms"]
    print(f"tick, nothing published median {usual['p50']:.2f} ms, p99 {usual['p99']:.2f} ms")
    print(f"tick, all published     median × {result['tick_ratio_p50']:.2f}, p99 × {result['tick_ratio']:.2f}")
    print(f"of it handing over      median {over['p50']:.3f} ms; to a recording alone {alone['p50']:.3f} ms")
    for name, count in lost.items():
        print(f"{name:<24}{count} lost of {sent[name]}")
    print(f"labels that are wrong   {result['label_errors']}")
    print(f"event to its pose       {result['event_to_pose_ms']:.4f} ms at most")
    print(f"VMC frames              {result['vmc']['frames']}, {result['vmc']['left_out']} left out")
    if result["foxglove"] is None:
        print("Foxglove                not installed: pip install 'high-five[foxglove]'")
    else:
        print(f"Foxglove's markers      {result['foxglove']['messages']}, {result['foxglove']['left_out']} left out")
