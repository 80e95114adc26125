"""Class-level results side by side, and units beside their class."""

import math
from dataclasses import replace

import numpy as np
import pytest
from lots_found import lot_result
from published_found import FILE, a_result, a_sensor, a_term

from imubayes.errors import InputError
from imubayes.inference import SIDE, Share
from imubayes.reporting.comparison import scatter, units_compared
from imubayes.reporting.comparison.differences import LEVEL, fisher
from imubayes.reporting.comparison.lots import LOTS, lots_compared
from imubayes.reporting.comparison.page import comparison_record
from imubayes.reporting.lots_page import published_lots

TERMS = 10


def _changed(result, **first):
    """The first class with other figures of its first term, or of itself."""
    one = result.classes[0]
    if "order" not in first:
        lots = tuple(replace(lot, **first) for lot in one.terms[0].lots)
        first = {"terms": (replace(one.terms[0], lots=lots), *one.terms[1:])}
    return replace(result, classes=(replace(one, **first), *result.classes[1:]))


def _compared(*results):
    return lots_compared([FILE] * len(results), [published_lots(one) for one in results])


def _first(*results):
    """The first term of the first class."""
    return _compared(*results).groups[0].terms["b0"]


def test_mean_differs_over_its_sd_and_spread_by_its_logarithm():
    a = _changed(lot_result(), mean=Share(1.0, 0.9, 1.1), spread=Share(1.0, 0.5, 2.0))
    b = _changed(lot_result(), mean=Share(2.0, 1.9, 2.1), spread=Share(4.0, 2.0, 8.0))
    pulls = _first(a, b).pulls
    assert pulls["mean"].size == pytest.approx(1.0 / (math.sqrt(2.0) * 0.1 / SIDE), rel=1e-12)
    assert pulls["spread"].size == pytest.approx(2.0 / math.sqrt(2.0) * SIDE, rel=1e-12)
    assert pulls["mean"].beyond and not pulls["spread"].beyond


def test_shares_of_units_differ_by_their_counts():
    a, b = (_changed(lot_result(), needed=count) for count in (100, 25))
    assert _first(a, b).pulls["needed"].size == fisher((4, 4), (1, 4))


def test_classes_of_one_result_only_are_named():
    result = lot_result()
    found = _compared(result, replace(result, classes=result.classes[1:]))
    assert found.alone == [("A", result.classes[0].sensor_class.id)]
    assert [one.name for one in found.groups] == [c.sensor_class.id for c in result.classes[1:]]


def test_model_orders_are_apart_where_no_unit_is_in_both_ranges():
    far = _changed(lot_result(), order=Share(40.0, 38.0, 42.0))
    classes = comparison_record(_compared(lot_result(), far), LOTS)["classes"]
    assert [one["orders_apart"] for one in classes] == [True, False, False]


def test_what_cannot_be_compared_is_refused():
    result = lot_result()
    with pytest.raises(InputError, match="2 to 26"):
        _compared(result)
    with pytest.raises(InputError, match=r"no class in common .*mems_consumer"):
        _compared(*(replace(result, classes=some) for some in (result.classes[:1], result.classes[1:])))
    with pytest.raises(InputError, match="A gyroscopes, B accelerometers"):
        _compared(result, replace(result, study=replace(result.study, kind="accelerometer")))


def _interval(value, low, high):
    return {"value": value, "low": low, "high": high}


def _lot(noise=((1.0, 1.0, 1.0),)):
    """Lot of one class, whose terms have a population that is surely known; with noise of its units."""
    lot = published_lots(lot_result())
    one, sure = lot["lots"]["classes"][0], 1e-6
    term = one["terms"][0] | {
        "needed": _interval(1.0, 0.5, 1.0),
        "mean": _interval(0.0, -sure, sure),
        "spread": _interval(1.0, math.exp(-sure), math.exp(sure)),
    }
    terms = tuple(term | {"name": f"b{k}"} for k in range(TERMS))
    units = tuple(
        one["units"][0] | {"verdicts": ("needed",) * TERMS, "noise": dict(zip("NBK", figures, strict=True))}
        for figures in noise
    )
    mine = one | {"id": "mine", "terms": terms, "units": units}
    return lot | {"lots": lot["lots"] | {"classes": (mine,)}}


