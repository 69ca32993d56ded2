"""The shipped model and the scene, for the tests of this folder."""

import pytest

from highfive.hil.sim.scene import Scene, build_scene
from highfive.model import DEFAULT_MODEL
from highfive.model.hgpdm.store import load_model
from highfive.model.hgpdm.trained import HGPDM


@pytest.fixture(scope="session")
def model() -> HGPDM:
    return load_model(DEFAULT_MODEL)


@pytest.fixture(scope="session")
def scene() -> Scene:
    return build_scene()
