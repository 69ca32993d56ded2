"""What of High Five works on this computer, and what to do about what does not.

Each finding is looked for by itself: whatever a look at the machine raises is a finding too, so that the command never
fails for want of something that it looks for.
"""

from __future__ import annotations

import os
import platform
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Any

from highfive.hil.runtime.console import counted
from highfive.model.errors import HighFiveError
from highfive.model.plugins import PluginError, fault

GOOD, MISSING, BROKEN = "good", "missing", "broken"
_OPENGL_SECONDS = 60.0
_DRAW = (
    "import mujoco; m = mujoco.MjModel.from_xml_string('<mujoco/>'); r = mujoco.Renderer(m, 8, 8); "
    "r.update_scene(mujoco.MjData(m)); r.render()"
)


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Attributes:
        group: heading.
        name: what.
        state: :data:`GOOD`, :data:`MISSING` (something does not work without it) or :data:`BROKEN`.
        found: what was found.
        advice: what to do; '' where there is nothing to do.
    """

    group: str
    name: str
    state: str
    found: str
    advice: str = ""


def examine() -> list[Finding]:
    """Everything that is looked at, in the order in which it is shown. Never raises."""
    looks: list[tuple[str, str, Callable[[], Finding | list[Finding]]]] = [
        ("computer", "Python", _python),
        ("computer", "platform", _platform),
        ("computer", "processor", _processor),
        ("computer", "disk", _disk),
        ("computer", "real-time priority", _priority),
        ("software", "packages", _packages),
        ("software", "compiled code", _compiled),
        ("pictures", "OpenGL", _opengl),
        ("pictures", "film", _film),
        ("motion capture", "plug-ins", _plugins),
        ("motion capture", "ports", _ports),
        ("motion capture", "LSL", _lsl),
        ("motion capture", "webcam", _webcam),
        ("servo arm", "serial", _serial),
    ]
    findings: list[Finding] = []
    for group, name, look in looks:
        try:
            found = look()
        except Exception as error:  # what cannot be looked at is a finding
            found = Finding(group, name, BROKEN, fault(error))
        findings += found if isinstance(found, list) else [found]
    return findings


def as_json(findings: list[Finding]) -> dict[str, Any]:
    """The findings for machines; ``ready`` says whether a simulated session works."""
    return {"ready": ready(findings), "findings": [asdict(finding) for finding in findings]}


def ready(findings: list[Finding]) -> bool:
    """Whether a simulated session works: nothing that it cannot do without is missing."""
    return not any(finding.state == BROKEN for finding in findings if finding.group in ("computer", "software"))


def print_findings(result: Mapping[str, Any]) -> None:
    """The findings for people, under their headings."""
    group, width = "", max(len(row["name"]) for row in result["findings"]) + 2
    for row in result["findings"]:
        if row["group"] != group:
            group = row["group"]
            print(group)
        mark = {GOOD: "  ", MISSING: "– ", BROKEN: "! "}[row["state"]]
        print(f"  {mark}{row['name']:<{width}}{row['found']}")
        if row["advice"]:
            print(f"    {'':<{width}}→ {row['advice']}")
    todo = sum(bool(row["advice"]) for row in result["findings"])
    works = "A simulated session works here" if result["ready"] else "A simulated session does NOT work here"
    print(f"{works}; {counted(todo, 'piece')} of advice above." if todo else f"{works}.")


def _python() -> Finding:
    good = sys.version_info >= (3, 11)
    found = f"{platform.python_version()} ({sys.executable})"
    return Finding(
        "computer", "Python", GOOD if good else BROKEN, found, "" if good else "install Python 3.11 or newer"
    )


def _platform() -> Finding:
    return Finding("computer", "platform", GOOD, f"{platform.system()} {platform.release()}, {platform.machine()}")


def _processor() -> Finding:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    name = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.is_file():
        models = [line.partition(":")[2].strip() for line in info.read_text().splitlines() if "model name" in line]
        name = models[0] if models else name
    few = "with a servo arm, two cores or more keep its cycle" if cores < 2 else ""
    return Finding("computer", "processor", GOOD if cores > 1 else MISSING, f"{counted(cores, 'core')}, {name}", few)


def _disk() -> Finding:
    free = shutil.disk_usage(Path.cwd()).free / 1e9
    if not os.access(Path.cwd(), os.W_OK):
        return Finding("computer", "disk", MISSING, "nothing can be written here", "run it in a folder of your own")
    low = free < 1.0
    advice = "make room: a session of 36 high fives takes some 50 MB" if low else ""
    return Finding("computer", "disk", MISSING if low else GOOD, f"{free:.1f} GB free here", advice)


def _priority() -> Finding:
    if not hasattr(os, "sched_setscheduler"):
        return Finding("computer", "real-time priority", MISSING, "this system has none; the servo arm runs without")
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    except OSError:
        advice = (
            "for a real arm: put '@realtime - rtprio 50' into /etc/security/limits.d/, and yourself into that group"
        )
        return Finding("computer", "real-time priority", MISSING, "not allowed to this user", advice)
    os.sched_setscheduler(0, *before)
    return Finding("computer", "real-time priority", GOOD, "allowed")


def _packages() -> list[Finding]:
    findings = [
        Finding("software", "high-five", GOOD, _version("high-five") or _version("high-five-mocap") or "source")
    ]
    for line in requires("high-five") or []:
        if "extra ==" in line:
            continue
        name = line.partition(">")[0].partition("<")[0].partition("=")[0].strip(" ;(")
        found = _version(name)
        advice = "" if found else f"pip install {name}"
        findings.append(Finding("software", name, GOOD if found else BROKEN, found or "not installed", advice))
    return findings


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def _compiled() -> Finding:
    import numba  # noqa: PLC0415

    from highfive.model.online.layer import predict_layer  # noqa: PLC0415

    kept = getattr(getattr(predict_layer, "_cache", None), "cache_path", None)
    if kept is None:
        advice = "set NUMBA_CACHE_DIR to a folder that can be written to; else every start compiles for a minute"
        return Finding(
            "software", "compiled code", MISSING, f"numba {numba.__version__} has no place to keep it", advice
        )
    return Finding("software", "compiled code", GOOD, f"kept in {kept}")


def _opengl() -> Finding:
    # In a process of its own: a graphics driver that fails may end the process.
    for backend in ("", "egl", "osmesa"):
        environment = {**os.environ, **({"MUJOCO_GL": backend} if backend else {})}
        try:
            done = subprocess.run(
                [sys.executable, "-c", _DRAW],
                env=environment,
                capture_output=True,
                timeout=_OPENGL_SECONDS,
                check=False,
            )
        except subprocess.TimeoutExpired:
            continue
        if done.returncode == 0:
            how = backend or os.environ.get("MUJOCO_GL", "") or "a window system"
            return Finding("pictures", "OpenGL", GOOD, f"MuJoCo draws by {how}")
    advice = "sudo apt install libegl1 libgl1-mesa-dri (Debian, Ubuntu); --no-pictures does without"
    return Finding("pictures", "OpenGL", MISSING, "MuJoCo cannot draw: no film, no pictures of the scene", advice)


def _film() -> Finding:
    import imageio_ffmpeg  # noqa: PLC0415

    return Finding("pictures", "film", GOOD, f"ffmpeg {imageio_ffmpeg.get_ffmpeg_version()}")


def _plugins() -> list[Finding]:
    from highfive.mocap_bridge.sources.registry import scheme_named, scheme_names  # noqa: PLC0415

    findings = []
    for name in scheme_names():
        try:
            findings.append(Finding("motion capture", f"{name}://", GOOD, scheme_named(name).example))
        except PluginError as error:
            findings.append(
                Finding("motion capture", f"{name}://", BROKEN, str(error), "mend or uninstall the plug-in")
            )
    return findings


def _ports() -> Finding:
    """Ports that frames come to here, taken by another program."""
    from highfive.mocap_bridge.sources.natnet import DATA_PORT  # noqa: PLC0415

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("", DATA_PORT))
        except OSError as error:
            advice = "another program listens there; NatNet by multicast needs it, unicast does not"
            return Finding("motion capture", f"UDP port {DATA_PORT}", MISSING, f"{error.strerror or error}", advice)
    return Finding("motion capture", f"UDP port {DATA_PORT}", GOOD, "free (NatNet by multicast)")


def _lsl() -> Finding:
    import pylsl  # noqa: PLC0415

    return Finding("motion capture", "LSL library", GOOD, f"liblsl {pylsl.library_version() / 100:.2f}")


def _webcam() -> Finding:
    from highfive.hil.view.webcam_files import HOW, net_files, net_folder  # noqa: PLC0415

    try:
        folder = net_folder()
    except HighFiveError:
        return Finding("motion capture", "webcam's nets", MISSING, "not installed; --source webcam needs them", HOW)
    try:
        size = sum(len(file.plain) for file in net_files().values())
    except HighFiveError as error:
        return Finding("motion capture", "webcam's nets", BROKEN, str(error), HOW)
    return Finding("motion capture", "webcam's nets", GOOD, f"{size / 1e6:.0f} MB in {folder}")


def _serial() -> list[Finding]:
    from highfive.hil.drivers.bus.ports import serial_ports  # noqa: PLC0415

    ports = serial_ports()
    if not ports:
        return [Finding("servo arm", "serial adapters", MISSING, "none; --rig emulated needs none")]
    findings = []
    for port in ports:
        kept = "" if port.latency_ms is None else f", latency timer {port.latency_ms} ms"
        found, advice, state = f"{port.description}{kept}", port.advice, GOOD
        if not os.access(port.path, os.R_OK | os.W_OK):
            state, advice = BROKEN, "sudo usermod -aG dialout $USER, then log in again"
        elif holder := _held(port.path):
            state, found = BROKEN, f"{found}; in use by {holder}"
            advice = f"end {holder}, or use another port"
        findings.append(
            Finding("servo arm", port.path, state if not advice or state == BROKEN else MISSING, found, advice)
        )
    return findings


def _held(path: str) -> str:
    """Which other process has a device open, as far as this user may see; '' for none."""
    device = os.path.realpath(path)
    for process in Path("/proc").glob("[0-9]*"):
        if int(process.name) == os.getpid():
            continue
        try:
            if any(os.path.realpath(handle) == device for handle in (process / "fd").iterdir()):
                return f"{(process / 'comm').read_text().strip()} (process {process.name})"
        except OSError:  # another user's, or it has ended
            continue
    return ""
