"""Is this unit typical of its class?"""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from lots_found import lot_library, lot_result
from published_found import FILE, a_term

from imubayes.errors import InputError
from imubayes.inference.intervals import Share
from imubayes.reporting.comparison.kinds import comparison_json, side_by_side
from imubayes.reporting.comparison.lot_files import ClassFile, LotFile, PopulationFile
from imubayes.reporting.comparison.pulls import LEVEL, QUANTILE
from imubayes.reporting.comparison.result_files import ComponentFile, NoiseEstimate, ResultFile
from imubayes.reporting.comparison.units import predictive_sd, units_compared
from imubayes.reporting.html import page_html
from imubayes.reporting.lots_results import lots_json
from imubayes.reporting.results import result_json

TERMS = 10


def _population(mean=0.0, spread=1.0, *, sure=1e-6):
    interval = Share(mean, mean - sure, mean + sure)
    factor = math.exp(sure)
    return PopulationFile(
        (4, 4), Share(1.0, 0.5, 1.0), interval, Share(spread, spread / factor, spread * factor), True
    )


def _lot(noise=((1.0, 1.0, 1.0),), **population):
    terms = {f"b{k}": _population(**population) for k in range(TERMS)}
    entry = ClassFile("mine", Share(1.0, 1.0, 1.0), terms, {}, noise)
    return LotFile(FILE, "gyroscope", 4, {"mine": entry})


def _unit(values, sd=0.5, verdict="needed", class_id="mine", noise=None):
    terms = {f"b{k}": a_term(f"b{k}", v, sd, verdict, "rad/s") for k, v in enumerate(values)}
    return ResultFile(FILE, (ComponentFile("G", "gyroscope", class_id, terms, noise or {}, ()),))


def test_sd_of_a_typical_unit_is_that_of_simulated_ones():
    """Draw mean and spread from their intervals, a unit from these, its estimate: 4 sd of the variance."""
    rng = np.random.default_rng(2)
    found = PopulationFile(
        (1, 1), Share(1.0, 1.0, 1.0), Share(3.0, 2.0, 4.0), Share(1.0, 0.7, 1.0 / 0.7), True
    )
    n = 200_000
    mu = rng.normal(3.0, 1.0 / QUANTILE, n)
    tau = np.exp(rng.normal(0.0, -math.log(0.7) / QUANTILE, n))
    t = rng.normal(rng.normal(mu, tau), 0.8)
    squares = (t - 3.0) ** 2
    assert predictive_sd(0.8, found) ** 2 == pytest.approx(
        squares.mean(), abs=4.0 * squares.std() / math.sqrt(n)
    )


def test_typical_units_are_called_atypical_at_the_level_at_most():
    rng = np.random.default_rng(4)
    lot, alarms, trials = _lot(), 0, 300
    for _ in range(trials):
        values = rng.normal(rng.normal(0.0, 1.0, TERMS), 0.5)
        (unit,) = units_compared([_unit(values), lot]).units
        alarms += any(term.pull.beyond for term in unit.terms)
    assert 0 < alarms <= trials * LEVEL + 4.0 * math.sqrt(trials * LEVEL * (1.0 - LEVEL))


def test_unit_far_from_its_class_is_found_in_whatever_order_they_come():
    values = [0.0] * (TERMS - 1) + [9.0]
    for results in ([_unit(values), _lot()], [_lot(), _unit(values)]):
        (unit,) = units_compared(results).units
        assert [term.name for term in unit.terms if term.pull.beyond] == [f"b{TERMS - 1}"]
        assert unit.terms[-1].pull.size == pytest.approx(9.0 / math.hypot(0.5, 1.0), rel=1e-6)


def test_noise_is_held_against_the_logarithms_of_the_lot():
    rng = np.random.default_rng(1)
    logs = rng.normal(0.0, 0.3, (50, 3))
    runs = {("a", "N"): NoiseEstimate(4.0, 0.1), ("b", "N"): NoiseEstimate(6.0, 0.05)}
    lot = _lot(noise=tuple(map(tuple, np.exp(logs).tolist())))
    (unit,) = units_compared([_unit([0.0], noise=runs), lot]).units
    (noise,) = unit.noise
    spread = np.std(logs[:, 0], ddof=1)
    sd = math.sqrt(spread**2 * (1.0 + 1.0 / 50) + 0.1**2)
    assert noise.pull.size == pytest.approx(abs(math.log(5.0) - logs[:, 0].mean()) / sd, rel=1e-12)


def test_untested_terms_are_not_compared():
    found = units_compared([_unit([99.0] * 3, verdict="untested"), _lot()])
    assert found.tests == 0 and all(term.pull is None for term in found.units[0].terms)


def test_components_of_other_classes_are_named_and_none_at_all_is_refused():
    other = _unit([0.0], class_id="other")
    found = units_compared([_unit([0.0]), other, _lot()])
    assert found.alone == (("B", "G", "other"),) and [unit.label for unit in found.units] == ["A"]
    with pytest.raises(InputError, match=r"gyroscopes of the classes mine, .* gyroscope of class other"):
        units_compared([other, _lot()])
    with pytest.raises(InputError, match="one class-level result, came 2"):
        units_compared([_unit([0.0]), _lot(), _lot()])


def test_page_says_whether_a_unit_is_typical(make_study, make_sensor, tmp_path):
    """A unit of the made-up class with the class's means for its terms, then with another bias."""
    lot = lot_result()
    (tmp_path / "lot.json").write_text(lots_json(lot))
    said = []
    for factor in (1.0, 1e3):
        raw = json.loads(result_json(make_study(make_sensor("G-1", lib=lot_library()))))
        (sensor,) = raw["sensors"]
        sensor |= {"noise": {}, "runs": []}
        for term, found in zip(sensor["terms"], lot.classes[1].terms, strict=True):
            term |= {"full_mean": found.mean.value * (factor if term["name"] == "b0" else 1.0)}
        (tmp_path / "unit.json").write_text(json.dumps(raw))
        shown = side_by_side([tmp_path / "unit.json", tmp_path / "lot.json"])
        said.append(str(shown.page.first[0].texts.striptags()))
        assert "http" not in page_html(shown.page)
        (unit,) = json.loads(comparison_json(shown.record))["units"]
        assert [t["name"] for t in unit["terms"] if t["differs"]] == (["b0"] if factor > 1.0 else [])
    assert said[0] == "G-1 is typical of the lot of class mems_tactical."
    assert said[1].startswith("G-1 is not typical of the lot of class mems_tactical: b0 is")
