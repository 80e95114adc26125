"""What reports say in cases that no golden page has, to the letter (`tests/references/sayings`)."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from block_readings import rows, said
from fleets_found import fleet_result
from lots_found import counted, lot_result
from page_reading import printed, told_of
from populations_found import class_found
from results_found import (
    UG,
    cased,
    judged_result,
    recovered,
    repeatability,
    sampled_result,
    sensor_result,
    study_result,
)
from scenes_found import a_relevance
from scipy import stats

from imubayes.campaign import Choice, SensorCheck
from imubayes.inference import Rate, Share
from imubayes.inference.known_quantities import Recovered
from imubayes.inference.noise_model import NoiseEstimate
from imubayes.inference.observability import Confounded
from imubayes.population.lots import Against
from imubayes.population.sessions import level_among
from imubayes.reporting import figures
from imubayes.reporting.case_views import angle_sections, case_answer, cases_of, cases_section
from imubayes.reporting.chain_views import (
    MOST_BENCH,
    bench_sections,
    bias_sentence,
    chain_sections,
    change_sections,
    choice_sentences,
    component_answer,
    diagnoses,
    distrust_sentence,
    published_choice,
)
from imubayes.reporting.document import report_page
from imubayes.reporting.fit_views import (
    candidate_sentence,
    dwell_sections,
    fit_sentence,
    found_sentence,
    missing_sentence,
    nothing_sentence,
    predictive_sentence,
    temperature_sentence,
)
from imubayes.reporting.fleet_page import standing_out
from imubayes.reporting.lots_sentences import (
    check_sentences,
    class_sentences,
    contrasts,
    lots_answer,
    own_scene_sentences,
    scene_sentences,
)
from imubayes.reporting.lots_words import headline, in_scene, of_budget, ranged_in, simulated
from imubayes.reporting.method_views import (
    MOST_DISAGREEMENTS,
    decided,
    disagreement_sentences,
    methods_sections,
    opinion_tables,
    prior_sentence,
    reduced_sentence,
    votes_title,
)
from imubayes.reporting.population_views import class_section, session_section, session_sentence, spread_text
from imubayes.reporting.population_views import class_sentences as population_sentences
from imubayes.reporting.rows import confounded_sentences, in_own_names, noise_cells, range_texts
from imubayes.reporting.scene_words import scene_sentences as requirements
from imubayes.reporting.tables import terminal_check
from imubayes.reporting.views import shown_sensors, term_blocks
from imubayes.scenes.propagation import Budget
from imubayes.selection.decision import Bias
from imubayes.selection.panel import Votes
from imubayes.selection.verdicts import EQUAL, Costs
from imubayes.sensors.terms import library

Sayings = Iterator[tuple[str, Any]]


def _terms(found: Any, **changed: Any) -> Any:
    """Change every term of what a class, or a class in a scene, was found to need."""
    return replace(found, terms=tuple(replace(term, **changed) for term in found.terms))


def _class(result: Any, k: int, one: Any) -> Any:
    classes = list(result.classes)
    classes[k] = one
    return replace(result, classes=tuple(classes))


def _scene(one: Any, scene: Any) -> Any:
    """Put another first scene in the place of a class's own."""
    return replace(one, missions=(scene, *one.missions[1:]))


def _needing(result: Any, k: int, *names: str) -> Any:
    """All units of the k-th class need these terms."""
    one = result.classes[k]
    for name in names:
        one = counted(one, 100, of=name)
    return _class(result, k, one)


