"""The bill of materials: valid, the same each time, and with all that comes along."""

import json
import sys
from typing import Any

import pytest
from paths import ROOT

sys.path.insert(0, str(ROOT / "packaging"))
import sbom
from runtime import closure, project

WHEEL, EPOCH = b"a wheel", 1_700_000_000


@pytest.fixture(scope="module")
def packages() -> list[sbom.Package]:
    return closure(list(project()["dependencies"]))  # pyright: ignore[reportArgumentType]


@pytest.fixture(scope="module")
def document(packages: list[sbom.Package]) -> dict[str, Any]:
    return json.loads(sbom.bill(WHEEL, packages, EPOCH))


def test_it_is_the_same_for_the_same_wheel_and_another_for_another(packages: list[sbom.Package]) -> None:
    first, other = sbom.bill(WHEEL, packages, EPOCH), sbom.bill(WHEEL + b".", packages, EPOCH)
    assert sbom.bill(WHEEL, packages, EPOCH) == first
    assert json.loads(first)["serialNumber"] != json.loads(other)["serialNumber"]


def test_everything_is_reached_from_the_wheel(document: dict[str, Any]) -> None:
    needs = {one["ref"]: one["dependsOn"] for one in document["dependencies"]}
    itself = document["metadata"]["component"]
    reached, waiting = set(), [itself["bom-ref"]]
    while waiting:
        if (one := waiting.pop()) not in reached:
            reached.add(one)
            waiting += needs[one]
    assert reached == {itself["bom-ref"], *(one["bom-ref"] for one in document["components"])}
    assert [one["name"] for one in itself["components"]] == ["three.js"]
    assert all(one["licenses"][0]["expression"] for one in document["components"])


def test_versions_are_the_pinned_ones(packages: list[sbom.Package]) -> None:
    assert sbom.not_pinned([sbom.Package("numpy", "1.0", "", ()), sbom.Package("unheard", "1", "", ())]) == [
        "numpy 1.0",
        "unheard 1",
    ]
    assert not [one for one in packages if not one.version]


def test_the_schema_holds(document: dict[str, Any]) -> None:
    """By CycloneDX's own validator, which ``.ci/run`` installs."""
    validation = pytest.importorskip("cyclonedx.validation.json", reason="cyclonedx-python-lib[json-validation]")
    schema = pytest.importorskip("cyclonedx.schema")
    try:
        validator = validation.JsonStrictValidator(schema.SchemaVersion.V1_6)
        wrong = validator.validate_str(json.dumps(document))
    except Exception as error:
        if type(error).__name__ == "MissingOptionalDependencyException":
            pytest.skip(str(error))
        raise
    assert wrong is None, wrong
    assert validator.validate_str(json.dumps(document | {"specVersion": 7})) is not None
