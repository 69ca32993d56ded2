"""Whose columns are meant: the only person's, the named one's; what is no person is passed over."""

import pytest

from highfive.mocap_bridge.files.recording import EVERYBODY, SeveralPersons, columns_of_person
from highfive.model.errors import HighFiveError

PLATE = ("plate1", "plate2", "stalk")
NAMES = ("plate:plate1", "plate:plate2", "plate:stalk", "Eve:RFIN", "Eve:RELB")


def test_the_plate_of_an_arm_is_no_person() -> None:
    assert columns_of_person(NAMES, None, "lab", PLATE) == [3, 4]
    assert columns_of_person(NAMES, "plate", "lab", PLATE) == [0, 1, 2]  # asked for by its name it is there
    assert columns_of_person(NAMES, EVERYBODY, "lab", PLATE) == [0, 1, 2, 3, 4]
    with pytest.raises(SeveralPersons, match="several persons: plate, Eve;"):
        columns_of_person(NAMES, None, "lab")
    with pytest.raises(HighFiveError, match="has no labels; label the markers of a person"):
        columns_of_person(NAMES[:3], None, "lab", PLATE)


def test_who_is_asked_for_is_not_the_plate() -> None:
    with pytest.raises(SeveralPersons, match="several persons: Eve, Tom;"):
        columns_of_person((*NAMES, "Tom:RFIN"), None, "lab", PLATE)


def test_a_subject_with_one_label_of_its_own_is_a_person() -> None:
    with pytest.raises(SeveralPersons, match="several persons: plate, Eve;"):
        columns_of_person((*NAMES, "plate:thumb"), None, "lab", PLATE)