def lots() -> Sayings:
    result = lot_result()
    first, last = result.classes[0], result.classes[2]
    near = _scene(last, _terms(last.missions[0], share=last.missions[0].terms[0].share._replace(high=0.5)))
    yield "a class comes near the budget", next(contrasts(_class(result, 2, near), 0))[2]
    hidden = contrasts(_class(result, 2, counted(last, 0, 90)), 0)
    yield "tests of a class leave the terms open", next(hidden)[2]
    loud = _scene(first, replace(first.missions[0], noise_share=2.5, within=0.1))
    yield "noise is above the budget", scene_sentences(_class(result, 0, loud), 0)
    dark = [counted(one, 0, 100) for one in result.classes]
    dark = [
        replace(one, missions=tuple(_terms(scene, required=1.0) for scene in one.missions)) for one in dark
    ]
    yield "nothing is shown, and models have all", scene_sentences(replace(result, classes=tuple(dark)), 0)
    yield "of such a class", class_sentences(dark[0], 23)
    half = replace(first.missions[0], within=0.5, order=Share(1.5, 0.0, 4.0))
    yield "half of the units stay within the budget", own_scene_sentences(half)
    for recall, share in ((0.97, 0.90), (0.90, 0.90), (0.97, 0.80)):
        spread = Rate(33, 40, Share(share, share - 0.1, share + 0.05))
        check = replace(result.check, untold=7, recall=Share(recall, 0.8, 1.0), population_spread=spread)
        yield f"recall {recall}, coverage {share}", check_sentences(replace(result, check=check))
    few = replace(result.check, linear_shares=Rate(128, 160, Share(0.80, 0.73, 0.86)))
    for held in (0.80, 0.90):
        seen = Rate(round(100 * held), 100, Share(held, held - 0.06, held + 0.05))
        yield (
            f"units lean on the prior, {held}",
            check_sentences(replace(result, check=replace(few, seen_shares=seen))),
        )
    beyond, term = replace(first.missions[0], beyond=(40.0, 18.0)), first.missions[0].terms[0]
    # a share that the navigator holds for less than what was flown is no more than that
    yield "shares beyond the linear range", [of_budget(share, beyond) for share in (17.0, 39.0, 3e5)]
    wide = replace(term, share=Share(12.0, 5.0, 200.0), most_of_budget=0.5)
    open_ = replace(wide, known=counted(first, 0, 100).terms[0])
    yield "and as ranges", [ranged_in(beyond, one) for one in (wide, open_)]
    alone = [replace(term, required=0.25, share=Share(share, share, share)) for share in (0.9, 1.0)]
    yield "takes the budget alone, and is not needed", [in_scene(one) for one in alone]
    taken = replace(first.missions[0], terms=(alone[1], *first.missions[0].terms[1:]))
    yield "in words", own_scene_sentences(taken)
    yield "the answer leads to", [anchor for _, anchor in lots_answer(result)]
    yield "and without the basic triad", [anchor for _, anchor in lots_answer(lot_result(basic=False))]
    sure = [counted(one, 100) for one in result.classes]
    study = replace(result.study, units=1000)
    yield "many units of one mind", simulated(replace(result, study=study, classes=tuple(sure)))


def _without_scenes(result: Any) -> Any:
    bare = tuple(replace(one, missions=()) for one in result.classes)
    return replace(result, classes=bare, study=replace(result.study, missions=()))


def lots_headlines() -> Sayings:
    result = lot_result()
    fog = Against(("fog_navigation",), ("mems_consumer", "mems_tactical"))
    mems = Against(fog.not_by, fog.needed_by)
    cases = {
        "all classes need two": (_needing(result, 2, "b0", "b1"), "classes"),
        "scenes": (result, "scenes"),
        "triad": (result, "triad"),
        "one needs what the others do without": (_without_scenes(_needing(result, 2, "c_kk")), fog),
        "others may need it too": (result, fog),
        "two need what the other does without": (result, mems),
    }
    for case, (found, asks) in cases.items():
        yield case, headline(replace(found, study=replace(found.study, asks=asks)))[0]


def fleets() -> Sayings:
    found = fleet_result()
    near, far = (replace(found.worst[0], pull=pull, outlier=pull > found.limit) for pull in (2.5, 9.0))
    yield "no outlier", standing_out(replace(found, outliers=0, worst=(near,)))
    nine = tuple(replace(far, unit=f"u{k}") for k in range(9))
    yield "nine", standing_out(replace(found, outliers=9, worst=nine))


