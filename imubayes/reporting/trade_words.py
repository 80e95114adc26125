"""What a trade of speed for accuracy found, in words."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from imubayes.campaign.fidelity import rung_of
from imubayes.ladder.trade.plan import DEFAULT
from imubayes.ladder.trade.recommend import allowed, faults
from imubayes.reporting.rounding import duration, times

if TYPE_CHECKING:
    from imubayes.ladder.trade.record import Place, Traded
    from imubayes.ladder.trade.score import Rate, Score


def trade_answer(found: Traded) -> tuple[str, ...]:
    """The recommendation with its reasons, the span of the ladder, and the place of the default."""
    return (_recommendation(found), *_cheaper(found), _span(found), *_default(found), *_best(found))


def _recommendation(found: Traded) -> str:
    place, score = found.place(found.recommended), found.score(found.recommended)
    name = f"Take {found.recommended} ({rung_of(found.recommended).title})"
    if place is None:
        return f"{name}."
    reasons = faults(place, score, found.floor[0])
    if reasons:
        return f"{name}: no rung is good enough, and it is the best; {' and '.join(reasons)}."
    return f"{name}: the cheapest that is good enough, {seconds_of(place)}; {_good(found, place, score)}."


def _good(found: Traded, place: Place, score: Score | None) -> str:
    """What a rung is good for."""
    if place.rung == found.best:
        floor = f", with a Monte Carlo error of up to {found.floor[0]:.2g} posterior sd"
        off = f"the others are held against it{floor if found.floor[0] > 0.0 else ''}"
    else:
        off = (
            f"no coefficient is off by more than {place.largest:.2g} posterior sd"
            f" ({allowed(found.floor[0]):.2g} is allowed), no inclusion by more than {place.inclusion:.2g}"
        )
    held = f", and its 90 % intervals hold {rate_text(score.coverage)} of the truths" if score else ""
    return off + held


def _cheaper(found: Traded) -> Iterator[str]:
    """Why not a cheaper rung."""
    said = []
    for place in found.places:
        if place.rung == found.recommended:
            break
        wrong = faults(place, found.score(place.rung), found.floor[0])
        if wrong:
            said.append(f"{place.rung} ({seconds_of(place)}): {wrong[0]}")
    if said:
        yield f"Not cheaper: {'; '.join(said)}."


def _span(found: Traded) -> str:
    """How much time, and how much error, lie between the ends."""
    first, last = found.places[0], found.places[-1]
    decades, spent = (math.log10(s / first.seconds) for s in (last.whole_seconds, last.seconds))
    measured = f" ({spent:.1f} measured)" if spent < decades else ""
    return (
        f"From {first.rung} ({seconds_of(first)}) to {last.rung} ({seconds_of(last)}) time grows by"
        f" {decades:.1f} decades{measured}; coefficients of the cheapest are off by"
        f" {first.largest:.2g} posterior sd at most, {first.rms:.2g} rms."
    )


def _default(found: Traded) -> Iterator[str]:
    """The place of what a run takes where nothing is asked."""
    place = found.place(DEFAULT)
    if place is None:
        return
    if found.recommended == DEFAULT:
        yield f"That is what a run takes without being asked{_above(found, place)}."
        return
    wrong = faults(place, found.score(DEFAULT), found.floor[0])
    how = "it is good enough too" if not wrong else wrong[0]
    recommended = found.place(found.recommended)
    ratio = place.whole_seconds / recommended.whole_seconds if recommended else math.nan
    much = "about" if 0.85 < ratio < 1.15 else f"{times(ratio)} times"
    yield (
        f"A run takes {DEFAULT} without being asked: {much} the recommended rung's time; {how}"
        f"{_above(found, place)}."
    )


def _above(found: Traded, place: Place) -> str:
    """What lies above a rung."""
    names = [one.rung for one in found.places]
    above = found.places[names.index(place.rung) + 1 :]
    if not above:
        return ""
    if place.rms <= found.floor[1]:
        gain = "nothing that can be told from Monte Carlo error"
    else:
        gain = f"{place.rms:.2g} posterior sd rms (Monte Carlo error {found.floor[1]:.2g})"
    more = times(above[-1].whole_seconds / place.whole_seconds)
    return f"; {above[-1].rung} would take {more} times as long and change {gain}"


def _best(found: Traded) -> Iterator[str]:
    """What the best rung did not come to."""
    for standing in found.standings:
        for one in standing.measured:
            if one.told.wanting > 1.0:
                yield (
                    f"{standing.subject}: {one.told.rung} ran for {duration(one.seconds)} and has"
                    f" {one.told.ess:,.0f} effective draws ({found.trade.ess:,.0f} are asked for); until its"
                    f" chains count as converged it would take about {duration(one.whole_seconds)}, by the"
                    " measured seconds a step."
                )
        for rung, reason in standing.skipped:
            yield f"{standing.subject}: {rung} was left out: {reason}."
    missing = [one.name for one in found.trade.subjects if one.name not in _subjects(found)]
    if missing:
        yield f"No time was left to measure {', '.join(missing)}: give a larger --limit."
    for name, reason in found.trade.left_out:
        yield f"{name} was left out: {reason}."
    for one in found.trade.subjects:
        if found.trade.repeats and not one.repeatable:
            yield f"{one.name} has no simulated repeats: a run that is read a part at a time is too long."
    if found.dear:
        yield f"Simulated repeats did not afford {', '.join(found.dear)}."


def _subjects(found: Traded) -> set[str]:
    return {one.subject for one in found.standings}


def seconds_of(place: Place) -> str:
    """Wall time of a rung; what is extrapolated says so.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> seconds_of(SimpleNamespace(seconds=60.0, whole_seconds=130.0)), seconds_of(
    ...     SimpleNamespace(seconds=0.02, whole_seconds=0.02)
    ... )
    ('about 2.17 min', '20 ms')
    """
    text = duration(place.whole_seconds)
    return f"about {text}" if place.whole_seconds > 1.01 * place.seconds else text


def rate_text(rate: Rate) -> str:
    """Write a share with its 90 % interval.

    Examples
    --------
    >>> from imubayes.inference.intervals import frequency
    >>> from imubayes.ladder.trade.score import Rate
    >>> rate_text(Rate(18, 20, frequency(18, 20)))
    '90 % (75 to 97 %)'
    """
    if not rate.of:
        return "none"
    share = rate.share
    return f"{100 * share.value:.0f} % ({100 * share.low:.0f} to {100 * share.high:.0f} %)"


def bytes_text(size: float) -> str:
    """Write bytes in MB or GB.

    Examples
    --------
    >>> bytes_text(6.7e6), bytes_text(2.4e9), bytes_text(float("nan"))
    ('6.7 MB', '2.4 GB', '')
    """
    if math.isnan(size):
        return ""
    unit, scale = ("GB", 1e9) if size >= 1e9 else ("MB", 1e6)
    return f"{size / scale:.{0 if size / scale >= 100.0 else 1}f} {unit}"


def error_text(value: float) -> str:
    """Write an error in posterior sd: two digits, and no more than hundredths.

    Examples
    --------
    >>> error_text(1384.0), error_text(11.18), error_text(0.162), error_text(0.0004), error_text(0.0)
    ('1,400', '11', '0.16', '<0.01', '0')
    """
    if math.isnan(value):
        return ""
    if value == 0.0:
        return "0"
    if value < 1.0:
        return "<0.01" if value < 0.005 else f"{value:.2f}"
    return f"{value:.1f}" if value < 9.95 else f"{float(f'{value:.2g}'):,.0f}"
