from lots_found import lot_result

from imubayes.inference.intervals import Share
from imubayes.reporting.lots_words import budget, counts, of_budget
from imubayes.reporting.rounding import NARROW, ranged


def test_interval_is_rounded_to_two_digits_of_its_half_width():
    # half width 2.5: one decimal, half width 250: tens, half width 22890: thousands
    assert ranged(Share(-11.0, -14.0, -9.0)) == "−11.0 (−14.0 to −9.0)"
    assert ranged(Share(1512.3, 1250.0, 1750.0), "ug") == "1510 (1250 to 1750) µg"
    assert ranged(Share(-1256.0, -24155.0, 21624.0)) == "−1000 (−24000 to 22000)"
    assert ranged(Share(-0.00231, -0.00231, -0.00231)) == "−0.0023 (−0.0023 to −0.0023)"
    assert ranged(Share(float("nan"), 0.0, 1.0)) == ""


def test_budget_is_told_in_the_unit_of_its_quantity():
    result = lot_result()
    assert budget(result.study.missions[0], "gyroscope") == "10 min, budget 1.003 ° of attitude"
    assert budget(result.study.missions[1], "gyroscope") == "10 min, budget 1852 m of position"


def test_share_over_the_budget_is_a_multiple():
    assert [of_budget(x).replace(NARROW, " ") for x in (0.034, 2.0)] == [
        "3.4 % of the budget",
        "2.0 times the budget",
    ]


def test_table_of_a_scene_has_what_is_required_or_takes_a_hundredth():
    near, far = (one.missions[0] for one in lot_result().classes[::2])
    assert all(counts(term) for term in near.terms)
    assert not any(counts(term) for term in far.terms)
