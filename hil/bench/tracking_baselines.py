"""Two published programs that follow a skeleton through markers: run by an interpreter that has them.

Arguments: a job (.npz, see :func:`main`) and where its result goes (.npz). ``--which`` instead of both prints as JSON
which of them can be imported, with their versions. It imports nothing of High Five, because they may live in an
environment of their own.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SOFT = 1e-5
"""Weight of a coordinate that no marker shows: a radian off costs what 3 mm of one marker do."""


def run_opensim(
    text: str, names: list[str], points: Array, rate_hz: float, start: Array, soft: NDArray[np.bool_], accuracy: float
) -> tuple[Array, Array]:
    """OpenSim's ``InverseKinematicsSolver``: assembled at the first frame, then tracked from frame to frame.

    Args:
        text: an ``.osim`` model whose coordinates are ``q0`` to ``q<n - 1>``.
        names: M markers.
        points: (T, M, 3) m, NaN where missing.
        rate_hz: frames per second.
        start: (n,) coordinates to begin at.
        soft: (n,) coordinates that the markers do not show: held near ``start``, with :data:`SOFT` to a marker's 1.
        accuracy: of the solver.

    Returns:
        Coordinates (T, n) and milliseconds per frame (T,).
    """
    import opensim  # noqa: PLC0415  # pyright: ignore[reportMissingImports]

    opensim.Logger.setLevelString("Error")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "chain.osim"
        path.write_text(text, encoding="utf-8")
        model = opensim.Model(str(path))
    state = model.initSystem()
    coordinates = [model.getCoordinateSet().get(f"q{i}") for i in range(len(start))]
    for coordinate, value in zip(coordinates, start, strict=True):
        coordinate.setValue(state, float(value), False)
    table = opensim.TimeSeriesTableVec3()
    table.setColumnLabels(names)
    for k, frame in enumerate(points):
        row = opensim.RowVectorVec3(len(names))
        for m, point in enumerate(frame):
            row[m] = opensim.Vec3(*map(float, point))
        table.appendRow(k / rate_hz, row)
    weights = opensim.SetMarkerWeights()
    for name in names:
        weights.cloneAndAppend(opensim.MarkerWeight(name, 1.0))
    references = opensim.SimTKArrayCoordinateReference()
    for i in np.flatnonzero(soft):
        reference = opensim.CoordinateReference(f"q{i}", opensim.Constant(float(start[i])))
        reference.setWeight(SOFT)
        references.push_back(reference)
    solver = opensim.InverseKinematicsSolver(model, opensim.MarkersReference(table, weights), references)
    solver.setAccuracy(accuracy)
    found, took = np.empty((len(points), len(start))), np.empty(len(points))
    state.setTime(0.0)
    solver.assemble(state)
    for k in range(len(points)):
        state.setTime(k / rate_hz)
        begun = time.perf_counter_ns()
        solver.track(state)
        took[k] = 1e-6 * (time.perf_counter_ns() - begun)
        found[k] = [coordinate.getValue(state) for coordinate in coordinates]
    return found, took


def run_biorbd(
    text: str, points: Array, rate_hz: float, start: Array, noise: float, error: float
) -> tuple[Array, Array]:
    """biorbd's ``KalmanReconsMarkers``, an extended Kalman filter over coordinates that keep their acceleration.

    Args:
        text: a ``.bioMod`` model.
        points: (T, M, 3) m, NaN where missing.
        rate_hz: frames per second.
        start: (n,) coordinates to begin at.
        noise: its ``noiseFactor``.
        error: its ``errorFactor``.

    Returns:
        Coordinates (T, n) and milliseconds per frame (T,).
    """
    import biorbd  # noqa: PLC0415  # pyright: ignore[reportMissingImports]

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "chain.bioMod"
        path.write_text(text, encoding="utf-8")
        model = biorbd.Model(str(path))
    kalman = biorbd.KalmanReconsMarkers(model, biorbd.KalmanParam(round(rate_hz), noise, error))
    still = np.zeros(len(start))
    kalman.setInitState(start, still, still)
    q, speed, acceleration = (
        kind(model)
        for kind in (biorbd.GeneralizedCoordinates, biorbd.GeneralizedVelocity, biorbd.GeneralizedAcceleration)
    )
    found, took = np.empty((len(points), len(start))), np.empty(len(points))
    for k, frame in enumerate(points):
        flat = frame.reshape(-1)
        begun = time.perf_counter_ns()
        kalman.reconstructFrame(model, flat, q, speed, acceleration)
        took[k] = 1e-6 * (time.perf_counter_ns() - begun)
        found[k] = q.to_array()
    return found, took


def available() -> dict[str, str]:
    """Those that can be imported here, with their versions."""
    found = {}
    for name in ("opensim", "biorbd"):
        try:
            __import__(name)
            found[name] = version(name)
        except (ImportError, PackageNotFoundError):
            continue
    return found


def main() -> None:
    """Works off a job: ``method``, ``model`` (text), ``names``, ``points``, ``rate_hz``, ``start`` and settings."""
    if sys.argv[1:] == ["--which"]:
        print(json.dumps(available()), flush=True)
        return
    with np.load(sys.argv[1], allow_pickle=False) as job:
        text, rate, points, start = str(job["model"]), float(job["rate_hz"]), job["points"], job["start"]
        if str(job["method"]) == "opensim":
            names = [str(name) for name in job["names"]]
            found, took = run_opensim(text, names, points, rate, start, job["soft"], float(job["accuracy"]))
        else:
            found, took = run_biorbd(text, points, rate, start, float(job["noise"]), float(job["error"]))
    np.savez(sys.argv[2], coordinates=found, took_ms=took)


if __name__ == "__main__":
    main()