def votes() -> Sayings:
    for keeps in (
        [[1, 1, 0], [1, 1, 0]], [[1, 1, 0], [1, 0, 0]], [[1, 1, 0], [1, 0, math.nan]], [[0, 1, 0], [1, 0, 0]],
        [[1, 1, 1, 1, 1], [1, 0, 0, 0, 0]], [[1, 1, 0], [math.nan] * 3, [1, 1, 0]], [[0, 0], [0, 0]],
    ):  # fmt: skip
        table = np.array(keeps)
        methods, terms = (tuple(f"{a}{k}" for k in range(n)) for a, n in zip("mb", table.shape, strict=True))
        one = Votes(terms, methods, table, table, ())
        yield str(keeps), votes_title(one, SimpleNamespace(terms=(), model=()))
    sensor = judged_result()
    found = sensor.panel.votes
    keeps = found.keeps.copy()
    keeps[0, found.terms.index("c_jj")] = 1.0
    yield "and one of them is kept", votes_title(replace(found, keeps=keeps), sensor.selection)
    (weak,) = found.disagreements
    more = [replace(weak, term=name, methods=("evidence",), text="long") for name in ("c_jj", "c_kk", "c_jk")]
    together = replace(found, disagreements=(*more, weak))
    yield "of what it cannot tell", disagreement_sentences(together, sensor.selection)
    many = tuple(replace(weak, text=f"reason {k}") for k in range(MOST_DISAGREEMENTS + 3))
    panel = replace(sensor.panel, votes=replace(found, disagreements=many))
    yield "many", said(methods_sections(sensor, panel, drawn=True)).partition("Reason")[2][:1500]


def methods() -> Sayings:
    sensor = judged_result()
    # c_jj is inseparable, c_ij untested, b0p undecided
    likely = replace(sensor.selection, model=(*sensor.selection.model, "c_jj", "c_ij", "b0p"))
    for of, one in (("the model", sensor.selection), ("more", likely)):
        yield f"held against this of {of}", " ".join(decided(one))
    panel, found = sensor.panel, sensor.panel.sensitivity
    yield "a false drop is dear", prior_sentence(found, Costs(false_keep=1.0, false_drop=4.0))
    yield "nothing swings", prior_sentence(replace(found, swing=()), EQUAL)
    other = found.inclusion[4].copy()
    other[0], other[-1] = 0.02, np.nan
    apart = replace(found, g_prior=other, left_out=(found.names[-1],))
    yield "g disagrees, and cannot have one", prior_sentence(apart, EQUAL)
    yield "reduced to one", reduced_sentence(replace(panel.reduced, terms=("b0",)), sensor.kind)
    nothing = replace(panel.reduced, terms=(), lost=1e-6)
    yield "reduced to nothing", reduced_sentence(nothing, sensor.kind)
    loo = next(one for one in panel.criteria if one.name == "loo")
    none = replace(loo, compared=0, note="too many subsets, -3 nats")
    (row,) = rows(opinion_tables("", replace(panel, criteria=(none,), sindy=()), ("b0",)))
    yield "not compared", " | ".join(row)
    sections = methods_sections(sensor, replace(panel, criteria=(none,)), drawn=True)
    yield "why", next(text for text in said(sections).split(". ") if "Dwell left out: too many" in text)
    far = replace(panel.sindy[0], model=("ay.b0", "ay.b2"), stable=("ay.b0",))
    triad = replace(sensor.selection, columns=tuple(f"ay.{name}" for name in sensor.selection.columns))
    alone = replace(panel, criteria=(), sindy=(in_own_names(far, triad),))
    (row,) = rows(opinion_tables("", alone, ("b0", "b1")))
    yield "of a triad", " | ".join(row)


CHEAP = Choice(
    "sparse", "a budget of 1 s", 0.4, 0.5, (), "plug-in", 0.9, (0.1, 0.3), "neighbours", budget=1.0
)
CLIMBED = Choice(
    "raw", "an accuracy of 0.1 posterior sd", 4.0, 9.0,
    (("means", 0.0, 0.0), ("full", 0.2, 0.1), ("raw", 0.05, 0.01)),
    None, 0.0, (0.0, 0.0), "there is no better rung", accuracy=0.1,
)  # fmt: skip
CHOICES = {
    "fits": CHEAP,
    "none fits": replace(CHEAP, foreseen=2.0, seconds=1.2),
    "took longer": replace(CHEAP, seconds=1.6),
    "reached": CLIMBED,
    "not reached": replace(CLIMBED, accuracy=0.01),
    "as asked": replace(CHEAP, budget=None),
}