def _unit(values, verdict="needed", class_id="mine", noise=None):
    terms = [a_term(f"b{k}", v, 0.5, verdict, "rad/s") for k, v in enumerate(values)]
    return a_result(a_sensor("G", terms, noise or {}, kind="gyroscope", **{"class": class_id}))


def _beside(*results):
    return units_compared([FILE] * len(results), results)


def test_sd_of_a_typical_unit_is_that_of_simulated_ones():
    """Draw mean and spread from their intervals, a unit from these, its estimate: 4 sd of the variance."""
    rng = np.random.default_rng(2)
    found = {"mean": _interval(3.0, 2.0, 4.0), "spread": _interval(1.0, 0.7, 1.0 / 0.7)}
    n = 200_000
    mu = rng.normal(3.0, 1.0 / SIDE, n)
    tau = np.exp(rng.normal(0.0, -math.log(0.7) / SIDE, n))
    t = rng.normal(rng.normal(mu, tau), 0.8)
    squares = (t - 3.0) ** 2
    assert 0.8**2 + scatter(found) ** 2 == pytest.approx(
        squares.mean(), abs=4.0 * squares.std() / math.sqrt(n)
    )


def test_typical_units_are_called_atypical_at_the_level_at_most():
    rng = np.random.default_rng(4)
    lot, alarms, trials = _lot(), 0, 300
    for _ in range(trials):
        values = rng.normal(rng.normal(0.0, 1.0, TERMS), 0.5)
        (unit,) = _beside(_unit(values), lot).groups
        alarms += any(term.beyond for term in unit.terms.values())
    assert 0 < alarms <= trials * LEVEL + 4.0 * math.sqrt(trials * LEVEL * (1.0 - LEVEL))


def test_unit_far_from_its_class_is_found_in_whatever_order_they_come():
    last = f"b{TERMS - 1}"
    for results in ((unit := _unit([0.0] * (TERMS - 1) + [9.0]), _lot()), (_lot(), unit)):
        (found,) = _beside(*results).groups
        assert [name for name, term in found.terms.items() if term.beyond] == [last]
        assert found.terms[last].pull.size == pytest.approx(9.0 / math.hypot(0.5, 1.0), rel=1e-6)


def test_noise_is_held_against_the_logarithms_of_the_lot():
    logs = np.random.default_rng(1).normal(0.0, 0.3, (50, 3))
    (unit,) = _beside(_unit([0.0], noise={"a": (4.0, 0.1), "b": (6.0, 0.05)}), _lot(np.exp(logs))).groups
    (noise,) = unit.noise.values()
    sd = math.hypot(np.std(logs[:, 0], ddof=1) * math.sqrt(1.0 + 1.0 / 50), 0.1)
    assert noise.pull.size == pytest.approx(abs(math.log(5.0) - logs[:, 0].mean()) / sd, rel=1e-12)


def test_components_of_other_classes_are_named_and_none_at_all_is_refused():
    other = _unit([0.0], class_id="other")
    found = _beside(_unit([0.0]), other, _lot())
    assert found.alone == [("B", "G", "other")] and [unit.labels[0] for unit in found.groups] == ["A"]
    with pytest.raises(InputError, match=r"gyroscopes of the classes mine, .* gyroscope of class other"):
        _beside(other, _lot())
    with pytest.raises(InputError, match="one class-level result, came 2"):
        _beside(_unit([0.0]), _lot(), _lot())


def test_untested_terms_are_not_compared():
    found = _beside(_unit([99.0] * 3, verdict="untested"), _lot())
    assert found.tests == 0 and all(term.pull is None for term in found.groups[0].terms.values())
