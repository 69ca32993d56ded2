"""Plug-ins: found by their name, and named in one line when something is wrong with them."""

from pathlib import Path

import pytest
from installed import install

from highfive.model.plugins import PluginError, load_object, load_plugin, plugin_names

GROUP = "highfive.test"


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def test_what_a_package_offers_is_found_by_name(site: Path) -> None:
    install(site, "lab-one", GROUP, {"first": "lab_one_module:VALUE"}, {"lab_one_module": "VALUE = 41\n"})
    assert plugin_names(GROUP) == ["first"]
    assert load_plugin(GROUP, "first") == 41


def test_two_of_one_name_are_both_named(site: Path) -> None:
    install(site, "lab-one", GROUP, {"same": "one:A"})
    install(site, "lab-two", GROUP, {"same": "two:B"})
    with pytest.raises(PluginError) as error:
        load_plugin(GROUP, "same")
    assert "one:A (package lab-one 1.0)" in str(error.value)
    assert "two:B (package lab-two 1.0)" in str(error.value)
    assert "\n" not in str(error.value)


def test_one_that_has_the_name_of_ours_is_refused(site: Path) -> None:
    install(site, "lab-one", GROUP, {"vicon": "one:A"})
    with pytest.raises(PluginError, match=r"lab-one 1\.0.*High Five itself"):
        load_plugin(GROUP, "vicon", "os:sep")


def test_ours_needs_no_package() -> None:
    assert load_plugin(GROUP, "ours", "os.path:sep") == "/"


def test_a_name_that_nobody_offers(site: Path) -> None:
    install(site, "lab-one", GROUP, {"first": "lab:VALUE"})
    with pytest.raises(PluginError, match=r"'second'.*there are: first"):
        load_plugin(GROUP, "second")


@pytest.mark.parametrize(
    ("source", "says"),
    [
        ("raise RuntimeError('no\\nlicence')", "RuntimeError: no licence"),
        ("import nowhere_to_be_found", "ModuleNotFoundError"),
        ("VALUE = (", "SyntaxError"),
        ("OTHER = 1", "AttributeError"),
    ],
)
def test_one_that_cannot_be_loaded_is_named_in_one_line(site: Path, source: str, says: str) -> None:
    module = f"broken_{abs(hash(source))}"
    install(site, "lab-one", GROUP, {"bad": f"{module}:VALUE"}, {module: source + "\n"})
    with pytest.raises(PluginError) as error:
        load_plugin(GROUP, "bad")
    assert says in str(error.value)
    assert "'bad' of package lab-one 1.0" in str(error.value)
    assert "\n" not in str(error.value)


def test_an_object_in_a_file_and_in_a_module(tmp_path: Path) -> None:
    file = tmp_path / "my_value.py"
    file.write_text("class A:\n    B = 3\n")
    assert load_object(f"{file}:A.B", "it") == 3
    assert load_object("os.path:sep", "it") == "/"


@pytest.mark.parametrize("reference", ["", "module", "module:", ":name"])
def test_what_is_no_reference(reference: str) -> None:
    with pytest.raises(PluginError, match="module:attribute"):
        load_object(reference, "it")


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(PluginError, match="FileNotFoundError"):
        load_object(f"{tmp_path / 'none.py'}:fit", "it")
