"""Who hears a session, and which streams of others it records, as its options say."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING

from highfive.calibration.latency_file import load_latencies
from highfive.hil.arm_model.arm_folder import DEFAULT_ARM
from highfive.hil.commands.headset_session import wears_headset
from highfive.hil.commands.live_options import LONGEST_LATENCY_MS, sees_webcam
from highfive.hil.commands.simulate_options import SimulateOptions
from highfive.hil.publish.background import BackgroundPublisher
from highfive.hil.publish.outputs import SessionOutputs
from highfive.hil.publish.publisher import Publisher
from highfive.hil.publish.wanted import FOXGLOVE, LSL, VMC, Wanted, parse_wanted
from highfive.hil.recording.background import BackgroundRecorder
from highfive.hil.recording.stream_samples import check_stream_names
from highfive.hil.runtime.clock import Clock
from highfive.hil.runtime.console import say_aside
from highfive.hil.session.session import RATE_HZ
from highfive.hil.session.session_streams import PERSON
from highfive.hil.session.stream import StreamSettings
from highfive.mocap_bridge.sources.address import is_live, parse_address
from highfive.model.errors import HighFiveError

if TYPE_CHECKING:
    from highfive.hil.trials.live_partner import LivePerson

_SLOWEST, _FASTEST = RATE_HZ / 1.4, 1.05 * RATE_HZ
"""Hz; a tick begins with every frame, and with nothing else, of a system whose rate is between these."""


def published(text: str | None) -> tuple[Wanted, ...]:
    """What ``--publish`` says; see :func:`highfive.hil.publish.wanted.parse_wanted`."""
    return () if text is None else parse_wanted(text)


def check_output_options(options: SimulateOptions, *, again: bool = False) -> None:
    """What does not go together; ``again`` where a recorded session is played again.

    Raises:
        HighFiveError: something does not.
    """
    check_stream_names(options.record_lsl)
    _check_person(options, known_of(options).get(PERSON))
    if options.publish_network and not options.publish:
        raise HighFiveError("--publish-network says who may hear what --publish sends; add --publish")
    if again and (options.publish or options.record_lsl):
        raise HighFiveError("a recorded session is played as fast as it goes: leave out --publish and --record-lsl")
    if (options.publish or options.record_lsl) and options.arm is not None and options.arm.port == "virtual":
        said = "--publish sends" if options.publish else "--record-lsl records"
        raise HighFiveError(f"{said} what goes at the pace of the clock; --rig virtual does not: --rig emulated")


def open_publishers(options: SimulateOptions, stack: ExitStack) -> list[BackgroundPublisher]:
    """All that need not know who the person is; closed with ``stack`` at the latest.

    Raises:
        HighFiveError: one cannot begin.
    """
    found: list[Publisher] = []
    # Each imports what the others do without.
    for wanted in options.publish:
        if wanted.way == VMC:
            from highfive.hil.publish.vmc import VmcPublisher  # noqa: PLC0415

            found.append(VmcPublisher(wanted.host, wanted.port))
        elif wanted.way == FOXGLOVE:
            from highfive.hil.publish.foxglove_server import FoxglovePublisher  # noqa: PLC0415

            arm = DEFAULT_ARM if options.arm is None else options.arm.arm
            found.append(FoxglovePublisher(wanted.port, local_only=not options.publish_network, arm=arm))
    return [_begun(publisher, stack) for publisher in found]


def open_outlets(
    options: SimulateOptions, markers: Sequence[str], person: LivePerson | None, stack: ExitStack
) -> list[BackgroundPublisher]:
    """LSL's, where it was asked for: of a person with these markers; ``person`` where she is live.

    Raises:
        HighFiveError: the library cannot make them.
    """
    if not any(wanted.way == LSL for wanted in options.publish):
        return []
    from highfive.hil.publish.lsl import LslPublisher  # noqa: PLC0415  (loads the library)

    if not options.publish_network and _searches_network(options):
        # The library has one setting for both.
        say_aside(
            "the LSL source is searched for on the network, which sees the session's streams, too", logging.WARNING
        )
    rates = nominal_rates(RATE_HZ if person is None else person.rate_hz)
    lag_s = 0.0 if person is None else 1e-9 * person.latency_ns
    return [
        _begun(
            LslPublisher(markers, rates, lag_s, pages=options.view is not None, local_only=_lsl_here(options)), stack
        )
    ]


def session_outputs(
    options: SimulateOptions, recorder: BackgroundRecorder, publishers: Sequence[BackgroundPublisher],
    person: LivePerson | None, clock: Clock,
) -> SessionOutputs:  # fmt: skip
    """Where the session goes; a live ``person`` is one of its streams."""
    outputs = SessionOutputs(
        recorder, publishers, options.record_lsl, local_only=_lsl_here(options), clock=clock, known=known_of(options)
    )
    if person is not None:
        outputs.streams.follow(person.source, by_page=wears_headset(options) or sees_webcam(options))
    return outputs


def known_of(options: SimulateOptions) -> dict[str, StreamSettings]:
    """What ``--latencies`` says of streams.

    Raises:
        HighFiveError: the file cannot be read.
    """
    kept = {} if options.latencies is None else load_latencies(options.latencies)
    return {
        name: StreamSettings(latency_ns=round(1e6 * one.latency_ms), latency_bound_ns=round(1e6 * one.bound_ms))
        for name, one in kept.items()
    }


def _check_person(options: SimulateOptions, known: StreamSettings | None) -> None:
    """A live person's latency, said and measured, can be predicted over.

    Raises:
        HighFiveError: it cannot, or the person's system tells it itself.
    """
    if known is None or options.source is None or not is_live(options.source):
        return
    if sees_webcam(options):
        raise HighFiveError(f"a webcam says itself when it saw: take {PERSON} out of {options.latencies}")
    whole_ms = options.latency_ms + 1e-6 * known.latency_ns
    if whole_ms > LONGEST_LATENCY_MS:
        raise HighFiveError(
            f"{options.latencies} has {PERSON} {1e-6 * known.latency_ns:g} ms late, {whole_ms:g} with --latency; "
            f"expected {LONGEST_LATENCY_MS:g} at most, over more nobody can predict a hand"
        )


def nominal_rates(rate_hz: float) -> tuple[float, float]:
    """Of the person's samples and the avatar's, Hz, where frames come at ``rate_hz``; 0 where they are irregular."""
    person = rate_hz if rate_hz <= _FASTEST else 0.0
    return person, rate_hz if _SLOWEST <= rate_hz <= _FASTEST else 0.0


def _begun(publisher: Publisher, stack: ExitStack) -> BackgroundPublisher:
    behind = BackgroundPublisher(publisher)
    stack.callback(behind.close)
    say_aside(f"published by {behind.name}")
    return behind


def _searches_network(options: SimulateOptions) -> bool:
    source = options.source
    return source is not None and is_live(source) and parse_address(source).scheme == "lsl"


def _lsl_here(options: SimulateOptions) -> bool:
    """LSL is restricted to this machine: where something is published, and nothing else was asked for."""
    return any(wanted.way == LSL for wanted in options.publish) and not options.publish_network
