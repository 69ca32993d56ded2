"""A session for other programs: BVH for animation, GLB (glTF) for Blender and browsers, NPZ for everything else.

    export_motion.py out/session-1

Without one the recording that comes along is exported. One sees the files; drop a ``.glb`` on any glTF viewer, and both
people move. ``csv``, ``c3d``, ``bids`` and ``lerobot`` go the same way (docs/recordings.md). Takes 3 s.
"""

import sys
from pathlib import Path

from highfive.hil.commands.export import ExportOptions, export
from highfive.hil.view import SHIPPED_RECORDING

recording = Path(sys.argv[1]) if sys.argv[1:] else SHIPPED_RECORDING
for kind, trial in (("bvh", 0), ("glb", 0), ("npz", None)):  # the first high five, and all of them
    options = ExportOptions(recording, kind, out=Path("exported"), trial=trial)
    result = export(options, lambda label, total: lambda note="", done=None: None)  # nothing to show how far it is
    for name in result["files"]:
        print(f"{name}: {result['frames']} frames, {Path(name).stat().st_size / 1024:.0f} kB")
