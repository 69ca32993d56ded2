"""The bill of materials of a wheel: CycloneDX 1.6 as JSON, the same bytes for the same wheel and environment.

``python packaging/sbom.py WHEEL OUT.cdx.json``; in an environment with the versions of ``constraints.txt``. ``make
dist`` calls it.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import tomllib
import uuid
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from packaging.utils import canonicalize_name
from runtime import ROOT, Package, closure, project

SPECIFICATION = "1.6"


def main() -> None:
    """The command line."""
    wheel, out = map(Path, sys.argv[1:])
    epoch = int(os.environ.get("SOURCE_DATE_EPOCH", "0"))
    packages = closure(list(project()["dependencies"]))
    if other := not_pinned(packages):
        sys.exit(f"not the versions of constraints.txt: {', '.join(other)}")
    out.write_text(bill(wheel.read_bytes(), packages, epoch), encoding="utf-8")


def not_pinned(packages: list[Package]) -> list[str]:
    """Those that are not installed as ``constraints.txt`` says."""
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").split()
    pinned = {canonicalize_name(name): version for name, _, version in (line.partition("==") for line in lines)}
    return [f"{one.name} {one.version}" for one in packages if pinned.get(canonicalize_name(one.name)) != one.version]


def bill(wheel: bytes, packages: list[Package], epoch: int) -> str:
    """The document.

    Args:
        wheel: its bytes.
        packages: all that it brings along.
        epoch: when, s since 1970.
    """
    about, digest = project(), hashlib.sha256(wheel).hexdigest()
    name, version = str(about["name"]), str(about["version"])
    itself = f"pkg:pypi/{name}@{version}"
    needs: Any = about["dependencies"]
    direct = {canonicalize_name(one.split(">")[0]) for one in needs}
    content = tomllib.loads((ROOT / "packaging" / "third_party.toml").read_text(encoding="utf-8"))["bundled"]
    inside = [
        component(one["name"], one["version"], one["licence"], one["purl"]) for one in content if one["package"] == name
    ]
    document = {
        "$schema": f"http://cyclonedx.org/schema/bom-{SPECIFICATION}.schema.json",
        "bomFormat": "CycloneDX",
        "specVersion": SPECIFICATION,
        "serialNumber": f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_URL, f'{itself}#{digest}')}",
        "version": 1,
        "metadata": {
            "timestamp": datetime.fromtimestamp(epoch, UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
            "component": component(name, version, str(about["license"]), itself)
            | {"hashes": [{"alg": "SHA-256", "content": digest}], "components": inside},
        },
        "components": [component(one.name, one.version, one.licence, purl(one)) for one in packages],
        "dependencies": [
            {"ref": itself, "dependsOn": [purl(one) for one in packages if canonicalize_name(one.name) in direct]},
            *({"ref": purl(one), "dependsOn": requires(one, packages)} for one in packages),
        ],
    }
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def component(name: str, version: str, licence: str, url: str) -> dict[str, Any]:
    """A library; its package URL is its reference."""
    return {
        "type": "library",
        "bom-ref": url,
        "name": name,
        "version": version,
        "licenses": [{"expression": licence}],
        "purl": url,
    }


def purl(one: Package) -> str:
    """Its package URL."""
    return f"pkg:pypi/{canonicalize_name(one.name)}@{one.version}"


def requires(one: Package, packages: list[Package]) -> list[str]:
    """What it needs of them."""
    return [purl(other) for other in packages if canonicalize_name(other.name) in one.requires]


if __name__ == "__main__":
    main()