def chains() -> Sayings:
    for case, choice in CHOICES.items():
        met = published_choice(choice)["met"]
        yield f"{case}, {'met' if met else 'not met'}", choice_sentences(choice)
    sensor, mixing = sampled_result(), sampled_result(converged=False)
    yield "not converged", component_answer(mixing)[:2]
    told = Choice("raw", "so much", 4.0, 9.0, (), None, 0.0, (0.0, 0.0), "the top")
    for given in ("budget", "accuracy"):
        choice = replace(told, **{given: 1.0})
        yield f"not converged within its {given}", component_answer(replace(mixing, choice=choice))[0]
    yield "1 not trusted", distrust_sentence(replace(sensor, distrusted=sensor.distrusted[:1]))
    many = tuple(replace(sensor.distrusted[0], run=f"r{k}") for k in range(9))
    yield "many not trusted", distrust_sentence(replace(sensor, distrusted=many))
    yield "diagnostics", said(chain_sections(sensor))
    found, count = sensor.chains.diagnostics, len(sensor.chains.names)
    few = {key: getattr(found, key)[:count] for key in ("parameters", "ess", "rhat", "tau")}
    yield (
        "of coefficients alone",
        diagnoses(sensor, replace(sensor.chains, diagnostics=replace(found, **few))),
    )
    yield "diagnostics that are bad", diagnoses(mixing, mixing.chains)
    plug_in = (*sensor.selection.plug_in[:4], 0.62, *sensor.selection.plug_in[5:])
    crossing = replace(sensor, selection=replace(sensor.selection, plug_in=plug_in))
    yield "across a line", said(change_sections(crossing))
    for drift in (3e-5, 9e-5, 3e-4):
        bias = Bias((1e-3, 1e-4), (1e-3, 1e-4), (1e-3 + drift, 1e-4), (drift, 4e-5), walk=4e-5)
        yield f"a bias that drifts by {drift}", bias_sentence(replace(sensor, bias=bias))
    run = sensor_result().runs[0]
    given = replace(run, found=NoiseEstimate(run.noise))
    yield "noise that the data do not show", [[str(cell) for cell, _ in noise_cells(run, sensor.kind)]]
    yield "given noise", [[str(cell) for cell, _ in noise_cells(given, sensor.kind)]]
    G = 9.80665
    ends = {"f_i": (-20.0 * G, 20.0 * G), "w_j": (0.0, math.pi), "T": (293.15, 299.15), "dT": (0.0, 0.1)}
    yield "ranges", [*range_texts(replace(run, ranges=ends), sensor.kind)]
    hidden = ("m_j", "fixture_j.tumble.1", "fixture_j.tumble.2", "gravity")
    terms = tuple(replace(t, confounded_with=hidden * (t.name == "m_k")) for t in sensor.selection.terms)
    partnered = replace(sensor, selection=replace(sensor.selection, terms=terms))
    cells = rows(term_blocks(shown_sensors(study_result(partnered))[0]))
    yield "partners on the bench", next(row[-1] for row in cells if row[0] == "m_k")


def bench() -> Sayings:
    sensor = sampled_result()
    fixture = sensor.extras[1]

    def grouped(one: Any, *names: str) -> str:
        group = Confounded(names, (1.0,) * len(names), 0.9, True, "", "another mount")
        return confounded_sentences((group,), one.selection.terms, [entry.extra for entry in one.extras])[0]

    yield "one error", grouped(sensor, "b1", "gravity")
    mounts = tuple(
        replace(fixture, extra=replace(fixture.extra, name=f"fixture_j.tumble.{k}")) for k in range(5)
    )
    names = [entry.extra.name for entry in mounts]
    yield "five of a kind", grouped(replace(sensor, extras=mounts), "m_j", "m_k", *names)
    # 0.3 and 0.98 of a prior sd of 50 ug
    yield "printed", rows(bench_sections(sensor))
    many = tuple(
        replace(
            fixture,
            extra=replace(fixture.extra, name=f"fixture_j.tumble.{k}", text=f"mount {k}"),
            sd=fixture.extra.sd * (1.0 if k % 2 else 0.5),
        )
        for k in range(2 * MOST_BENCH)
    )
    found = list(bench_sections(replace(sensor, extras=many)))
    yield "many", ([row[0] for row in rows(found)], said(found))


