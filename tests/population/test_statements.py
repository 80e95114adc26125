"""What published statements say of a class is held against what a study found."""

from dataclasses import replace

import pytest
from lots_found import counted, lot_result

from imubayes.inference import Share
from imubayes.population import statements
from imubayes.population.needs import InLot
from imubayes.population.statements import BEYOND, CONFIRMED, CONTRADICTED, judged
from imubayes.sensors.catalogue import classes
from imubayes.sensors.catalogue_file import KINDS, packaged_tables
from imubayes.sensors.terms import library
from imubayes.units import factor

FOG, MEMS = "fog_navigation", "mems_consumer"


def test_statements_of_the_catalogue_are_about_its_classes_and_terms() -> None:
    for kind in KINDS:
        names = library(kind, set="extended", temperature=2, gradient_of=("b0",)).names
        known = {entry.id for entry in classes(kind)}
        own = [one for one in packaged_tables()["statement"] if one["kind"] == kind]
        assert len(own) >= (10 if kind == "gyroscope" else 5)
        for one in own:
            assert set(one["classes"]) <= known and set(one["terms"]) <= set(names)
            assert one["claims"] in ("needed", "small", "size", "open") and one["source"] and one["text"]
            assert bool(one.get("why")) == (not one["terms"]) == (one["claims"] == "open")
            assert ("range" in one) == (one["claims"] == "size") and len(one["terms"]) < 2 + 9 * (
                one["claims"] != "size"
            )
            if "range" in one:
                low, high, unit = one["range"]
                assert low <= high and factor(unit, like=unit) > 0.0


def told(monkeypatch, table, change=lambda one: one):
    """What the made-up study says of one statement, after its classes were changed."""
    whole = {"kind": "gyroscope", "text": "so it is", "source": "a book", **table}
    monkeypatch.setattr(statements, "packaged_tables", lambda: {"statement": [whole]})
    found = judged("gyroscope", [change(one) for one in lot_result().classes])
    return found[0] if found else None


@pytest.mark.parametrize(
    ("needed", "hidden", "verdict"), [(100, 0, CONFIRMED), (0, 0, CONTRADICTED), (0, 100, BEYOND)]
)
def test_term_that_is_said_to_be_needed(monkeypatch, needed, hidden, verdict) -> None:
    table = {"classes": [MEMS], "terms": ["g_i", "g_j"], "claims": "needed"}
    assert told(monkeypatch, table, lambda one: counted(one, needed, hidden)).verdict == verdict


@pytest.mark.parametrize(
    ("share", "most", "hidden", "verdict"),
    [
        (0.01, 0.05, 0, CONFIRMED),
        (0.2, 0.5, 0, CONTRADICTED),
        (0.2, 0.5, 100, BEYOND),
        (0.01, 0.5, 0, BEYOND),
    ],
)
def test_effect_that_is_said_to_be_none(monkeypatch, share, most, hidden, verdict) -> None:
    def change(one):
        shown = counted(one, 100 - hidden, hidden)
        scene = shown.missions[1]
        terms = tuple(replace(t, share=Share(share, share, share), most_of_budget=most) for t in scene.terms)
        quiet = tuple(replace(t, share=Share(0.0, 0.0, 0.0), most_of_budget=0.0) for t in scene.terms)
        missions = (replace(scene, terms=quiet), replace(scene, terms=terms))
        return replace(shown, missions=missions)

    found = told(monkeypatch, {"classes": [FOG], "terms": ["g_i"], "claims": "small"}, change)
    assert (found.verdict, found.sizes) == (verdict, {FOG: (share, most)})


@pytest.mark.parametrize(
    ("stated", "verdict"), [([0.1, 2.0], CONFIRMED), ([20.0, 30.0], CONTRADICTED), ([0.0, 1.0], CONTRADICTED)]
)
def test_size_that_is_said_is_one_that_units_can_have(monkeypatch, stated, verdict) -> None:
    dph = factor("deg/h/g", like="deg/h/g")
    lot = InLot(100, 0, Share(0.0, -3.0 * dph, dph), Share(2.0 * dph, 1.5 * dph, 4.0 * dph))

    def change(one):
        return replace(one, terms=tuple(replace(term, lots=(lot,)) for term in one.terms))

    table = {"classes": [MEMS], "terms": ["g_i"], "claims": "size", "range": [*stated, "deg/h/g"]}
    found = told(monkeypatch, table, change)
    assert found.verdict == verdict
    assert found.sizes[MEMS] == pytest.approx((1.5, 5.0))


def test_one_class_that_contradicts_is_enough_and_others_are_left_out(monkeypatch) -> None:
    table = {"classes": [MEMS, FOG, "rlg_navigation"], "terms": ["g_i"], "claims": "needed"}
    found = told(monkeypatch, table)
    assert found.classes == {MEMS: CONFIRMED, FOG: CONTRADICTED} and found.verdict == CONTRADICTED
    assert told(monkeypatch, {**table, "classes": ["rlg_navigation"]}) is None
    absent = told(monkeypatch, {**table, "terms": ["b0*dT"]})
    assert absent.verdict == BEYOND and absent.why == "no such term is in the study"
