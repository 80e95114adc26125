"""A component in words: its answer, and how the posterior was found: rung, chains, test bench, noise."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator

import numpy as np

from imubayes.algebra.factor import add, with_prior_rows
from imubayes.campaign import Choice, ExtraPosterior, SensorResult
from imubayes.inference.mcmc import Chains
from imubayes.inference.mcmc.ensembles import STILL
from imubayes.inference.reproducibility import DWELL
from imubayes.inference.reproducibility import STILL as STILL_SPREAD
from imubayes.ladder import LADDER
from imubayes.reporting.blocks import Prose, Section, Table
from imubayes.reporting.fit_views import (
    CONDITIONAL,
    fit_sentence,
    found_sentence,
    missing_sentence,
    temperature_sentence,
)
from imubayes.reporting.method_views import unasked_sentences
from imubayes.reporting.result import RungChoice, published
from imubayes.reporting.rounding import duration, minus, on_output, percent, pretty, share, signed, sized
from imubayes.reporting.rows import MARKS, labels, sentence, shortened
from imubayes.rig.bench import KINDS, LACK, OFFSET, for_sensor
from imubayes.rig.checks import faults
from imubayes.selection.verdicts import NEEDED, NOT_NEEDED, STRAINED, listed
from imubayes.sensors.imu import COMPONENTS
from imubayes.units import counted

MOST_DWELLS = 4
"""Runs that a sentence names."""

MOST_STRAINED = 3
"""Terms that the sentence on a disagreement names."""

FEW_DIGITS = 3
"""Digits below which rounding reaches what the report prints."""

MOST_BENCH = 24
"""Errors of the test bench that a report lists: those that the data say most of."""

NOT_ASKED = (
    "Left out for the sake of time: the residual checks, the other methods, and the search for what the"
    " library lacks."
)
"""What no rung does, and a run without budget does."""

PLOTS = (
    "ArviZ draws traces, ranks and pairs of the draws, as by"
    ' arviz.plot_trace(arviz.from_netcdf("posterior.nc")).'
)

BENCH = (
    "Each is in every model under its own prior, so that what it may do to the coefficients is in their"
    " error bars. Where the sd after the test is that before it, the test says nothing of it."
)


def component_answer(sensor: SensorResult) -> tuple[str, ...]:
    """First paragraph on a component by sentence: needed, how that was found, what is not, does it fit."""
    needed = [term.name for term in sensor.selection.terms if term.verdict == "needed"]
    counts = Counter(term.verdict for term in sensor.selection.terms)
    others = [word for word in MARKS if counts[word] and word != "needed"]
    others = [f"{counts[word]} {'is' if counts[word] == 1 else 'are'} {word}" for word in others]
    kind = f"{sensor.kind}, class {sensor.class_id}" if sensor.class_id else f"{sensor.kind}, no class given"
    are = "is" if len(needed) == 1 else "are"
    count = f"{len(needed)} of {counted(len(sensor.selection.terms), 'term')} {are} needed"
    sentences = (
        unconverged_sentence(sensor),
        strain_sentence(sensor),
        temperature_sentence(sensor),
        f"{sensor.id} ({kind}): {count}{f': {listed(needed)}' if needed else ''}.",
        CONDITIONAL if sensor.conditional else "",
        method_sentence(sensor),
        f"{listed(others)}." if others else "",
        bias_sentence(sensor),
        reproducibility_sentence(sensor),
        export_sentence(sensor),
        distrust_sentence(sensor),
        *map(sentence, faults((run.name, run.procedure, run.source) for run in sensor.runs)),
        fit_sentence(sensor),
        digits_sentence(sensor),
        *choice_sentences(sensor.choice),
        *(unasked_sentences(sensor.panel.unasked) if sensor.panel else ()),
        missing_sentence(
            sensor.misfit,
            fits=all(check.fits for check in sensor.checks),
            assumed=[run.name for run in sensor.runs if run.found.origin in ("white", "given")],
        ),
    )
    return tuple(filter(None, sentences))


def method_sentence(sensor: SensorResult) -> str:
    """Say how the posterior was computed, and why so; empty where nothing was chosen."""
    if not sensor.method_reason or sensor.choice is not None:
        return ""
    how = f"{sensor.method} ({LADDER[sensor.method][0]})"
    return sentence(f"Posterior: {how}, because {sensor.method_reason}")


def unconverged_sentence(sensor: SensorResult) -> str:
    """Say that the chains cannot be trusted yet; empty where they can, or where there are none."""
    if sensor.chains is None or sensor.chains.diagnostics.converged:
        return ""
    mixing = sensor.chains.diagnostics
    why = mixing.text.removeprefix("not converged").lstrip(": ")
    remedy = "continue with --resume, or give more time"
    if STILL in mixing.text:  # more steps don't help
        remedy = "hold the noise at its estimate by --method plug-in"
    elif sensor.choice is not None:  # chains of a rung that was chosen are not kept
        longer = sensor.choice.budget is not None
        remedy = "give a larger --budget" if longer else "give a longer --time-limit"
    return (
        f"{sensor.id}: the chains have not converged{f' ({why})' if why else ''}."
        f" What rests on them is the estimate so far: {remedy}."
    )


def strain_sentence(sensor: SensorResult) -> str:
    """Say where the data contradict the prior: first of all, it is a wrong sign or unit."""
    strained = sorted((t for t in sensor.selection.terms if t.strain > STRAINED), key=lambda t: -t.strain)
    if not strained:
        return ""
    worst = listed(f"{t.name} lies {t.strain:,.0f} prior sd from zero" for t in strained[:MOST_STRAINED])
    return (
        f"{sensor.id}: data and prior disagree: {worst}. Check the sign and the unit of inputs and output,"
        " and that no input column is missing; if this is how the unit is, give [sensor.prior]."
    )


def digits_sentence(sensor: SensorResult) -> str:
    """Say where rounding leaves fewer digits than the report prints."""
    digits = sensor.selection.digits
    if digits is None or min(digits.coefficients, digits.sd, digits.inclusion) >= FEW_DIGITS:
        return ""
    left = counted(digits.coefficients, "digit")
    return (
        f"The arithmetic is sure to leave {left} of every coefficient, beside the larger of its size and sd,"
        f" {digits.sd} of every sd and {digits.inclusion} of the inclusions: bounds for the worst term, which"
        " say little of the others. Averages over the most probable models alone, columns that are all but"
        " alike, or noise far below what the output resolves do that."
    )


MODELS = {
    "full": "with every tested term",
    "needed": "with the terms that the data ask for and resolve",
    "basic": "with bias, scale and misalignment",
}
"""What each model keeps that may be exported."""


def export_sentence(sensor: SensorResult) -> str:
    """What each model that may be exported makes of dwells that were left out; empty where none was."""
    if not sensor.compensations:
        return ""
    best = sensor.compensations[0]
    errors = listed(
        f"{MODELS[compensation.model]} {on_output(compensation.held_out, sensor.kind)} rms"
        for compensation in sensor.compensations
    )
    return (
        f"Predicting each of {counted(best.positions, 'position')} from all others leaves {errors}."
        " The first is what imubayes export writes."
    )


STRAYED = 2.6
"""Sds of a random walk beyond which a drift is none: chance takes one of a hundred so far, were K known, and
fewer where K is fitted to the same drift."""


def bias_sentence(sensor: SensorResult) -> str:
    """Which bias b0 is, where a random walk of the noise moves it by more than the error bars; else empty."""
    if sensor.bias is None or abs(sensor.bias.drift[0]) < max(sensor.bias.drift[1], sensor.bias.mean[1]):
        return ""
    start, mean, end, drift = (
        str(on_output(size, sensor.kind, sd))
        for size, sd in (sensor.bias.start, sensor.bias.mean, sensor.bias.end, sensor.bias.drift)
    )
    told = (
        f"b0 walks with the noise, and is the mean over the record, {mean}: {start} at its start, {end} at"
        f" its end, a drift of {drift}."
    )
    strays = abs(sensor.bias.drift[0]) / sensor.bias.walk
    if strays < STRAYED:
        return told
    usual = on_output(sensor.bias.walk, sensor.kind)
    return (
        f"{told} A random walk that fits the steps between strays {usual} (1 sd) in that time, and this is"
        f" {strays:.1f} sd, as {share(math.erfc(strays / math.sqrt(2.0)))} of walks do: more likely a warm-up"
        " or a change of temperature. Let the sensor warm up, or record T and give its library temperature"
        " = 1."
    )


def distrust_sentence(sensor: SensorResult) -> str:
    """Say how many dwells the robust analysis holds for contaminated, and where."""
    count = len(sensor.distrusted)
    if not count:
        return ""
    by_run = Counter(dwell.run for dwell in sensor.distrusted)
    where = [f"{number} in {run}" for run, number in by_run.items()][:MOST_DWELLS]
    rest = "" if len(by_run) <= MOST_DWELLS else " and elsewhere"
    dwells = "dwell is" if count == 1 else "dwells are"
    return f"{count} {dwells} not trusted ({', '.join(where)}{rest}): the fit goes on without them."


def choice_sentences(choice: Choice | None) -> tuple[str, ...]:
    """Say which rung was taken and why, what it gave up, and what the next one would change."""
    if choice is None:
        return ()
    title, leaves_out = LADDER[choice.rung]
    taken = f"Method: {title}{_why(choice)}."
    gave_up = f"It {leaves_out}" if leaves_out else ""
    climbed = ""
    if len(choice.climbed) > 1:
        (below, *_), (name, coefficients, inclusions) = choice.climbed[-2:]
        climbed = (
            f"The step from {below} to {name} changed coefficients by up to {coefficients:.2g} posterior sd"
            f" and inclusions by up to {inclusions:.2g}."
        )
    coefficients, inclusions = choice.next_change
    after = sentence(choice.next_reason[:1].upper() + choice.next_reason[1:])
    if choice.next_rung is not None:
        title, seconds = LADDER[choice.next_rung][0], duration(choice.next_seconds)
        after = (
            f"The next rung ({title}) would take about {seconds} and change coefficients by up to about"
            f" {coefficients:.1g} posterior sd and inclusions by about {inclusions:.1g} (foreseen by"
            f" {choice.next_reason})."
        )
    return tuple(filter(None, (taken, gave_up, climbed, after, NOT_ASKED)))


def _why(choice: Choice) -> str:
    took = duration(choice.seconds)
    if choice.accuracy is not None:
        missed = f"the last that there is: {choice.asked} was not reached ({took})"
        return f", reached {choice.asked} ({took})" if choice.met else f", {missed}"
    if choice.budget is None:
        return f", as asked ({took})"
    if choice.foreseen > choice.budget:
        return f", the cheapest: none fits {choice.asked} (it took {took})"
    if not choice.met:
        return f", the best that was foreseen to fit {choice.asked}; it took longer, {took}"
    return f", the best that fits {choice.asked} ({took})"


def published_choice(choice: Choice | None) -> RungChoice | None:
    """Publish the same."""
    return choice and published(
        RungChoice,
        choice,
        foreseen_seconds=choice.foreseen,
        next=choice.next_rung
        and (choice.next_rung, choice.next_seconds, *choice.next_change, choice.next_reason),
    )


def chain_sections(sensor: SensorResult) -> Iterator[Section]:
    """Diagnostics of the chains; nothing for the exact method."""
    if sensor.chains is not None:
        yield Section("The chains", [Prose((diagnoses(sensor, sensor.chains), PLOTS), "note")])


def diagnoses(sensor: SensorResult, chains: Chains) -> str:
    """How well the chains mixed, and what evidence they give."""
    mixing, (value, sd) = chains.diagnostics, chains.log_evidence
    low, high = int(mixing.ess.argmin()), int(mixing.rhat.argmax())
    least, most = (re.sub(r"^([NBK])\.", r"\1 of ", mixing.parameters[k]) for k in (low, high))
    noisy, exact = set(mixing.parameters) - set(chains.names), exact_evidence(sensor)
    held = "the bridge is lower by what the noise's prior costs" if noisy else "the bridge must agree"
    at = "estimated" if noisy else "given"
    closed = "" if exact is None else f"; {minus(f'{exact:.2f}')} in closed form at the {at} noise: {held}"
    return (
        f"{mixing.ensembles} ensembles of {mixing.walkers} walkers, {mixing.steps:,} steps each:"
        f" {mixing.text}; {mixing.seconds:.1f} s. Smallest effective sample size {mixing.ess[low]:,.0f}"
        f" ({least}), largest R-hat {mixing.rhat[high]:.3f}"
        f" ({most}), longest autocorrelation time {mixing.tau.max():.3g} steps,"
        f" {percent(mixing.acceptance)} of the proposals accepted, log density interpolated to"
        f" {chains.interpolation_error:.2g} nats. Log evidence of the full library"
        f"{', averaged over the prior of the noise' if noisy else ''}: {minus(f'{value:.2f}')} ± {sd:.2f} by"
        f" bridge sampling{closed}."
    )


def exact_evidence(sensor: SensorResult) -> float | None:
    """Log evidence of the data under the full library and the noise that whitened the runs, in closed form.

    With A the whitened rows in units of the prior's sds, y the whitened response and W the whitening,
    ``-2 ln p(y) = n ln(2 pi) - ln det W'W + ln det(I + A'A) + |y|^2 - |projection of y|^2``. None for a
    component of a triad, whose rows hold the other components too.
    """
    selection = sensor.selection
    sd = {column: term.prior_sd for column, term in zip(selection.columns, selection.terms, strict=True)}
    sd |= {entry.extra.name: entry.extra.sd for entry in sensor.extras}
    whole = add(*(run.factor for run in sensor.runs))
    if not set(whole.names) <= sd.keys():
        return None
    scale = np.array([sd[name] for name in whole.names])
    R = with_prior_rows(whole.R * np.append(scale, 1.0), np.ones(len(scale)))
    log_det = 2.0 * float(np.sum(np.log(np.abs(np.diag(R)[:-1]))))
    return -0.5 * (whole.n * math.log(2.0 * math.pi) + whole.log_det + log_det + float(R[-1, -1]) ** 2)


def bench_sections(sensor: SensorResult) -> Iterator[Section]:
    """Errors of the test bench in printed units; of many, those that the data narrow most."""
    bench, known = own_errors(sensor), labels(sensor)
    told = sorted(bench, key=lambda entry: entry.sd / entry.extra.sd)[:MOST_BENCH]
    rows = []
    for entry in (entry for entry in bench if any(entry is error for error in told)):
        extra, partners = entry.extra, dict.fromkeys(known.get(name, name) for name in entry.partners)
        prior, value = signed(sized(extra, extra.sd)), signed(sized(extra, entry.mean, entry.sd))
        others = minus(shortened(tuple(partners)))
        rows.append((extra.text, f"± {prior}", value, pretty(extra.printed), others))
    left = len(bench) - len(rows)
    more = f" {left} more, of which the test says less, are in result.json." if left else ""
    if rows:
        head = ("error", "± sd before", "value ± sd after", "unit", "confounded with")
        table = Table(f"Errors of the test bench of {sensor.id}", head, rows, "wnntw", f"{BENCH}{more}")
        yield Section("Errors of the test bench", [table])


def reproducibility_sentence(sensor: SensorResult) -> str:
    """Say how far mounts and dwells differ, and what the library lacks; empty where neither is told."""
    told, inputs = [], dict[str, None]()
    for spread in sensor.spreads:
        head, _, where = spread.kind.partition(".")
        if head == LACK:
            inputs[where.partition("^")[0]] = None
            continue
        error = for_sensor(KINDS.get(head, KINDS[OFFSET]), sensor.kind)  # else it is of the output
        size = sized(error, spread.mean, spread.sd)
        if head in (DWELL, STILL_SPREAD):
            told.append(f"the {head}s of run {where} differ by {size} (sd) beyond the noise of their samples")
        else:
            told.append(f"the {error.text} differs between mounts by {size} (sd)")
    said = [f"As the data tell it, {listed(told)}."] if told else []
    if sensor.absorbed is not None and inputs:
        beside = f"functions of {listed(inputs)} stand beside the terms, and what they could explain is open"
        shown = found_sentence(sensor.absorbed, sensor.kind)
        said.append(f"By itself the library does not explain the data: {beside}. {shown}")
    return " ".join(said)


def own_errors(sensor: SensorResult) -> list[ExtraPosterior]:
    """Errors of the test bench without those of other components of the case, which end in their names."""
    own = sensor.id.rpartition(".")[2]
    bench = [entry for entry in sensor.extras if not entry.extra.kind.startswith(f"{LACK}.")]
    others = set(COMPONENTS) - {own} if own in COMPONENTS else set()
    return [entry for entry in bench if entry.extra.name.rpartition(".")[2] not in others]


def change_sections(sensor: SensorResult) -> Iterator[Section]:
    """Effect of the uncertain noise on inclusion; nothing without averages."""
    each = zip(sensor.selection.terms, sensor.selection.plug_in or (), strict=False)
    both = [(term.name, plug_in, term.inclusion) for term, plug_in in each]
    if not both:
        return
    levels = (NOT_NEEDED, 0.5, NEEDED)
    crossing = [name for name, *ends in both if len({sum(x >= level for level in levels) for x in ends}) > 1]
    first, before, after = max(both, key=lambda moved: abs(moved[2] - moved[1]))
    who = f"{listed(crossing)} cross{'es' if len(crossing) == 1 else ''}" if crossing else "none crosses"
    said = (
        "Averaged over the uncertain noise, no inclusion probability moves by more than"
        f" {abs(after - before):.3f} ({first}); {who} 0.05, 0.5 or 0.95."
    )
    yield Section("Inclusion with uncertain noise", [Prose(said)])