def fit() -> Sayings:
    good, one = sensor_result(), sensor_result(runs=("tumble",))
    yield "one does not", component_answer(sensor_result(misfit="centrifuge"))[-1]
    for scale, p, outliers in (
        (1.5, 0.4, ()), (1.0, 1e-5, ()), (0.7, 0.4, ()), (1.0, 0.4, ((1.0, 2.0, -9.0),)),
    ):  # fmt: skip
        check = replace(one.checks[0], scale=scale, whiteness_p=p, outliers=outliers, fits=False)
        yield f"scale {scale}, p {p}, {len(outliers)} out", fit_sentence(replace(one, checks=(check,)))
    # residuals below the noise beside stills: the error bars are judged by these
    weak = (replace(one.checks[0], scale=0.6, whiteness_p=0.4, outliers=(), fits=False),)
    after, sd = np.repeat([3.0, 0.5], [8, 13])[:, None], np.ones((21, 1))
    off = Recovered("hand", "gravity", after, after, after, sd, 2.0 * sd)
    for case, known in (("no", ()), ("two sd off", (off,)), ("right", (replace(off, after=0.1 * sd),))):
        yield f"known quantities: {case}", fit_sentence(replace(one, checks=weak, recovered=known))
    # sqrt((9 * 1 + 1 * 4) / 10) = 1.14
    summaries = (replace(good.runs[0], samples=9), replace(good.runs[1], samples=1))
    checks = (replace(good.checks[0], scale=1.0), replace(good.checks[1], scale=2.0))
    yield "weighted by samples", fit_sentence(replace(good, runs=summaries, checks=checks))
    sensor = judged_result()
    misfit = sensor.misfit
    yield "something is missing", component_answer(sensor)
    yield "and a run does not fit", component_answer(judged_result(misfit="centrifuge"))[-1]
    yield "nothing was looked for", component_answer(replace(sensor, misfit=None))
    yield "nothing was found", component_answer(replace(sensor, misfit=replace(misfit, found=())))
    loop = misfit.found[0]
    many = tuple(replace(loop, input=name) for name in ("f_i", "f_j", "f_k", "t", "hysteresis of f_i"))
    yield "many inputs", missing_sentence(replace(misfit, found=many), fits=False)
    for n in (3, 4):
        yield many[n].input, missing_sentence(replace(misfit, found=(many[n],)), fits=True)
    yield "found", found_sentence(misfit, "accelerometer")
    terms = tuple(replace(loop, run="", input=name) for name in ("b4", "b1*T"))
    for found in (misfit.found, terms[:1], terms):
        yield f"{len(found)} of {found[0].where}", candidate_sentence(replace(misfit, found=found))
    few = replace(good.checks[0], scale=np.nan, whiteness_p=np.nan)
    yield "the fit leaves too little to test", fit_sentence(replace(good, checks=(few,)))
    yield "one run tells", fit_sentence(replace(good, checks=(few, good.checks[1])))
    unlike = replace(few, scale=3.0, fits=False)
    yield "size alone tells", fit_sentence(replace(good, checks=(unlike,)))
    yield "and its page", report_page(study_result(replace(good, checks=(few,)))).status
    yield "residuals were left out", report_page(study_result(replace(good, checks=()))).status
    odd = replace(misfit, predictive_p={"tumble": 2e-4, "centrifuge": 0.4})
    yield "not predicted", predictive_sentence(odd)
    yield "not asked", predictive_sentence(replace(misfit, predictive_p={}))
    # one that goes with another is neither found nor nothing
    other = replace(misfit, found=(), dependences=(replace(loop, input="T"),))
    yield "neither", nothing_sentence(other)
    dwells = list(dwell_sections(replace(sampled_result(), distrusted=sampled_result().distrusted * 30)))
    yield "dwells", (*rows(dwells)[:2], said(dwells))
    yield "of a gyroscope", rows(dwell_sections(replace(sampled_result(), kind="gyroscope")))[:1]


