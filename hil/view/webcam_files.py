"""The nets that find landmarks in the page: files of the package ``high-five-webcam``, where it is installed."""

from __future__ import annotations

import hashlib
import importlib.util
import json
from pathlib import Path

from highfive.hil.view.pages import BYTES, TYPES, File
from highfive.model.errors import HighFiveError

PACKAGE = "high_five_webcam"
HOW = "make webcam in a checkout; elsewhere the extra, high-five[webcam] (docs/webcam.md)"
"""How to get it."""


def net_folder() -> Path:
    """Where the nets lie.

    Raises:
        HighFiveError: they are not installed.
    """
    spec = importlib.util.find_spec(PACKAGE)
    if spec is None or spec.origin is None:
        raise HighFiveError(f"the webcam's nets are not installed (they are large): {HOW}")
    return Path(spec.origin).parent


def net_files() -> dict[str, File]:
    """Path → file; each is what the package's list says.

    Raises:
        HighFiveError: the nets are not installed, or not as they were packed.
    """
    folder = net_folder()
    files = dict[str, File]()
    try:
        listed: dict[str, str] = json.loads((folder / "files.json").read_text(encoding="utf-8"))
        for name, digest in listed.items():
            data = (folder / name).read_bytes()
            if hashlib.sha256(data).hexdigest() != digest:
                raise HighFiveError(f"{folder / name} is not the file that was packed; install it again: {HOW}")
            files[f"/nets/{name}"] = File(TYPES.get(Path(name).suffix, BYTES), data, None)
    except (OSError, ValueError, AttributeError) as error:
        raise HighFiveError(
            f"the webcam's nets in {folder} cannot be read ({error}); install them again: {HOW}"
        ) from None
    return files
