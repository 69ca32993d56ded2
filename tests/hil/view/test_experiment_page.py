"""The pages of an experiment in a browser: what a participant sees and presses, and what is kept from her."""

import time
from collections.abc import Iterator

import pytest

from highfive.hil.experiments.words import PAGE
from highfive.hil.view.browser import Browser
from highfive.hil.view.live_page import LivePage

SET_MS = 20.0
"""How far the page lets its own clock be from the best answer (connection.js), beside half of that answer's trip."""
SHOWN = "new Promise(r => {{const t = setInterval(() => {{if ({}) {{clearInterval(t); r(true)}}}}, 50)}})"
ABOUT = {
    "name": "small", "participant": "P01", "keys": {"neutral": "2", "angry": "1"}, "limit_s": 10.0, "language": "en",
    "sliders": [{"name": "natural", "text": "How natural?", "low": "artificial", "high": "natural", "points": 7}],
    "instructions": "# Two *moods*\n\nRaise your **right** hand.\n\n- once\n- <b>twice</b>",
    "words": dict(PAGE), "shown": {"neutral": "neutral", "angry": "angry"},
}  # fmt: skip
LED = {
    "blocks": [{"name": "I1", "mode": "interactive", "trials": 4, "done": 2}], "trial": "I1-03", "ask": 3,
    "style": "angry", "weights": {"angry": 1.0}, "cell": "B2", "condition": "interactive", "expected": "angry",
    "paused": False, "asks": "", "answer": "", "message": "",
}  # fmt: skip


@pytest.fixture
def page() -> Iterator[LivePage]:
    with LivePage({"mode": "experiment", "title": "small", "emotions": [], "cells": []}, port=0) as opened:
        yield opened


def until(browser: Browser, condition: str) -> None:
    assert browser.evaluate(SHOWN.format(condition))


def asked(page: LivePage, count: int) -> list[tuple[str, object]]:
    found, end = [], time.monotonic() + 20.0
    while len(found) < count and time.monotonic() < end:
        found += [(one.name, one.value) for one in page.commands()]
        time.sleep(0.02)
    return found


def key(browser: Browser, name: str) -> None:
    browser.evaluate(f"dispatchEvent(new KeyboardEvent('keydown', {{key: '{name}', bubbles: true}}))")


def open_as(page: LivePage, browser: Browser, role: str) -> None:
    browser.go(page.address + (f"&role={role}" if role else ""))
    until(browser, "window.highfive?.experiment?.participant && highfive.connection.synchronised")
    page.tell("experiment", **ABOUT)


@pytest.mark.slow
def test_a_participant_reads_answers_and_rates_and_keys_that_are_pressed_count_by_their_time(page: LivePage) -> None:
    with Browser((1000, 700)) as browser:
        open_as(page, browser, "participant")
        page.tell("participant", phase="ready", first=True, practice=False, task="go")
        until(browser, "document.querySelector('.participant.ready .go')")
        text = browser.evaluate("document.querySelector('.participant').innerHTML")
        key(browser, "Enter")
        assert asked(page, 1) == [("ready", None)]
        page.tell("participant", phase="cue", task="go")
        until(browser, "document.querySelector('.participant.cue strong')?.textContent === 'Go'")
        key(browser, "1")  # nothing is asked yet
        page.tell("participant", phase="question", asks="answer", answer="", until_ms=1e9)
        until(browser, "document.querySelectorAll('.answers button').length === 2")
        before = time.monotonic_ns()
        key(browser, "1")
        [(name, value)] = asked(page, 1)
        after = time.monotonic_ns()
        off = 1e6 * (SET_MS + browser.evaluate("highfive.connection.best().trip / 2"))
        page.tell("participant", phase="question", asks="rate", answer="angry", until_ms=1e9)
        until(browser, "document.querySelector('.rating input')")
        browser.evaluate(
            "(() => { const one = document.querySelector('.rating input'); one.value = 6; one.onchange(); })()"
        )
        key(browser, "Enter")
        assert asked(page, 2) == [("rate", {"name": "natural", "value": 6.0}), ("done", None)]
    assert "<h3>Two <em>moods</em></h3>" in text and "<strong>right</strong>" in text and "&lt;b&gt;twice" in text
    assert name == "answer" and isinstance(value, dict) and value["key"] == "1"
    assert before - off <= 1e6 * value["at_ms"] <= after + off


@pytest.mark.slow
def test_a_participant_is_not_told_what_is_shown_and_cannot_lead_the_run(page: LivePage) -> None:
    heard = """(() => {
      const { listeners } = highfive.connection, told = listeners.text;
      window.kinds = [];
      listeners.text = (text) => { window.kinds.push(text.kind); told(text); };
    })()"""
    with Browser((600, 400)) as browser:
        open_as(page, browser, "participant")
        browser.evaluate(heard)
        for kind in ("state", "contact", "contacts", "streams", "experimenter"):
            page.tell(kind, **LED)
        page.tell("participant", phase="wait", task="go")
        until(browser, "window.kinds.includes('participant')")
        told = browser.evaluate("window.kinds.filter((kind) => !['participant', 'experiment'].includes(kind))")
        for command in ("'stop'", "'break_off'", "'pause', true", "'note', 'x'", "'style', {angry: 1}", "'end'"):
            browser.evaluate(f"highfive.connection.command({command})")
        browser.evaluate("highfive.connection.command('ready')")
        came = asked(page, 1)
    assert told == [] and came == [("ready", None)]


@pytest.mark.slow
def test_the_experimenter_sees_plan_and_progress_and_leads(page: LivePage) -> None:
    with Browser((1200, 760)) as browser:
        open_as(page, browser, "")
        page.tell("experimenter", **LED)
        page.tell("participant", phase="question", asks="answer", answer="", until_ms=1e9)
        until(browser, "document.querySelector('.experimenter h2')?.textContent.includes('trial 3 of 4')")
        until(browser, "document.querySelectorAll('.answers button').length === 2")
        text = browser.evaluate("document.querySelector('.experimenter').textContent")
        browser.evaluate("document.querySelectorAll('.experimenter button')[1].click()")
        browser.evaluate("document.querySelector('.experimenter input').value = 'coughed'")
        pressed = "new KeyboardEvent('keydown', {key: 'Enter'})"
        browser.evaluate(f"document.querySelector('.experimenter input').onkeydown({pressed})")
        browser.evaluate("document.querySelector('.answers button').click()")  # said aloud, typed by the experimenter
        came = asked(page, 3)
    assert "I1-03" in text and "angry" in text
    assert [name for name, _ in came] == ["break_off", "note", "answer"]
    assert came[1][1] == "coughed"


@pytest.mark.slow
def test_a_run_that_ends_early_asks_a_participant_nothing_more(page: LivePage) -> None:
    with Browser((1000, 700)) as browser:
        open_as(page, browser, "participant")
        page.tell("participant", phase="question", asks="answer", answer="", until_ms=1e9)
        until(browser, "document.querySelectorAll('.answers button').length === 2")
        page.tell("over", message="It ended early: the source went away.")
        until(browser, "document.querySelector('.participant.over')")
        assert browser.evaluate("document.querySelector('.participant').textContent") == "It ends here for now."
        assert browser.evaluate("document.querySelectorAll('.answers button').length") == 0
        assert browser.evaluate("document.getElementById('notice').textContent").startswith("It ended early")
        assert not browser.console