def temperature() -> Sayings:
    sensor = judged_result(lib=library("accelerometer", temperature=3, rate_of=()))
    terms = tuple(replace(term, verdict="needed") for term in sensor.selection.terms)
    sensor = replace(sensor, selection=replace(sensor.selection, terms=terms))
    yield "not enough", temperature_sentence(sensor)
    misfit = replace(sensor.misfit, found=())
    yield "enough", temperature_sentence(replace(sensor, misfit=misfit))
    yield "not tested", temperature_sentence(replace(sensor, misfit=replace(misfit, dependences=())))
    yield "not asked", temperature_sentence(judged_result())


def _seeing(sensor: Any, *groups: Confounded, columns: Sequence[str] = ()) -> Any:
    """Change the groups of terms that a sensor's test sees in combination, and the names of its columns."""
    selection = sensor.selection
    seen = replace(selection.observability, groups=groups)
    if columns:
        selection, seen = replace(selection, columns=columns), replace(seen, names=columns)
    return replace(sensor, selection=replace(selection, observability=seen))


def confounded() -> Sayings:
    def pair(first: str, second: str, why: str = "x", what: str = "a centrifuge") -> Confounded:
        return Confounded((first, second), (1.0, -1.0), 1.0, True, why, what)

    near = replace(pair("b0", "b2", ""), exact=False)
    yield "nearly", confounded_sentences([near], ())
    groups = [pair("b0", "b2"), pair("b1", "b3", "y"), pair("c_jj", "c_kk")]
    yield "two causes", confounded_sentences(groups, ())
    yield "no class", component_answer(replace(sensor_result(), class_id=""))[0]
    gyro = sensor_result(lib=library("gyroscope"))
    yield (
        "settled",
        component_answer(_seeing(gyro, Confounded(("b0", "b1"), (1.0, 1.0), 0.2, False, "", "a rate table"))),
    )
    triad = sensor_result("IMU.ay")
    told = (pair("ay.c_jj", "ax.b2", "|f| = g", "known directions"),
            pair("ax.c_jj", "az.b2", "|f| = g", "known directions"))  # fmt: skip
    columns = tuple(f"ay.{name}" for name in triad.selection.observability.names)
    yield "of a triad", component_answer(_seeing(triad, *told, columns=columns))
    remedies = {"b0": "a centrifuge", "b2": "a rate table", "m_j": "a chamber", "c_kk": "a centrifuge"}
    many = (pair("c_jj", name, f"cause {name}", what) for name, what in remedies.items())
    yield "many causes", component_answer(_seeing(sensor_result(), *many))
    five = (pair("c_jj", name) for name in ("b0", "b2", "m_j", "m_k", "c_kk"))
    yield "five groups", printed(report_page(study_result(_seeing(sensor_result(), *five))))


def checks() -> Sayings:
    lib = library("accelerometer", powers=3, asymmetry=2)
    seen = sensor_result().selection.observability
    yield "alone", printed(terminal_check(SensorCheck("ACC-07", lib, seen)))
    for vif in (math.inf, math.nan, 12.34, 2e6):
        text = printed(terminal_check(SensorCheck("A", lib, replace(seen, vif=np.full(len(lib.terms), vif)))))
        yield f"inflation {vif}", next(line for line in text.splitlines() if line.startswith("b0 "))
    names = tuple(f"{component}.{name}" for component in ("ax", "ay") for name in lib.names)
    tiled = {key: np.tile(getattr(seen, key), 2) for key in ("ratio", "alone", "vif")}
    tested = np.concatenate([~seen.tested, seen.tested])
    group = replace(seen.groups[0], terms=("ay.c_jj", "ax.b2"))
    both = replace(seen, names=names, tested=tested, groups=(group,), **tiled)
    yield "of a triad", printed(terminal_check(SensorCheck("IMU.ay", lib, both)))
    more = {"tested": True, "ratio": 1.0, "alone": 0.1, "vif": 1.0}
    wide = {key: np.append(getattr(seen, key), value) for key, value in more.items()}
    group = replace(seen.groups[0], terms=("b1", "gravity"))
    wide = replace(seen, names=(*seen.names, "gravity"), groups=(group,), **wide)
    extras = tuple(entry.extra for entry in sampled_result().extras)
    yield "with the bench", printed(terminal_check(SensorCheck("ACC-07", lib, wide, extras)))


