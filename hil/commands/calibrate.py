"""``highfive calibrate subject``: a person's segment lengths and marker places, as a marker set of her own."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from highfive.calibration.personal_set import personal_set
from highfive.calibration.subject import Subject
from highfive.hil.datasets.fitted_subject import fitted_subject
from highfive.hil.runtime.console import STDOUT, Bar, counted
from highfive.hil.runtime.folders import check_toml
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.markers.marker_set_file import write_marker_set
from highfive.mocap_bridge.markers.one_person import OnePerson, read_person

MM = 1e3

FEW = 20
"""Frames from which on a recording is not said to have few."""

UNSURE = 0.04
"""A segment whose length is less sure than this, relative to it, is reported; from person to person it is 0.1."""


@dataclass(frozen=True)
class CalibrateOptions:
    """Whom to calibrate.

    Attributes:
        file: a C3D file.
        person: prefix of the person's markers; None for the only one.
        marker_set: name or file of the marker set; None finds one.
        out: the file of the person's own set.
        overwrite: replace that file if it is there.
    """

    file: Path
    person: str | None = None
    marker_set: str | None = None
    out: Path = Path("subject.toml")
    overwrite: bool = False


def calibrate_subject(options: CalibrateOptions, bar: Bar) -> dict[str, Any]:
    """Fits a person's body to a recording and writes her marker set.

    Returns:
        The summary: segment lengths and marker places in m, residuals in mm, and the file.

    Raises:
        HighFiveError: the file is not usable, the labels do not fit, or the set cannot be written.
    """
    check_toml(options.out, "a marker set", options.overwrite)
    person = read_person(options.file, options.person, options.marker_set)
    base = person.marker_set
    subject = fitted_subject(person, bar)
    own = personal_set(subject, f"{base.name}, {_name(person)}", f"{base.description}, fitted to {_name(person)}")
    residuals = {name: round(MM * float(r), 2) for name, r in zip(own.names, subject.rms, strict=True) if r > 0.0}
    entries = {
        "person": person.prefix,
        "source": options.file.name,
        "date": date.today().isoformat(),
        "fitted_from": base.name,
        "residual_mm": _rms(residuals),
        "residuals_mm": residuals,
    }
    write_marker_set(options.out, own, entries, replace=options.overwrite)
    return _summary(options, person, subject, own, residuals)


def _name(person: OnePerson) -> str:
    return person.prefix or person.path.stem


def _rms(residuals: dict[str, float]) -> float:
    return round(float(np.sqrt(np.mean(np.square(list(residuals.values()))))), 2) if residuals else 0.0


def _summary(
    options: CalibrateOptions, person: OnePerson, subject: Subject, own: MarkerSet, residuals: dict[str, float]
) -> dict[str, Any]:
    base = person.marker_set
    moved = np.linalg.norm(subject.marker_set.local_positions - base.local_positions, axis=1)
    return {
        "file": str(options.file),
        "person": person.prefix,
        "marker_set": base.name,
        "frames": len(person.recording),
        "frames_fitted": subject.frames,
        "out": str(options.out),
        "residual_mm": _rms(residuals),
        "scales": {name: round(scale, 4) for name, scale in subject.scales.items()},
        "segments": {
            joint: {
                "length_m": segment.length,
                "sigma_m": round(subject.length_sigmas[joint], 5),
                "reference_m": base.segments[joint].length,
            }
            for joint, segment in own.segments.items()
        },
        "markers": {
            name: {
                "joint": own.joints[m],
                "position_m": own.local_positions[m].tolist(),
                "moved_mm": round(MM * float(moved[m]), 1),
                "residual_mm": residuals.get(name),
            }
            for m, name in enumerate(own.names)
        },
        "missing": list(person.missing),
    }


def print_subject(summary: dict[str, Any]) -> None:
    """The summary for people."""
    whose = f", {summary['person']}" if summary["person"] else ""
    print(f"{Path(summary['file']).name}{whose}: marker set {summary['marker_set']}")
    segments = Table("segment", "length, mm", "±, mm", "of the reference, %", box=SIMPLE_HEAD)
    for joint, of in summary["segments"].items():
        share = 100.0 * of["length_m"] / of["reference_m"]
        segments.add_row(joint, f"{MM * of['length_m']:.0f}", f"{MM * of['sigma_m']:.0f}", f"{share:.0f}")
    STDOUT.print(segments)
    markers = Table("marker", "on", "place x, y, z, mm", "moved, mm", "residual, mm", box=SIMPLE_HEAD)
    for name, of in summary["markers"].items():
        place = ", ".join(f"{round(MM * x)}" for x in of["position_m"])
        residual = "never seen" if of["residual_mm"] is None else f"{of['residual_mm']:.1f}"
        markers.add_row(name, of["joint"], place, f"{of['moved_mm']:.0f}", residual)
    STDOUT.print(markers)
    if summary["frames_fitted"] < FEW:
        print(f"Only {counted(summary['frames_fitted'], 'frame')}: a recording of movement tells more.")
    unsure = [name for name, of in summary["segments"].items() if of["sigma_m"] > UNSURE * of["length_m"]]
    if unsure:
        print(f"Hardly shown, and left near the proportions of the reference body: {', '.join(unsure)}.")
    print(f"Residuals {summary['residual_mm']:.1f} mm (root mean square). The person's own set: {summary['out']}")
