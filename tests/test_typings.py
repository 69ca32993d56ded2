"""The stubs in ``typings/`` name what is there."""

import ast
import importlib
from pathlib import Path

import pytest

TYPINGS = Path(__file__).resolve().parents[1] / "typings"
STUBS = sorted(path.relative_to(TYPINGS) for path in TYPINGS.rglob("*.pyi"))


@pytest.mark.parametrize("stub", STUBS, ids=str)
def test_what_a_stub_names_is_there(stub: Path) -> None:
    parts = [part for part in stub.with_suffix("").parts if part != "__init__"]
    module = importlib.import_module(".".join(parts))
    for node in ast.parse((TYPINGS / stub).read_text(encoding="utf-8")).body:
        match node:
            case ast.FunctionDef(name=name) | ast.AnnAssign(target=ast.Name(id=name)) if not name.startswith("_"):
                assert hasattr(module, name), name
            case ast.ClassDef(name=name, body=body) if not name.startswith("_"):
                _check_class(getattr(module, name), body)
            case ast.ImportFrom(names=names):
                assert all(alias.asname is None or hasattr(module, alias.asname) for alias in names)
            case _:
                pass


def _check_class(found: type, body: list[ast.stmt]) -> None:
    for entry in body:
        match entry:
            case ast.FunctionDef(name=name):
                assert hasattr(found, name), name
            case ast.AnnAssign(target=ast.Name(id=name)) if found.__module__.startswith("mujoco._"):
                assert hasattr(found, name), name  # others set theirs when they are made
            case ast.Assign(targets=[ast.Name(id=name)], value=ast.Constant(value=number)):
                assert int(getattr(found, name)) == number, name
            case _:
                pass
