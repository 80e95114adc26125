from dataclasses import fields

import numpy as np
from fleet_studies import fleet

from imubayes.population.fleet import lot_of
from imubayes.population.parts import PartFound, part_found, parts_of
from imubayes.population.records import Broken, Record
from imubayes.population.tally import VERDICTS, tally, together

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


def test_tally_is_that_of_all_units_in_one_part():
    study = fleet(4, part=1)
    found = [part_found(study, part) for part in parts_of(study, lot_of(study))]
    p = len(study.spec.library.terms)
    whole = tally([record for one in found for record in one.records], p)
    assert _same(together([tally(one.records, p) for one in found]), whole)


def test_every_unit_has_one_verdict_a_term_in_the_counts():
    found = tally(_part(1, 9).records, P, _part(1, 9).broken)
    assert found.counts.sum(axis=0).tolist() == [8, 8]
    needed = [record.verdicts.count("needed") for record in _part(1, 9).records]
    assert found.order.tolist() == needed
    assert found.counts[0].sum() == sum(needed)
    assert [one.name for one in found.broken] == ["u10"]
