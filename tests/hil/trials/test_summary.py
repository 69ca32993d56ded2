import json
import math
from dataclasses import replace

import numpy as np
import pytest
from trial_results import some_results

from highfive.hil.sim.contact_check import UnwantedContact
from highfive.hil.trials.key_frames import showpieces
from highfive.hil.trials.summary import SessionSettings, body_part, summarise, without_timings
from highfive.hil.trials.targets import targets
from highfive.hil.trials.trial import style_name

SETTINGS = SessionSettings(seed=3, model="default", trials=5)


@pytest.fixture(scope="module")
def results():
    return some_results()


def strict(value):
    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    return json.loads(json.dumps(value), parse_constant=refuse)


def test_spreads_are_those_of_the_trials(results):
    summary = strict(summarise(results, SETTINGS))
    errors = 1e3 * np.array([r.error for r in results])
    assert summary["contact_error_mm"]["median"] == pytest.approx(np.median(errors), rel=1e-5)
    assert summary["contact_error_mm"]["max"] == pytest.approx(errors.max(), rel=1e-5)
    happy = [1e3 * r.uncorrected_error for r in results if r.emotion == "happy"]
    assert summary["uncorrected_error_mm"]["by_emotion"]["happy"]["median"] == pytest.approx(np.mean(happy), rel=1e-5)
    assert summary["palm_angle_deg"]["max"] == pytest.approx(max(math.degrees(r.palm_angle) for r in results), rel=1e-5)
    ticks = np.concatenate([r.tick_ms for r in results])
    assert summary["tick_ms"]["p99"] == pytest.approx(np.quantile(ticks, 0.99), rel=1e-5)
    assert summary["tick_ms"]["ticks"] == len(ticks)


def test_what_did_not_go_well_is_counted_and_listed(results):
    summary = summarise(results, SETTINGS)
    assert summary["missed_trials"] == [4] and summary["missed"] == 1
    (far,) = summary["out_of_reach_trials"]
    assert far["trial"] == 4 and far["distance_mm"] > 100.0
    assert summary["unwanted_contacts"] == len(summary["unwanted"])
    touched = {entry["trial"] for entry in summary["unwanted"]}
    assert touched == {r.number for r in results if r.contact.unwanted}


def test_fingers_of_one_hand_are_one_finding(results):
    touches = [("right_ring_2", "right_hip", 0.004), ("right_palm", "right_hip", 0.011), ("right_palm", "head", 0.002)]
    unwanted = tuple(UnwantedContact(first, second, 10, depth) for first, second, depth in touches)
    first = replace(results[0], contact=replace(results[0].contact, unwanted=unwanted))
    results = [first, *results[1:]]
    summary = summarise(results, SETTINGS)
    assert len([e for e in summary["unwanted"] if e["trial"] == first.number]) == 2
    pairs = [(e["trial"], e["first"], e["second"]) for e in summary["unwanted"]]
    assert len(set(pairs)) == len(pairs)
    deepest = max(u.deepest for r in results for u in r.contact.unwanted)
    assert max(e["deepest_mm"] for e in summary["unwanted"]) == pytest.approx(1e3 * deepest, rel=1e-5)
    assert body_part("right_ring_2") == body_part("right_palm") == "right hand"
    assert body_part("person_head") == "person's head"
    assert body_part("right_hip") == "right thigh"


def test_timings_are_kept_apart(results):
    slower = [replace(r, tick_ms=r.tick_ms * 2.0) for r in results]
    first, second = summarise(results, SETTINGS), summarise(slower, SETTINGS)
    assert first["tick_ms"] != second["tick_ms"]
    assert json.dumps(without_timings(first)) == json.dumps(without_timings(second))
    elsewhere = replace(SETTINGS, command="highfive simulate --out elsewhere")
    assert json.dumps(without_timings(summarise(results, elsewhere))) == json.dumps(without_timings(first))


def test_unknown_figures_are_null_and_count_for_nothing(results):
    known = results[0]
    unknown = replace(results[1], true_error=math.nan, time_error=math.nan, contact_time=math.nan)
    summary = strict(summarise([known, unknown], SETTINGS))
    assert summary["rows"][1]["true_error_mm"] is None
    assert summary["true_error_mm"]["by_emotion"]["happy"] == {"median": None, "max": None}
    assert summary["true_error_mm"]["max"] == pytest.approx(1e3 * known.true_error, rel=1e-5)


def test_no_trial_at_all_is_a_summary_too():
    summary = strict(summarise([], SETTINGS, interrupted=True))
    assert summary["trials"] == 0 and summary["planned"] == 5 and summary["interrupted"]
    assert all(target.met is None for target in targets(summary))


