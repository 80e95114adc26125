from dataclasses import fields

import numpy as np
from fleet_studies import fleet
from hypothesis import given
from hypothesis import strategies as st

from imubayes.population.fleet.measure import lot_of
from imubayes.population.fleet.plan import parts_of
from imubayes.population.fleet.reduction import VERDICTS, merge, reduced, tally
from imubayes.population.fleet.units import Broken, PartFound, Record, part_found

P = 2


def _part(index: int, units: int) -> PartFound:
    """Part of made-up records; its first unit is broken."""
    rng = np.random.default_rng(index)
    records = tuple(
        Record(
            number=10 * index + k,
            name=f"u{10 * index + k}",
            mean=rng.standard_normal(P),
            sd=rng.random(P),
            full_mean=rng.standard_normal(P),
            full_sd=rng.random(P),
            inclusion=rng.random(P),
            verdicts=tuple(rng.choice(VERDICTS, P).tolist()),
            noise=tuple(rng.random(3).tolist()),
            samples=int(rng.integers(100)),
            R=np.triu(rng.standard_normal((P + 1, P + 1))),
            truth=rng.standard_normal(P),
        )
        for k in range(1, units)
    )
    return PartFound(index, records, (Broken(10 * index, f"u{10 * index}", "broken"),))


def _same(a, b) -> bool:
    return all(np.array_equal(getattr(a, field.name), getattr(b, field.name)) for field in fields(a))


@given(st.integers(1, 13).flatmap(lambda n: st.permutations(range(n))))
def test_tally_is_the_same_whichever_part_is_done_first(order):
    leaves = [tally(_part(k, 1 + k % 4), P) for k in range(len(order))]
    found = reduced(((k, leaves[k]) for k in order), len(order))
    straight = leaves[0]
    for leaf in leaves[1:]:
        straight = merge(straight, leaf)
    assert _same(found, straight)


def test_tally_is_that_of_all_units_in_one_part():
    study = fleet(4, part=1)
    found = [part_found(study, part) for part in parts_of(study, lot_of(study))]
    p = len(study.spec.library.terms)
    whole = PartFound(0, tuple(record for one in found for record in one.records), ())
    assert _same(reduced(((one.index, tally(one, p)) for one in found), 4), tally(whole, p))


def test_every_unit_has_one_verdict_a_term_in_the_counts():
    found = tally(_part(1, 9), P)
    assert found.counts.sum(axis=0).tolist() == [8, 8]
    needed = [record.verdicts.count("needed") for record in _part(1, 9).records]
    assert found.order.tolist() == needed
    assert found.counts[0].sum() == sum(needed)
    assert [one.name for one in found.broken] == ["u10"]
