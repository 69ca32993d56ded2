"""Pages of the examples: the list with the scripts below it, and each notebook with what came out of it.

mkdocs-jupyter would fetch MathJax from elsewhere, and brings nbconvert and 30 packages for what is a page of this.
"""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

EXAMPLES = Path(__file__).parents[2] / "examples"


def on_files(files: Files, config: Any) -> Files:
    """Adds the pages, and the notebooks' pictures."""
    scripts = sorted(EXAMPLES.glob("*.py"))
    content = _in_docs((EXAMPLES / "README.md").read_text(encoding="utf-8"))
    for path in scripts:
        content = content.replace(f"]({path.name})", f"](#{path.name.replace('.', '')})")
    for path in EXAMPLES.glob("*.ipynb"):
        content = content.replace(f"]({path.name})", f"]({path.stem}.md)")
    sources = [f"## {path.name}\n\n```python\n{path.read_text(encoding='utf-8')}```\n" for path in scripts]
    files.append(File.generated(config, "examples/index.md", content="\n".join([content, *sources])))
    for path in sorted(EXAMPLES.glob("*.ipynb")):
        for name, made in notebook_page(path).items():
            files.append(File.generated(config, f"examples/{name}", content=made))
    return files


def notebook_page(path: Path) -> dict[str, str | bytes]:
    """A notebook as a page, and its pictures, by their names."""
    parts = [f"*A notebook: `examples/{path.name}`.*"]
    made: dict[str, str | bytes] = {}
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(_in_docs(source))
            continue
        language, source = ("sh", source.split("\n", 1)[1]) if source.startswith("%%bash") else ("python", source)
        parts.append(f"```{language}\n{source}\n```")
        for output in cell["outputs"]:
            data = output.get("data", {})
            if "image/png" in data:
                name = f"{path.stem}_{len(made) + 1}.png"
                made[name] = base64.b64decode("".join(data["image/png"]))
                parts.append(f"![Figure {len(made)}]({name})")
            elif text := "".join(output.get("text", data.get("text/plain", ""))):
                parts.append(f"```text\n{text.rstrip()}\n```")
    parts.insert(1, parts.pop(0))  # below the title
    return {f"{path.stem}.md": "\n\n".join(parts) + "\n", **made}


def _in_docs(markdown: str) -> str:
    """Links as they are from a folder of the documentation."""
    return markdown.replace("](../docs/", "](../")
