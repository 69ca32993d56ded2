"""Which shipped marker set a recording's labels are of, or which of them name joint centres."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set, marker_set_names
from highfive.model.errors import HighFiveError
from highfive.model.geometry.names import listed

_CENTRES = "joint_centres"  # the set whose markers go by any name


def find_marker_set(labels: Sequence[str]) -> MarkerSet:
    """The shipped set that explains most of ``labels`` and has all it needs for the right arm.

    Where none does, the labels may be names of joint centres.

    Raises:
        HighFiveError: no shipped set fits.
    """
    from highfive.mocap_bridge.markers.joint_centres import joint_centre_set  # noqa: PLC0415  (it needs MarkerSet)

    sets = [load_marker_set(name) for name in marker_set_names() if name != _CENTRES]
    usable = [s for s in sets if np.all(s.match(labels)[s.indices(s.arm.markers)] >= 0)]
    if usable:
        # Among sets that explain equally many labels the one with fewer markers left over is the nearer one.
        return max(usable, key=lambda s: (int(np.sum(s.match(labels) >= 0)), -len(s)))
    try:
        return joint_centre_set(load_marker_set(_CENTRES), labels)
    except HighFiveError as error:
        raise HighFiveError(
            f"no marker set fits the labels {listed(labels) or '(none)'}; the sets are {listed(marker_set_names())}; "
            f"{_nearest(sets, labels)}read as joint centres, {error}; rename the labels or give a marker-set file of "
            "your own (docs/markers.md)"
        ) from None


def _nearest(sets: Sequence[MarkerSet], labels: Sequence[str]) -> str:
    """What the set that explains most of the labels wants besides; nothing where none explains any."""
    known = [s.match(labels) >= 0 for s in sets]
    best = max(range(len(sets)), key=lambda i: (int(known[i].sum()), -len(sets[i])))
    if not known[best].any():
        return ""
    missing = [name for name in sets[best].arm.markers if not known[best][sets[best].index(name)]]
    return f"the nearest, {sets[best].name}, wants {listed(missing)} besides; "
