import json
import math
from dataclasses import replace

import numpy as np
import pytest
from trial_results import some_results

from hil.sim.contact_check import UnwantedContact
from hil.summary import SessionSettings, body_part, summarise, targets, without_timings

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
    assert simulated["palm to palm at contact, largest"] is False
    recorded = [replace(r, simulated=False) for r in (results[0], far)]
    judged = {t.what: t.met for t in targets(summarise(recorded, SETTINGS))}
    assert judged["palm to palm at contact, largest"] is True


def test_without_correction_only_the_time_is_judged(results):
    listed = targets(summarise(results, replace(SETTINGS, corrected=False)))
    assert {t.what for t in listed if t.met is not None} == {"one tick, half of all", "one tick, 99 of 100"}
