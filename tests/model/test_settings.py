"""Settings are values: every class of them is held to the same laws, and what they say reaches the algorithm."""

import importlib
import math
import pkgutil
from dataclasses import FrozenInstanceError, dataclass, fields, replace

import pytest

import highfive
from highfive.model.errors import HighFiveError
from highfive.model.settings import Settings, setting

ROOMS = (
    "model", "mocap_bridge.tracking", "mocap_bridge.body", "calibration", "hil.session", "hil.arm", "hil.trials",
    "hil.experiments.analysis",
)  # fmt: skip


def classes() -> list[type[Settings]]:
    """Every settings class of these rooms."""
    for room in ROOMS:
        package = importlib.import_module(f"{highfive.__name__}.{room}")
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            importlib.import_module(module.name)
    return sorted(Settings.__subclasses__(), key=lambda cls: cls.__name__)


CLASSES = classes()
NUMBERS = [(cls, one) for cls in CLASSES for one in fields(cls) if isinstance(one.default, (int, float))]


def test_all_are_found():
    assert {"FilterSettings", "ReachSettings", "RetargetSettings", "ContactGoalSettings"} <= {
        c.__name__ for c in CLASSES
    }


@pytest.mark.parametrize("cls", CLASSES)
def test_defaults_are_valid_values_and_can_be_recorded(cls: type[Settings]):
    settings = cls()
    assert cls(**settings.values()) == settings
    with pytest.raises(FrozenInstanceError):
        setattr(settings, fields(cls)[0].name, 1.0)


@pytest.mark.parametrize(("cls", "one"), NUMBERS, ids=[f"{cls.__name__}.{one.name}" for cls, one in NUMBERS])
def test_nonsense_is_refused_by_name(cls: type[Settings], one):
    said = rf"{cls.__name__}\.{one.name} is .*, expected "
    for nonsense in (math.nan, math.inf, -math.inf):
        with pytest.raises(HighFiveError, match=said):
            replace(cls(), **{one.name: nonsense})
    assert any(bound is not None for bound in one.metadata["bounds"].values()), f"{one.name} has no bound"
    for words, bound in one.metadata["bounds"].items():
        if bound is not None:
            beyond = bound - 1 if words in ("more than", "at least") else bound + 1
            with pytest.raises(HighFiveError, match=said):
                replace(cls(), **{one.name: beyond})


@dataclass(frozen=True)
class Example(Settings):
    """One field of each kind."""

    length: float = setting(0.5, "m", above=0.0)
    rounds: int = setting(3, least=1)
    on: bool = setting(True)
    rates: tuple[float, ...] = setting((1.0, 2.0), "Hz", above=0.0)


WRONG = {
    r"length is -0\.1 m, expected more than 0$": {"length": -0.1},
    r"length is '1' m, expected a finite number$": {"length": "1"},
    r"length is True m, expected a finite number$": {"length": True},
    r"rounds is 2\.5, expected a whole number$": {"rounds": 2.5},
    r"on is 1, expected true or false$": {"on": 1},
    r"rates is \(1\.0, 'x'\) Hz, expected a tuple of finite numbers$": {"rates": (1.0, "x")},
    r"rates is \(0\.0,\) Hz, expected more than 0$": {"rates": (0.0,)},
    r"rates is 1\.0 Hz, expected a tuple": {"rates": 1.0},
}


@pytest.mark.parametrize(("said", "values"), WRONG.items())
def test_what_is_wrong_is_said_with_unit_and_bound(said: str, values: dict):
    with pytest.raises(HighFiveError, match=rf"Example\.{said}"):
        Example(**values)
    assert Example(length=1, rates=()).values() == {"length": 1, "rounds": 3, "on": True, "rates": ()}
