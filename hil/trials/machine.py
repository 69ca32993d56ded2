"""What the last bits of a pose depend on besides model and versions: the processor, the libraries, who compiled."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from llvmlite import binding

from highfive.model.compiled import compiled_here

_CPUINFO = Path("/proc/cpuinfo")


def machine() -> dict[str, Any]:
    """``processor`` by name, ``target`` that machine code is made for, ``numba``, ``llvmlite`` and ``blas`` with their
    versions, and ``compiled``: functions that this process compiled itself, where others load what one has stored.
    """
    blas = np.show_config(mode="dicts").get("Build Dependencies", {}).get("blas", {})
    return {
        "processor": _processor(),
        "target": str(binding.get_host_cpu_name()),
        "numba": version("numba"),
        "llvmlite": version("llvmlite"),
        "blas": f"{blas.get('name', 'unknown')} {blas.get('version', '')}".strip(),
        "compiled": compiled_here(),
    }


def machine_differences(then: object, now: Mapping[str, Any]) -> list[str]:
    """What differs, in words; none where nothing is known of ``then``, as in recordings of before."""
    if not isinstance(then, dict):
        return []
    found = [
        f"{name} {then.get(name)} then, {now[name]} now"
        for name in ("processor", "target", "numba", "llvmlite", "blas")
        if then.get(name) != now[name]
    ]
    if then.get("compiled") != now["compiled"]:
        found.append(f"machine code {_said(then.get('compiled'))} then, {_said(now['compiled'])} now")
    return found


def _said(compiled: object) -> str:
    if isinstance(compiled, list) and compiled:
        return f"compiled in the session's process ({len(compiled)} functions)"
    return "from its cache"


def _processor() -> str:
    if _CPUINFO.is_file():
        for line in _CPUINFO.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
