"""Every code name of the glossary exists."""

import importlib
import re

import pytest
from paths import ROOT

NAMES = re.findall(
    r"`((?:model|mocap_bridge|calibration|hil)\.[\w.]+)`", (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
)


def found(name: str) -> bool:
    """Whether it is a module's name, or a field or a method of a class in one."""
    parts = name.split(".")
    for length in range(len(parts) - 1, 0, -1):
        try:
            here = importlib.import_module(".".join(["highfive", *parts[:length]]))
        except ModuleNotFoundError:
            continue
        for part in parts[length:]:
            if not hasattr(here, part) and part not in getattr(here, "__annotations__", {}):
                return False
            here = getattr(here, part, None)
        return True
    return False


@pytest.mark.parametrize("name", NAMES)
def test_it_exists(name: str) -> None:
    assert found(name)


def test_every_row_has_one_and_what_does_not_exist_is_not_found() -> None:
    text = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if line.startswith("|") and not line.startswith(("|---", "| paper"))]
    assert len(rows) > 40 and all(any(f"`{name}`" in row.split("|")[3] for name in NAMES) for row in rows)
    assert not found("model.gp.kernels.rbf.RBF.length") and not found("model.nothing.at_all")
