"""What a fleet says, in sentences made from the numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from imubayes.population.needs import NEEDED, UNTOLD, of_class
from imubayes.reporting.lots_words import class_name
from imubayes.reporting.rounding import (
    NOISE_SI,
    NOISE_UNITS,
    Measured,
    half_up,
    measured,
    per_unit,
    pretty,
)
from imubayes.units import counted

if TYPE_CHECKING:
    from imubayes.inference.intervals import Share
    from imubayes.population.fleet import FleetResult, Pull
    from imubayes.population.records import Broken
    from imubayes.sensors.terms import Library

NAMED = 5
"""Units that a sentence names before it counts."""


def fleet_answer(result: FleetResult) -> tuple[str, ...]:
    """The answer in sentences: how large a unit's model is, what stands out, what could not be read."""
    answer, spec = result.answer, result.study.spec
    mostly = [term.name for term in answer.terms if of_class(term) == NEEDED]
    untold = [term.name for term in answer.terms if of_class(term) == UNTOLD]
    kind = f"{spec.kind}s" if answer.units != 1 else spec.kind
    sentences = [
        f"{answer.units:,} {class_name(result.study.sensor_class)} {kind}: the median unit needs "
        f"{half_up(answer.order.value):.0f} of {counted(len(answer.terms), 'term')} (90 % of the units: "
        f"{half_up(answer.order.low):.0f} to {half_up(answer.order.high):.0f}).",
        f"Needed in half of the units or more: {', '.join(mostly) or 'none'}.",
    ]
    if untold:
        sentences.append(f"The test leaves open in half of the units or more: {', '.join(untold)}.")
    return (*sentences, standing_out(result), *broken_sentence(answer.broken, len(result.study.units)))


def standing_out(result: FleetResult) -> str:
    """Which units are farther from the population than is expected of any."""
    answer, lib = result.answer, result.study.spec.library
    expected = f"beyond {answer.limit:.1f} sd, where one fleet in a hundred has any unit"
    if not answer.outliers:
        return (
            f"No unit stands out from the population ({expected}; the farthest is at {_sd(answer.worst[0])})."
        )
    named = [one for one in answer.worst if one.outlier][:NAMED]
    texts = [f"{one.unit} in {one.term} ({_sd(one)}, {pull_value(one, lib)})" for one in named]
    more = f" and {answer.outliers - len(named)} more" if answer.outliers > len(named) else ""
    stand = f"{counted(answer.outliers, 'unit')} stand{'s' if answer.outliers == 1 else ''}"
    return f"{stand} out from the population ({expected}): {', '.join(texts)}{more}."


def _sd(pull: Pull) -> str:
    return f"{pull.pull:+.1f} sd".replace("-", "−")


def pull_value(pull: Pull, lib: Library) -> str:
    """Value of a unit's term that stands out, in the unit people use."""
    terms = {term.name: (term.printed, per_unit(term.printed, term.unit)) for term in lib.terms}
    printed, size = terms.get(pull.term) or (NOISE_UNITS[lib.kind][0], noise_size(lib, 0))
    return plain(measured(pull.value / size, 0.0, pretty(printed)))


def noise_size(lib: Library, k: int) -> float:
    """SI value of one printed unit of N, B or K."""
    return per_unit(NOISE_UNITS[lib.kind][k], NOISE_SI[lib.kind][k])


def noise_range(found: Share, lib: Library, k: int) -> str:
    """Median of N, B or K and what 90 % of the units have, in data-sheet units."""
    size = noise_size(lib, k)
    value, low, high = (plain(measured(x / size, 0.0)) for x in (found.value, found.low, found.high))
    return f"{value} ({low} to {high}) {pretty(NOISE_UNITS[lib.kind][k])}"


def plain(value: Measured) -> str:
    """Text of a rounded number with a real minus sign."""
    return str(value).replace("-", "−")


def broken_sentence(broken: Sequence[Broken], of: int) -> tuple[str, ...]:
    """Say which units could not be read; nothing where all could.

    Examples
    --------
    >>> from imubayes.population.records import Broken
    >>> broken_sentence([Broken(3, "A4", "A4/t.csv: is empty")], 1000)
    ('1 unit of 1,000 could not be read: A4: A4/t.csv: is empty.',)
    """
    if not broken:
        return ()
    named = "; ".join(f"{one.name}: {one.error}" for one in broken[:NAMED])
    more = f"; and {len(broken) - NAMED} more" if len(broken) > NAMED else ""
    what = counted(len(broken), "unit")
    return (f"{what} of {of:,} could not be read: {named}{more}.",)