def titles() -> Sayings:
    sensor = sensor_result()
    selection, names = sensor.selection, sensor.selection.models.candidates.names
    sure = ((names[:3], 0.99), *((names[:k], 1e-6) for k in (0, 1, 2, 4, 5)))
    for best in (sure, ((names[:3], 0.6), (names[:4], 0.3), (names[:2], 1e-4))):
        found = replace(selection, models=replace(selection.models, best=best))
        yield f"best {best[0][1]}", figures.best_models(replace(sensor, selection=found), "k").title
    for low in (0.9999, 0.9):
        terms = tuple(replace(term, inclusion_range=(low, 1.0)) for term in selection.terms)
        found = replace(selection, terms=terms)
        yield f"inclusion from {low}", figures.inclusion(replace(sensor, selection=found), "k").title


def summaries() -> Sayings:
    yield "not converged", printed(report_page(study_result(sampled_result(converged=False))))
    study = replace(study_result(), sessions=(repeatability("b0"),))
    lines = printed(report_page(study), encoding="ascii").splitlines()
    yield "sessions", lines[lines.index("Between sessions") :][:5]


def scenes() -> Sayings:
    found = a_relevance()
    yield "two are enough", requirements(found, "ACC-07")
    short = replace(found, within_budget=False, calibrated=(90.0, 140.0))
    yield "no model is good enough", requirements(short, "ACC-07")
    quiet = replace(found, model=(), terms=found.terms[3:4], noise=(300.0, 0.0, 0.0))
    yield "nothing is needed, and noise is loud", requirements(quiet, "ACC-07")
    for quantity, kind, size in (
        ("output", "accelerometer", 9.80665e-6), ("output", "gyroscope", np.pi / 180.0 / 3600.0),
        ("attitude", "gyroscope", math.radians(1.0)), ("velocity", "gyroscope", 1.0),
    ):  # fmt: skip
        other = replace(found, kind=kind, budget=Budget(quantity, size))
        yield f"budget of 1, {quantity}, {kind}", requirements(other, "X")[0]
    turned = replace(found, kind="gyroscope", budget=Budget("attitude", 1.0), uncompensated=(4.0, 4.5))
    yield "an attitude beyond half a turn", requirements(turned, "X")[2]


def _untold(one: Any) -> Any:
    nothing, pulls = (math.nan,) * 3, np.full_like(one.pulls, np.nan)
    return replace(one, p_value=math.nan, between=nothing, pulls=pulls, exceeds=False)


def sessions() -> Sayings:
    one, steady = repeatability("b0"), repeatability("b1", exceeds=False)
    silent = _untold(repeatability("c_jj"))
    level = level_among([1e-9, 0.41])
    found = tuple(replace(each, level=level) for each in (one, steady, silent))
    yield "one changes, one does not, one is silent", session_sentence(found)
    yield "everything repeats", session_sentence((steady,))
    for share in (0.93, 0.12, math.nan):
        shared = replace(repeatability("b0", units=8), shared=share)
        yield f"shared {share}", session_sentence((shared,))
    yield "of nothing", said([session_section(replace(study_result(), sessions=(silent,)))])
    axes = (repeatability("ax.b0"), repeatability("ay.b0"))
    for case, each in (("axes alone", axes), ("axes under their parameter", (one, *axes, silent))):
        section = [session_section(replace(study_result(), sessions=each))]
        yield case, (said(section), *[row[:1] for row in rows(section)])


