"""Executes the notebooks of examples/ and writes them with what came out: the same bits each time on one machine.

    make_notebooks.py [NAME.ipynb …]

Each runs in a kernel of its own, in an empty folder. Nothing of when or where is kept: no times, no paths, no versions.
"""

import io
import os
import sys
from base64 import b64decode, b64encode
from pathlib import Path
from tempfile import TemporaryDirectory

import nbformat
from nbclient import NotebookClient
from PIL import Image

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
LONGEST_S = 600
"""For one cell, on a machine that does much else and has nothing compiled."""
COLOURS = 128
"""Of a picture: enough for a figure, and half its bytes."""
METADATA = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}


def executed(path: Path) -> nbformat.NotebookNode:
    """The notebook with new outputs.

    Raises:
        CellExecutionError: a cell fails.
    """
    notebook = nbformat.read(path, as_version=4)
    programs = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"  # highfive itself, for shell cells
    with TemporaryDirectory(prefix="highfive-notebook-") as folder:
        client = NotebookClient(
            notebook,
            timeout=LONGEST_S,
            kernel_name="python3",
            record_timing=False,
            coalesce_streams=True,  # how the text of a cell came in pieces is chance
            resources={"metadata": {"path": folder}},
            startup_timeout=LONGEST_S,
        )
        client.execute(env={**os.environ, "PATH": programs, "MPLBACKEND": "module://matplotlib_inline.backend_inline"})
    notebook.metadata = nbformat.from_dict(METADATA)
    for cell in notebook.cells:
        cell.metadata = nbformat.from_dict({})
        for output in cell.get("outputs", []):
            if "data" in output:
                output.metadata = nbformat.from_dict({})
                if png := output.data.get("image/png"):
                    output.data["image/png"] = _smaller(png)
    return notebook


def _smaller(png: str) -> str:
    """A picture, base64, with few colours."""
    made = io.BytesIO()
    Image.open(io.BytesIO(b64decode(png))).convert("RGB").quantize(COLOURS).save(made, "png", optimize=True)
    return b64encode(made.getvalue()).decode()


def main() -> None:
    """Those that are named, or all."""
    for path in [Path(name) for name in sys.argv[1:]] or sorted(EXAMPLES.glob("*.ipynb")):
        notebook = executed(path)
        nbformat.write(notebook, path)
        print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
