import json
import re
import resource
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from trial_results import some_results

from highfive.hil.report.colours import colour_of, mark_of
from highfive.hil.report.film import Strip
from highfive.hil.report.report import render_page, write_report
from highfive.hil.report.report_tables import style_table
from highfive.hil.report.session_figures import figure_names
from highfive.hil.runtime.folders import write_file
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.rendering import NoPictures
from highfive.hil.trials.summary import SessionSettings, summarise
from highfive.hil.trials.trial import style_name
from highfive.model.errors import HighFiveError

SETTINGS = SessionSettings(seed=3, model="default", trials=5, command="highfive simulate --seed 3 && echo <b>")
VOID = {"meta", "img", "br", "link", "path", "use", "rect", "circle", "line"}


class Page(HTMLParser):
    """Checks that tags close in order and collects what a browser would fetch, and the text."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.fetched, self.text = [], [], [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.fetched += [v for n, v in attrs if n in ("src", "href", "xlink:href", "srcset", "data", "action") and v]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)
        self.fetched += [v for n, v in attrs if n in ("src", "href", "xlink:href") and v]

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def written(folder, results, settings=SETTINGS, pictures=(), **options):
    summary = summarise(results, settings, **options)
    path = write_report(folder, summary, results, settings, pictures)
    assert json.loads((folder / "report.json").read_text()) == json.loads(json.dumps(summary))
    return path


@pytest.fixture(scope="module")
def results():
    return some_results()


@pytest.fixture(scope="module")
def strips(results):
    grey = np.full((40, 48, 3), 128, np.uint8)
    return [Strip(result, (("start", grey), ("palms meet", grey))) for result in results[:4]]


@pytest.fixture(scope="module")
def page(results, strips, tmp_path_factory):
    return written(tmp_path_factory.mktemp("report"), results, pictures=strips)


def test_page_needs_nothing_but_itself(page):
    text = page.read_text()
    parsed = Page(text)
    assert not {"script", "iframe", "link", "object"} & set(parsed.tags)
    assert all(address.startswith(("data:image/", "#")) for address in parsed.fetched)
    assert not re.search(r"https?://|@import|url\((?!#)", text)
    assert page.stat().st_size < 6e6


def test_page_says_what_was_measured_and_that_it_is_simulated(page, results):
    text = " ".join(Page(page.read_text()).text)
    assert "The people in this report are simulated" in text
    for result in results:
        assert f"{1e3 * result.uncorrected_error:.{2 if result.uncorrected_error < 0.1 else 1}f}" in text
    assert "out of reach" in text and "No contact: trial 5" in text
    assert "highfive simulate --seed 3 && echo <b>" in text


def test_references_inside_pictures_lead_somewhere(page):
    text = page.read_text()
    targets = set(re.findall(r'id="([^"]+)"', text))
    used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', text))
    assert used and used <= targets


def test_figures_are_saved_as_pictures(page):
    names = {path.name for path in (page.parent / "figures").iterdir()}
    assert {"contact_error.png", "joint_angles.png", "palm_paths.png", "latency.png"} <= names
    assert not list(page.parent.rglob("*.partial"))


@pytest.mark.slow
@pytest.mark.parametrize(
    "chosen", [slice(1), pytest.param(slice(4, 5), marks=pytest.mark.slow), slice(0)], ids=["one", "no contact", "none"]
)
def test_any_number_of_trials_has_a_page(chosen, results, tmp_path):
    path = written(tmp_path, results[chosen], interrupted=True)
    text = " ".join(Page(path.read_text()).text)
    count = len(results[chosen])
    assert f"interrupted after {count} of 5 trials" in text
    assert "Pictures left out" in text


def test_a_single_trial_shows_each_figure_once(results, tmp_path):
    text = " ".join(Page(written(tmp_path, results[:1]).read_text()).text)
    assert "median" not in text
    assert "largest" not in text.replace("largest change", "").replace("the largest in", "")
    assert not (tmp_path / "figures" / "error_by_cell.png").exists()


@pytest.mark.slow
def test_a_mixed_style_has_a_column_for_the_person(results, page, tmp_path):
    mixed = [replace(r, style="angry 0.5 + neutral 0.5") for r in results]
    text = Page(written(tmp_path, mixed, replace(SETTINGS, style={"angry": 0.5, "neutral": 0.5})).read_text()).text
    assert "person" in text and "angry 0.5 + neutral 0.5" in text and "sad" in text
    assert "person" not in Page(page.read_text()).text


@pytest.mark.parametrize("style", [None, {"angry": 0.5, "happy": 0.5}])
def test_the_same_bits_are_promised_only_where_nobody_changed_the_style(style, results):
    settings = replace(SETTINGS, style=style)
    kept = [replace(r, style=style_name(style) if style else r.emotion) for r in results]
    for shown, changed in ((kept, False), ([replace(kept[0], style="sad 0.3 + happy 0.7"), *kept[1:]], True)):
        text = render_page(summarise(shown, settings), settings, [])
        assert ("The style was changed on the page" in text) == changed == ("bit for bit" not in text)
    recorded = [replace(r, simulated=False) for r in kept]  # of whose own emotion nothing is known
    assert "bit for bit" in render_page(summarise(recorded, settings), settings, [])


def test_the_table_of_styles_fits_a_page(results):
    summary = summarise(results, SETTINGS)
    page = style_table(summary)
    text = " ".join(" ".join(Page(page).text).split())
    assert len(re.findall("<th[ >]", page)) <= 8
    happy = summary["contact_error_mm"]["by_emotion"]["happy"]  # two trials; of the others there is one each
    assert f"{happy['median']:.2f} ({happy['max']:.1f})" in text and "median (largest)" in text
    assert text.count("(") < 2 * text.count("median (largest)") + 1


def test_an_arm_is_named_on_the_first_screen(results):
    settings = replace(SETTINGS, arm="emulated")
    page = render_page(summarise(results, settings), settings, [])
    assert page.index("emulated servo arm") < page.index("Findings")


def test_what_the_correction_did_is_claimed_for_trials_that_met(results):
    far = [replace(r, uncorrected_error=0.3) for r in results]
    for chosen, badge in (
        (far[:2], ">the correction did all of it<"),
        ([results[0], *far[1:]], ">the correction did all of it in 3 of 5<"),
        (far[4:], ">palms far apart<"),
    ):
        assert badge in render_page(summarise(chosen, SETTINGS), SETTINGS, [])


@pytest.mark.slow
def test_nothing_of_an_earlier_session_stays_beside_a_new_report(results, page, tmp_path):
    drawn = {path.stem for path in (page.parent / "figures").iterdir()}
    assert "contact_error" in drawn and drawn <= set(figure_names())
    (tmp_path / "figures").mkdir()
    for name in ("highfive.mp4", "figures/arm_bus.png", "figures/error_by_cell.png", "mine.mp4", "figures/mine.png"):
        (tmp_path / name).write_bytes(b"old")
    written(tmp_path, results[:1], pictures=NoPictures("pictures left out: --no-pictures"))
    left = {str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*") if p.is_file() and p.read_bytes() == b"old"}
    assert left == {"mine.mp4", "figures/mine.png"}
    (tmp_path / "highfive.mp4").write_bytes(b"new")
    summary = summarise(results[:1], SETTINGS)
    write_report(tmp_path, summary, results[:1], SETTINGS, film=tmp_path / "highfive.mp4")
    assert (tmp_path / "highfive.mp4").is_file()


def test_missing_pictures_are_explained(results):
    reason = NoPictures("pictures left out: MUJOCO_GL=off switches OpenGL off")
    text = render_page(summarise(results, SETTINGS), SETTINGS, [], reason)
    assert "Pictures left out: MUJOCO_GL=off switches OpenGL off." in text
    assert render_page(summarise(results, SETTINGS), SETTINGS, [], reason, reason) == text


def test_the_film_is_beside_the_page(results):
    text = render_page(summarise(results, SETTINGS), SETTINGS, [], film=Path("/somewhere/high five.mp4"))
    assert Page(text).fetched == ["high five.mp4"]


@pytest.mark.slow
def test_recorded_people_are_compared_with_who_met_them(results, tmp_path):
    facts = {"title": "pair <1>.c3d, A", "cell": "", "emotion": "", "notes": ("floor at z = 3 mm", "turned by 90°")}
    unknown = {name: np.nan for name in ("true_error", "touch_error", "touch_speed")}
    recorded = replace(results[0], simulated=False, other_error=0.0123, **unknown, **facts)
    path = written(tmp_path, [recorded], replace(SETTINGS, source="pair <1>.c3d"))
    text = " ".join(Page(path.read_text()).text)
    assert "simulated" not in text
    assert "pair <1>.c3d" in text and "turned by 90°" in text
    assert "within 12.30 mm of each other" in text and "do not compare" in text
    several = [replace(recorded, number=number, error=error) for number, error in enumerate((0.002, 0.00224, 0.00745))]
    text = Page(written(tmp_path / "several", several, replace(SETTINGS, source="pair.c3d")).read_text()).text
    assert "to that same estimate, to 2.24 mm (median; largest 7.45): the two figures" in " ".join(text)


def test_a_full_disk_keeps_the_old_report(page, tmp_path):
    path = tmp_path / "report.html"
    write_file(path, b"old")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        with pytest.raises(HighFiveError, match="cannot write") as error:
            write_file(path, page.read_bytes())
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert "\n" not in str(error.value)
    assert path.read_bytes() == b"old" and list(tmp_path.iterdir()) == [path]


def test_a_folder_that_cannot_be_made_is_one_line(results, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(HighFiveError, match="cannot write") as error:
        write_report(tmp_path / "file", summarise([], SETTINGS), [], SETTINGS)
    assert "\n" not in str(error.value)


def test_emotions_look_different_in_colour_and_in_shape():
    assert len({colour_of(e) for e in EMOTIONS}) == len({mark_of(e) for e in EMOTIONS}) == len(EMOTIONS)
    assert colour_of("afraid") == colour_of("afraid")