def population() -> Sayings:
    found = class_found()
    first, second, third, fourth, *rest = found.terms
    other = replace(third, need=replace(third.need, verdict="not needed"))
    mixed = replace(found, terms=(first, second, other, fourth, *rest))
    yield "axes differ", population_sentences(mixed)
    yield "verdicts of these", [row[1] for row in rows([class_section(mixed, 0)])]
    steady = replace(fourth, spreads=replace(fourth.spreads, p_value=0.9995))
    yield (
        "better than by chance",
        population_sentences(replace(found, terms=(first, second, third, steady, *rest))),
    )
    silent = tuple(term for term in found.terms if term.name in ("c_jj", "c_kk"))
    yield "silent", population_sentences(replace(found, terms=silent, components=("",)))
    once = class_found(sessions=("",))
    for low in (0.1, 0.5):
        nearly = replace(once.terms[1].spreads, unit_to_unit=Share(1.0 * UG, low * UG, 3.01 * UG))
        yield f"spread from {low}", spread_text(replace(once.terms[1], spreads=nearly), "unit_to_unit")
    yield "one session each", (population_sentences(once), said([class_section(once, 0)]))


def cases() -> Sayings:
    one = recovered()
    first, *others = cased(one).sensors
    terms = (replace(t, verdict="needed") if t.name == "b3" else t for t in first.selection.terms)
    first = replace(first, selection=replace(first.selection, terms=tuple(terms)))
    yield "one needs more than the others", case_answer("U0", (first, *others), EQUAL)
    both = (replace(one, run="r0"), replace(one, run="r1"))
    yield "of two runs", case_answer("U0", [replace(s, recovered=both) for s in cased(one).sensors], EQUAL)
    places = (np.arange(one.after.size) + 0.5) / one.after.size
    normal = stats.norm.ppf(places).reshape(one.after.shape)
    for scale in (2.0, 0.5, 1.0):
        found = replace(one, after=scale * normal, fitted=np.ones_like(normal), fresh=2.0 + 0.0 * normal)
        told = said([cases_section(cases_of(cased(found, cases=6)))])
        yield f"six cases, errors {scale} of what is predicted", told
    for size in (1.65e-4, 1.1e-5):
        section = list(angle_sections("U0", [_angled(size)]))
        yield f"misalignments known to {size} rad", (said(section), *rows(section))


def _angled(misalignment: float) -> Any:
    """A component that knows its misalignment against the case so well, in rad, with its case's angles."""
    of = ("accelerometer", "accelerometer", "gyroscopes against accelerometers")
    names = ("rotation_x", "nonorthogonality_xy", "rotation_x")
    sizes = ((1.234e-4, 1.6e-4), (-4.7895e-4, 1.61e-5), (1e-6, 2e-6))
    angles = [
        {"name": name, "of": what, "mean": mean, "sd": sd}
        for name, what, (mean, sd) in zip(names, of, sizes, strict=True)
    ]
    sensor = sensor_result("U0.ax")
    terms = tuple(replace(t, full_sd=misalignment) if t.name == "m_j" else t for t in sensor.selection.terms)
    selection = replace(sensor.selection, terms=terms)
    return replace(sensor, selection=selection, calibration={"angles": angles})


TOPICS: dict[str, Callable[[], Sayings]] = {
    one.__name__: one
    for one in (lots, lots_headlines, fleets, votes, methods, chains, bench, fit, temperature, confounded,
                checks, summaries, scenes, sessions, population,
                cases, titles)
}  # fmt: skip


@pytest.mark.parametrize("topic", TOPICS)
def test_what_is_said_is_what_was_said(topic, golden):
    told = told_of(TOPICS[topic]())
    if topic in ("checks", "summaries"):
        assert max(map(len, told.splitlines())) <= 80
    golden(f"sayings/{topic}.txt", told)


@pytest.mark.parametrize("part", [1.1, 1.3, 1.7, 2.3, 3.1, 4.7, 7.3, 9.1])
def test_of_two_scenes_with_the_same_contrast_the_first_is_named(part):
    result = lot_result()
    classes = []
    for found in result.classes:
        first, second = found.missions
        shares = [Share(*(part * value for value in term.share)) for term in first.terms]
        terms = [replace(term, share=share) for term, share in zip(first.terms, shares, strict=True)]
        classes.append(replace(found, missions=(first, replace(second, terms=tuple(terms)))))
    said = [text for text, _ in lots_answer(replace(result, classes=tuple(classes)))]
    (scene,) = (text for text in said if text.startswith("In the scene"))
    assert scene.startswith("In the scene helicopter ")
