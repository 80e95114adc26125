"""A small, complete class-level result, made by hand."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from lot_studies import told

from imubayes.campaign import Mission, SensorSpec
from imubayes.inference import Rate, Share
from imubayes.population import Record
from imubayes.population.lots import Check, LotResult, LotStudy
from imubayes.population.needs import ClassFound, InLot, MissionFound, MissionTerm, PopulationTerm
from imubayes.population.pooled import Pooled
from imubayes.scenes.propagation import Budget
from imubayes.scenes.trajectories import generated, scene_named
from imubayes.selection.panel import Votes
from imubayes.sensors import SensorClass
from imubayes.sensors.catalogue import prior_sd, sensor
from imubayes.sensors.terms import Library, library

SIZES = {"mems_consumer": 1.0, "mems_tactical": 0.3, "fog_navigation": 0.001}
"""Shares of the budget that the largest term of each class takes."""

SHAKEN = ("g_i", "g_k")
"""Terms that the first scene requires of MEMS."""

UNSEEN = "S_kk"
"""Term of which the tests of no class can tell, and that by the catalogue would matter to consumer MEMS."""


def lot_library() -> Library:
    """Candidates of the made-up study."""
    return library("gyroscope", powers=2, asymmetry=0, set="extended")


def lot_result(*, basic: bool = True, title: str = "MEMS <b>or</b> FOG?") -> LotResult:
    """Three classes in two scenes: MEMS needs g_i and g_k in the first, navigation FOG nothing."""
    entries = tuple(sensor(name, kind="gyroscope") for name in SIZES)
    missions = tuple(
        Mission(name, generated(scene_named(name), np.random.default_rng(1), duration=600.0), budget)
        for name, budget in (
            ("helicopter", Budget("attitude", 0.0175)),
            ("fixed_wing", Budget("position", 1852.0)),
        )
    )
    specs = tuple(SensorSpec(one.id, one.kind, one, lot_library(), (), {}) for one in entries)
    study = LotStudy(
        title=title, seed=3, kind="gyroscope", specs=specs, units=4, library=lot_library(), missions=missions,
        basic=basic, processes=1, path=Path("lots.toml"), text="[lots]\n", methods=1,
    )  # fmt: skip
    means, spreads = Rate(27, 33, Share(0.82, 0.69, 0.91)), Rate(30, 33, Share(0.91, 0.81, 0.97))
    shares, own = Rate(38, 40, Share(0.95, 0.86, 0.99)), Rate(120, 160, Share(0.75, 0.69, 0.80))
    found = Share(0.98, 0.95, 0.99), Share(0.97, 0.94, 0.99)
    linear, well = Rate(144, 160, Share(0.90, 0.85, 0.93)), Rate(90, 100, Share(0.90, 0.84, 0.94))
    check = Check(*found, (84, 20), means, spreads, shares, own, linear, well, (0.002, 0.06))
    return LotResult(study, tuple(_class(one, study) for one in entries), check, 90.0)


def counted(found: ClassFound, needed: int, hidden: int = 0, of: str = "") -> ClassFound:
    """A class of whose units so many need each term, or one of them, and so many leave it open."""

    def told(term: PopulationTerm) -> PopulationTerm:
        if of not in ("", term.name):
            return term
        lots = tuple(replace(lot, needed=needed, open=hidden) for lot in term.lots)
        return replace(term, lots=lots, pooled=replace(term.pooled, inclusion=0.5))

    terms = tuple(map(told, found.terms))

    def seen(scene: MissionFound) -> MissionFound:
        pairs = zip(scene.terms, terms, strict=True)
        return replace(scene, terms=tuple(replace(one, known=known) for one, known in pairs))

    return replace(found, terms=terms, missions=tuple(map(seen, found.missions)))


def _class(entry: SensorClass, study: LotStudy) -> ClassFound:
    lib, size = study.library, SIZES[entry.id]
    terms = tuple(_population(entry, lib, k, size) for k in range(len(lib.terms)))
    units = tuple(_unit(entry, lib, number) for number in range(study.units))
    missions = tuple(
        _mission(terms, mission.name, size if k == 0 else 0.1 * size, study.basic)
        for k, mission in enumerate(study.missions)
    )
    return ClassFound(entry, units, terms, Share(round(12 * size**0.2), 3.0, 14.0), missions)


def _population(entry: SensorClass, lib: Library, k: int, size: float) -> PopulationTerm:
    typical = prior_sd(entry, lib.terms[k])[0]
    mean = (0.4 - 0.1 * k) * typical
    needed = max(0.0, 1.0 - 0.08 * k) if size > 0.1 else 0.25 * (k < 3)
    if size > 0.1 and lib.terms[k].name in SHAKEN:
        needed = 1.0
    share = min(1.0 - needed, 0.7 if k % 5 == 4 else 0.1)
    lot = InLot(
        round(100 * needed),
        round(100 * share),
        Share(mean, mean - 0.3 * typical, mean + 0.3 * typical),
        Share(typical, 0.6 * typical, 2.0 * typical),
        1.1 * mean,
        0.9 * typical,
    )
    pooled = Pooled(0.5, Share(0.4, 0.1, 0.8), 2.0 * typical)
    return PopulationTerm(lib.terms[k].name, 100, (lot,), pooled)


def _mission(known: Sequence[PopulationTerm], name: str, size: float, basic: bool) -> MissionFound:
    terms = tuple(_in_scene(term, size) for term in known)
    order = float(sum(term.required >= 0.5 for term in terms))
    return MissionFound(
        name, terms, *2 * (Share(order, order, order + 1.0),), 1.0, 0.2, 3.0 * size if basic else np.nan
    )


def _in_scene(known: PopulationTerm, size: float) -> MissionTerm:
    share = size * (1.0 if known.name in SHAKEN else 0.2 if known.name == UNSEEN else 0.05)
    return MissionTerm(
        known,
        1e-5 * share,
        Share(share, 0.3 * share, 3.0 * share),
        float(share > 0.1),
        1.1 * share,
        2.0 * share,
        1.08 * share,
        (3, 4),
    )


def _unit(entry: SensorClass, lib: Library, number: int) -> Record:
    sd = np.array([prior_sd(entry, term)[0] for term in lib.terms])
    rng = np.random.default_rng(number)
    truth = sd * rng.standard_normal(len(sd))
    return Record(
        number, entry.id, truth, 0.01 * sd, truth, 0.01 * sd, np.full(len(sd), 0.9),
        ("needed",) * len(sd), (1e-5, 1e-6, 1e-7), 100, told(truth, 0.01 * sd), truth, np.tile(truth, (8, 1)),
        _votes(lib.names) if number == 0 else None,
    )  # fmt: skip


def _votes(names: tuple[str, ...]) -> Votes:
    """Votes of which AIC has all terms, and STLSQ lacks one."""
    keeps = np.ones((3, len(names)))
    keeps[2, names.index("c_jk")] = 0.0
    return Votes(names, ("evidence", "aic", "stlsq"), 0.9 * keeps, keeps, ())