def test_targets_of_recorded_people_allow_out_of_reach(results):
    far = next(r for r in results if r.out_of_reach)
    simulated = {t.what: t.met for t in targets(summarise([results[0], far], SETTINGS))}
    assert simulated["after correction, to the palm as tracked, largest"] is False
    recorded = [replace(r, simulated=False) for r in (results[0], far)]
    judged = {t.what: t.met for t in targets(summarise(recorded, SETTINGS))}
    assert judged["after correction, to the palm as tracked"] is True


def test_without_correction_only_the_time_is_judged(results):
    listed = targets(summarise(results, replace(SETTINGS, corrected=False)))
    assert {t.what for t in listed if t.met is not None} == {
        "before correction, palm to palm, median",
        "one tick, half of all",
        "one tick, 99 of 100",
    }


def test_a_model_that_did_not_answer_does_not_look_fine(results):
    good, far = ([replace(r, uncorrected_error=e, error=1e-4) for r in results] for e in (0.04, 0.605))
    assert summarise(good, SETTINGS)["warnings"] == []
    summary = summarise(far, SETTINGS)
    (warning,) = summary["warnings"]
    assert "605 mm" in warning and "correction did all of it" in warning
    (before,) = [t for t in targets(summary) if t.what.startswith("before correction")]
    assert before.met is False and "5 of 5" in before.why
    assert not summarise(far, replace(SETTINGS, corrected=False))["warnings"]


def test_a_median_hides_no_trial_that_was_not_answered_and_only_what_met_was_corrected(results):
    errors = (0.04, 0.05, 0.06, 0.301, 0.402)  # the last one did not meet
    mixed = [replace(r, uncorrected_error=e) for r, e in zip(results, errors, strict=True)]
    (warning,) = summarise(mixed, SETTINGS)["warnings"]
    assert "over 100 mm off at the nearest in 2 of 5 trials (median of all 60 mm, largest 402)" in warning
    assert "correction did all of it in the 1 of them in which the palms met" in warning
    (warning,) = summarise(mixed[4:], SETTINGS)["warnings"]
    assert "402 mm off" in warning and "did not meet" in warning and "correction did" not in warning


def test_a_miss_says_which_trials_and_why(results):
    slow = [replace(r, tick_ms=np.full_like(r.tick_ms, 9.0), touch_error=0.003) for r in results]
    slow[2] = replace(slow[2], touch_error=0.04, true_error=0.03)
    listed = targets(summarise(slow, SETTINGS))
    assert all(bool(t.why) == (t.met is not True) for t in listed)
    whys = {t.what: t.why for t in listed}
    worst = whys["played palm from the true palm at first touch, largest"]
    assert "trial 3 (angry, B2) 40.00 mm" in worst and "off, by 30.0 mm" in worst
    assert "machine's timing" in whys["one tick, half of all"]


def test_what_is_not_judged_says_why(results):
    apart = [replace(r, touch_error=math.nan) for r in results]
    for listed, why in (
        (targets(summarise([], SETTINGS)), "no trial"),
        (targets(summarise(results, replace(SETTINGS, corrected=False))), "correction was off"),
        (targets(summarise(apart, SETTINGS)), "measured in no trial"),
    ):
        open_ = [t for t in listed if t.met is None]
        assert open_ and all(t.why.startswith("Not judged: ") for t in open_) and why in open_[0].why


def test_a_single_trial_has_no_spread(results):
    what = [t.what for t in targets(summarise(results[:1], SETTINGS))]
    assert len(set(what)) == len(what)
    assert not [w for w in what if w.endswith(("median", "largest"))]


def test_a_mixed_style_is_labelled_and_the_person_keeps_her_emotion(results):
    mixed = [replace(r, style=style_name({"angry": 0.5, "happy": 0.0, "neutral": 0.5})) for r in results]
    summary = summarise(mixed, SETTINGS)
    assert list(summary["true_error_mm"]["by_emotion"]) == ["angry 0.5 + neutral 0.5"]
    for row, result in zip(summary["rows"], results, strict=True):
        assert (row["style"], row["emotion"]) == ("angry 0.5 + neutral 0.5", result.emotion)
        assert row["person_emotion"] == result.emotion
    recorded = summarise([replace(mixed[0], simulated=False)], SETTINGS)["rows"][0]
    assert recorded["person_emotion"] is None and recorded["style"] == "angry 0.5 + neutral 0.5"
    assert style_name({"angry": 1.0, "sad": 0.0}) == "angry"


def test_the_figures_of_a_long_session_need_no_ticks() -> None:
    results = some_results()
    short = [results[0], *(result.condensed() for result in results[1:])]
    assert [result.whole for result in short] == [True, *[False] * (len(results) - 1)]
    assert summarise(short, SETTINGS) == summarise(results, SETTINGS)
    assert showpieces(short) == [results[0]]
