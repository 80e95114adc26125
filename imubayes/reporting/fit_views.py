"""What the residuals say of a component, in words and as blocks of its report."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator

from imubayes.campaign import SensorResult
from imubayes.inference.misfit import TIME, Misfit
from imubayes.inference.residuals import OFF, SUSPECT, ResidualCheck
from imubayes.reporting import figures
from imubayes.reporting.blocks import Block, Figure, Prose, Section, Table, quiet
from imubayes.reporting.rounding import in_unit, on_output, probability, probable, times
from imubayes.reporting.rows import fit_scale, off_floor
from imubayes.selection.verdicts import listed
from imubayes.sensors.terms import Kind
from imubayes.units import counted

MOST_CURVE_POINTS = 9000
"""Points over all curves of a report, so that it stays below 2 MB."""

MOST_RUNS, MOST_RUNS_OF_MANY = 8, 1
"""Runs whose residuals are drawn: of one or two components, and of each of more."""

MOST_DEPENDENCES = 3
"""Inputs against which a misfit is drawn: the worst."""

MOST_DWELLS = 40
"""Dwells that a report lists, worst first."""

WITHIN = math.erf(math.sqrt(2.0))
"""Share of normal errors within 2 sd."""

CHANCE = 1e-3
"""Probability from which chance explains how many lie there: errors of one fit are not independent."""

FEW = 3
"""Places that a sentence, or blocks that a cell, names."""

HEAD = (
    "run", "residual over noise", "white, p", "normal, p", "sample by sample", "stands out", "fits",
)  # fmt: skip

RESIDUALS = (
    "Time: each dot is a block of samples in units of the sd that the noise gives it; the band is ± 2 sd."
    " Autocorrelation: sticks inside the band are white noise. Allan deviation: dots are the residuals,"
    " the line is the noise model."
)

MISFIT = (
    "What the residuals hold beyond the library, with ± 2 sd, where the input has that value; ▲ while it"
    " rises, ▼ while it falls, where that matters; p is corrected for the number of inputs that were"
    " looked at and for the other residual tests of the study, and says something below 0.01."
)

DWELLS = (
    "Each is more likely contaminated than not, by a knock, a wrong position or a spike; the fit goes on"
    " without it."
)

CONDITIONAL = (
    "Every verdict is conditional: the data reject the model, and what it lacks may pass for a term. An"
    " export needs --accept-misfit."
)


def fit_sentence(sensor: SensorResult) -> str:
    """Say whether the model explains the data, and name the runs that it does not."""
    if not sensor.checks:
        return ""
    misfits = [check for check in sensor.checks if not check.fits]
    level, most = sensor.checks[0].level, f"{100.0 * SUSPECT:.0f} % of studies at most"
    alarm = f"Tests alarm below p {level:.1g}, so that chance alone makes {most} do so."
    if not misfits:
        if math.isnan(scale := fit_scale(sensor)):
            return (
                "Whether the model explains the data, the few degrees of freedom beside the fit cannot tell."
            )
        p = min((c.whiteness_p for c in sensor.checks if not math.isnan(c.whiteness_p)), default=math.nan)
        white = "" if math.isnan(p) else f", white, p {probability(p)}"
        size = f"residual over noise {scale:.2f}{white}"
        return f"The model explains the data to the noise floor ({size}). {alarm}"
    named = []
    for check in misfits:
        said = [] if math.isnan(check.scale) else [f"residual over noise {check.scale:.2f}"]
        if not math.isnan(check.whiteness_p):
            p = probability(check.whiteness_p)
            p = p.replace("<", "< ") if p.startswith("<") else f"= {p}"
            said.append(f"{'' if check.white else 'not '}white, p {p}")
        if count := len(check.outliers):
            far = max(abs(size) for _, _, size in check.outliers)
            stand = f"stand{'s' if count == 1 else ''}"
            said.append(f"{counted(count, 'block')} {stand} out by up to {far:.0f} sd")
        named.append(f"{check.run} ({', '.join(said)})")
    runs = f"{'run' if len(misfits) == 1 else 'runs'} {listed(named)}"
    return f"The model does not explain {runs}: {_consequence(sensor, misfits)} {alarm}"


def held(inside: int, of: int) -> str:
    """Say how many of `of` errors should lie within 2 sd where chance does not explain how many do.

    >>> held(444, 504), held(480, 504)
    (' (481 expected: they are larger than predicted)', '')
    >>> held(500, 504)
    ' (481 expected: they are smaller than predicted)'
    """
    from scipy.stats import binomtest

    if binomtest(inside, of, WITHIN).pvalue >= CHANCE:
        return ""
    size = "larger" if inside < WITHIN * of else "smaller"
    return f" ({WITHIN * of:.0f} expected: they are {size} than predicted)"


def _consequence(sensor: SensorResult, misfits: list[ResidualCheck]) -> str:
    """What misfits mean; of the error bars, what errors of known quantities say where there are some."""
    own = [
        recovered
        for recovered in sensor.recovered
        if (recovered.what == "gravity") == (sensor.kind == "accelerometer")
    ]
    inside, of = sum(recovered.inside for recovered in own), sum(recovered.after.size for recovered in own)
    stated = "{} times what the study states of {}".format
    if wrong := [
        stated(times(tested.misstated), tested.run) for tested in misfits if tested.misstated != 1.0
    ]:
        return f"by its samples the noise is {listed(wrong)}; state it anew, or leave it to be estimated."
    known, told, errors = "", held(inside, of) if of else "", "errors of known quantities"
    if told:
        bars = "too small" if "larger" in told else "wider than they need be"
        known = f"and the error bars are {bars}: {inside} of {of} {errors} lie within 2 sd{told}"
    elif of:
        known = f"and the {errors} are as predicted: {inside} of {of} lie within 2 sd"
    if any(not check.white or check.scale > 1.0 + OFF for check in misfits):
        until = known or "until that is settled the error bars are too small"
        wrong = "either the library misses something there or the noise model is wrong"
        return f"{wrong}; {until}. The residuals show where."
    if any(check.scale < 1.0 - OFF for check in misfits):
        wider = known or "so the error bars are wider than they need be"
        return f"the noise is weaker than its model there, {wider}."
    return f"chance makes no such blocks; look at what happened then{'; ' if known else ''}{known}."


def check_blocks(sensor: SensorResult, *, drawn: bool) -> Iterator[Block]:
    """Verdict on the fit of each run, in words and numbers."""
    yield Prose(fit_sentence(sensor))
    rows = []
    for check in sensor.checks:
        out = [f"{first:.4g} to {last:.4g} s ({abs(size):.1f} sd)" for first, last, size in check.outliers]
        more = [f"and {len(out) - FEW} more"] if len(out) > FEW else []
        samples = quiet(f"{check.sample_scale:.2f}, p {probability(check.sample_whiteness_p)}")
        p = probability(check.whiteness_p), probability(check.normality_p)
        said = ", ".join([*out[:FEW], *more]) or "nothing"
        fits = "✓ yes" if check.fits else "✗ no"
        size = "not told" if math.isnan(check.scale) else f"{check.scale:.2f}"
        rows.append((check.run, size, *p, samples, said, fits))
    yield Table(f"Residual checks of {sensor.id}", HEAD, rows, "tnnnntt")
    if drawn and sensor.checks:
        yield Prose(
            "Residuals under the full library, whitened by each run's noise: their rms over blocks of"
            " samples is 1 at the noise floor. A run fits when its blocks are of that size, white (p"
            f" above {sensor.checks[0].level:.1g}) and none stands out. All residual tests of the study"
            " share one level: if its models are right, one study in a hundred gives any false alarm."
            " Sample by sample the same two tests show the sensor's own filter and quantisation, which"
            " need not touch the coefficients.",
            "note",
        )


def residual_blocks(sensor: SensorResult, key: str, sensors: int) -> Iterator[Block]:
    """Residuals of each run over time, their autocorrelation and their Allan deviation."""
    most = MOST_RUNS if sensors <= 2 else MOST_RUNS_OF_MANY
    worst = sorted(sensor.checks, key=lambda check: (check.fits, -off_floor(check.scale)))
    runs = [check for check in sensor.checks if any(check is tested for tested in worst[:most])]
    points = max(60, min(figures.MOST_POINTS, MOST_CURVE_POINTS // max(sensors * len(runs), 1)))
    if 0 < len(runs) < len(sensor.checks):
        drawn = "the run" if len(runs) == 1 else f"the {len(runs)} runs"
        fits = "fits" if len(runs) == 1 else "fit"
        yield Prose(f"Drawn below: {drawn} of {len(sensor.checks)} that {fits} worst.", "note")
    for n, check in enumerate(runs):
        panels = (
            figures.over_time(check, f"{key}r{n}t", points),
            figures.autocorrelation(check, f"{key}r{n}c"),
            figures.allan(check, sensor.kind, f"{key}r{n}a"),
        )
        yield Section(check.run, [Figure([panel for panel in panels if panel])])
    yield Prose(RESIDUALS, "note")


def misfit_sections(sensor: SensorResult, key: str, *, drawn: bool) -> Iterator[Section]:
    """What the residuals hold that the library does not, drawn against its input; nothing if not looked for.

    Where nothing is found, the input against which most is left is drawn.
    """
    misfit = sensor.absorbed or sensor.misfit
    if misfit is None:
        return
    sentences = (found_sentence(misfit, sensor.kind), candidate_sentence(misfit), predictive_sentence(misfit))
    blocks: list[Block] = [Prose(" ".join(filter(None, sentences))), Prose(nothing_sentence(misfit))]
    found, tested = ([one for one in some if one.run] for some in (misfit.found, misfit.dependences))
    shown = (found[:MOST_DEPENDENCES] or tested[:1]) if drawn else ()
    if shown:
        left = len(found) - len(shown)
        more = f" {left} more are in result.json." if left > 0 else ""
        panels = [
            figures.dependence(dependence, sensor.kind, f"{key}m{n}") for n, dependence in enumerate(shown)
        ]
        blocks.append(Figure(panels, f"{MISFIT}{more}"))
    yield Section("Does the library miss something?", blocks)


def nothing_sentence(misfit: Misfit) -> str:
    """Name the inputs against which nothing is left; one that goes with another is not among them."""
    shown, tested = {dependence.channel for dependence in misfit.found}, dict[str, float]()
    for dependence in misfit.dependences:
        tested[dependence.channel] = min(dependence.p, tested.get(dependence.channel, math.inf))
    called = {TIME: "time", "": "any further term"}
    free = [
        f"{called.get(name, name)} (p {probability(p)})"
        for name, p in tested.items()
        if p >= SUSPECT and name not in shown
    ]
    return f"Nothing is left beyond chance against {listed(free)}." if free else ""


def found_sentence(misfit: Misfit, kind: Kind) -> str:
    """Say in printed units where the residuals show that something is missing, or that nothing is."""
    if not misfit.found:
        return misfit.text
    shows = [f"{dependence.where} ({on_output(dependence.size, kind)} rms)" for dependence in misfit.found]
    return f"There is something the library does not contain: it shows in {'; '.join(shows)}."


def candidate_sentence(misfit: Misfit) -> str:
    """Say with which options of its library a study has the terms that were found; empty where none were."""
    terms = [one.input for one in misfit.found if not one.run]
    if not terms:
        return ""
    options = listed(dict.fromkeys(option_of(name) for name in terms))
    are = "a candidate" if len(terms) == 1 else "candidates"
    return f"With {options} in its library {listed(terms)} would be {are}."


def option_of(term: str) -> str:
    """Option of a library that has a term which another one lacks."""
    name, _, heat = term.partition("*")
    if heat == "dT":
        return f'rate_of = ["{name}"]'
    if heat:
        return f'temperature = {heat[1:] or 1} and temperature_of = ["{name}"]'
    if name[0] == "b":
        return f"{'asymmetry' if name.endswith('p') else 'powers'} = {name[1:].rstrip('p')}"
    return 'set = "extended"'


def predictive_sentence(misfit: Misfit) -> str:
    """Say whether runs that the posterior predicts would leave residuals of the size of those seen."""
    known = {run: p for run, p in misfit.predictive_p.items() if math.isfinite(p)}
    if not known:
        return ""
    odd = [
        f"{run} (p {probable(p)})" for run, p in known.items() if not misfit.level < p < 1.0 - misfit.level
    ]
    if odd:
        return f"Replicated by the posterior, residuals would be of another size in {listed(odd)}."
    ends = " to ".join(dict.fromkeys(f"{p:.2f}" for p in (min(known.values()), max(known.values()))))
    return f"Replicated by the posterior, residuals are of the size of those seen (p {ends})."


def missing_sentence(misfit: Misfit | None, *, fits: bool, assumed: Collection[str] = ()) -> str:
    """Say in the first paragraph that the library misses something; empty where it does not."""
    if misfit is None or not misfit.found:
        return ""
    where = list(dict.fromkeys(dependence.where for dependence in misfit.found))
    more = f" and {len(where) - FEW} more" if len(where) > FEW else ""
    yet = "Yet the" if fits else "The"
    said = (
        f"{yet} data hold something the library does not contain: it shows in {'; '.join(where[:FEW])}{more}."
    )
    if any(dependence.run in assumed for dependence in misfit.found):
        return f"{said} Or the noise that was assumed is wrong: let it be estimated."
    return said


def temperature_sentence(sensor: SensorResult) -> str:
    """Answer whether a polynomial in temperature is enough; empty where none was tested."""
    misfit = sensor.absorbed or sensor.misfit
    tested = [t.name.partition("*")[2] for t in sensor.selection.terms if t.verdict != "untested"]
    degree = max((int(power[1:] or 1) for power in tested if power[:1] == "T"), default=0)
    if misfit is None or not degree or all(dependence.channel != "T" for dependence in misfit.dependences):
        return ""
    beside = " beside its rate" if any(power.startswith("dT") for power in tested) else ""
    model = f"a polynomial of degree {degree} in T{beside}"
    left = [one for one in misfit.found if one.channel in ("T", "dT") or "*" in one.input]
    if not left:
        return f"{sensor.id}: {model} is enough: nothing is left against T or its rate beyond chance."
    shows = listed(
        f"{on_output(dependence.size, sensor.kind)} rms in {dependence.where}" for dependence in left
    )
    return f"{sensor.id}: {model} is not enough: it leaves {shows}."


def dwell_sections(sensor: SensorResult) -> Iterator[Section]:
    """Dwells that are not trusted, in printed units."""
    rows = []
    for dwell in sensor.distrusted[:MOST_DWELLS]:
        chance = "> 99.9 %" if dwell.probability > 0.999 else f"{100.0 * dwell.probability:.1f} %"
        off = in_unit(on_output(dwell.offset, sensor.kind, dwell.sd))
        rows.append((dwell.run, f"{dwell.start:.6g}", f"{dwell.stop:.6g}", chance, off))
    left = len(sensor.distrusted) - len(rows)
    more = f" {left} more are in result.json." if left else ""
    if rows:
        head = ("run", "from, s", "to, s", "contaminated with", "off by")
        table = Table(f"Dwells of {sensor.id} that are not trusted", head, rows, "tn", f"{DWELLS}{more}")
        yield Section("Dwells that are not trusted", [table])
