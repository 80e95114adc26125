"""What a test can tell: combinations of terms that the factor does not see."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import Factor, invert_triangular
from imubayes.rig.bench import EARTH, HEADS, LACK, SHORTENING, TILT, kind_of
from imubayes.rig.inputs import Facts
from imubayes.rig.plans import EARTH_RATE
from imubayes.sensors.imu import COMPONENTS
from imubayes.units import STANDARD_GRAVITY

VISIBLE = 3.0
"""Effect, in noise sd over the whole test, from which a column counts as visible by itself."""

UNSEEN = 1.0
"""Effect of a prior-sized combination, in noise sd, below which the data say less of it than the prior."""

SHARE = 0.1
"""Smallest share of the largest contribution to a cancellation that makes a term part of it, and of a term's
posterior sd that makes it part of what an error of the test bench hides."""

ROUNDING = 1e-4
"""Residual of a cancellation, relative to the columns, that the few decimals of a rig's inputs explain."""

CANCELLED = 1e-7
"""Singular value, relative to the largest, below which columns cancel: rounding, and small angles times small
angles where a case is linearised, leave up to 1e-8."""

PIVOT = 0.05
"""Smallest entry of a unit vector that the elimination divides by, while there is a larger one elsewhere."""

TAKES_PART = 0.03
"""Smallest share of the largest contribution that makes a term part of an exact cancellation: a misalignment
of 30 mrad drags others in at less."""

LOCAL = 0.01
"""Share by which gravity, or a rate told in few decimals, may differ from the standard value and be it."""


@dataclass(frozen=True, slots=True)
class Confounded:
    """Terms, in the order of the model equation, that this test sees only in combination.

    Attributes
    ----------
    direction : change of each term's coefficient (SI) along the combination, largest effect scaled to 1.
    seen : posterior sd over prior sd along the direction under the full library; 1 is not seen at all.
    exact : whether the columns cancel to rounding, and not merely below the noise.
    reason : in words, such as "|f| = g in every row"; empty where none is known.
    remedy : the cheapest run that separates them, in words.
    """

    terms: tuple[str, ...]
    direction: tuple[float, ...]
    seen: float
    exact: bool
    reason: str
    remedy: str


@dataclass(frozen=True, slots=True, eq=False)
class Observability:
    """What a test can tell of each of the p terms of the library.

    Attributes
    ----------
    tested : (p,) bool, whether the column was excited at all.
    ratio : (p,) posterior sd over prior sd under the full library.
    alone : (p,) the same if every other term were known.
    vif : (p,) variance inflation by the others, (sd / sd alone)^2; inf in a cancellation, NaN if untested.
    groups : combinations that are not seen.
    """

    names: tuple[str, ...]
    tested: NDArray[np.bool_]
    ratio: FloatArray
    alone: FloatArray
    vif: FloatArray
    groups: tuple[Confounded, ...]

    @property
    def excited(self) -> tuple[str, ...]:
        """Names of the columns that are tested."""
        return tuple(name for name, tested in zip(self.names, self.tested, strict=True) if tested)

    def partners(self, name: str) -> tuple[str, ...]:
        """Terms that `name` is confounded with, in the order of the model equation.

        Exact cancellations that share a term add up to others, so all their terms are confounded with each
        other, whichever basis of the null space `groups` happens to be. An error of the test bench that hides
        two terms does not make them partners, and the tilt that is allowed for beside a rotation in the
        fixture is none, nor what stands for what the library lacks.
        """
        together = {name}
        for _ in self.groups:
            shared = {name, *(term for term in together if not _bench(term))}
            for group in self.groups:
                if group.exact and not shared.isdisjoint(group.terms):
                    together.update(group.terms)
        together.update(*(group.terms for group in self.groups if name in group.terms))
        together -= {name, *(other for other in together if _bench(other) in (TILT.name, LACK))}
        return tuple(other for other in self.names if other in together)


def observe(
    factor: Factor,
    sd: FloatArray,
    facts: Facts,
    *,
    scale: float = 1.0,
    reach: Mapping[str, float] | None = None,
) -> Observability:
    """What a test can tell of each term.

    Columns are scaled to the effect of a prior-sized coefficient in noise units, so a singular value d is
    what the test says of a combination against what the prior says: sd over prior sd is ``1/sqrt(1 + d^2)``.
    Exact cancellations are always reported; others if d < 1 and at least two terms would be visible alone.

    Parameters
    ----------
    factor : of the whitened rows; its response is not used.
    sd : (p,) prior sd of each term, SI.
    facts : what the inputs have in common, for the words.
    scale : noise scale of the whitened rows.
    reach : largest size of each column over the runs, SI, by name: says how much each term contributes to
        an exact cancellation; by default the whitened columns' norms do.

    Examples
    --------
    >>> R = np.array([[9.0, 9.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    >>> seen = observe(Factor(("b0", "b0p"), R, 10), np.ones(2), Facts("gyroscope", one_sided=True))
    >>> seen.partners("b0"), seen.groups[0].reason
    (('b0p',), 'w_i never changes sign')
    """
    A = factor.R[:-1, :-1] * (sd / scale)
    size = np.linalg.norm(A, axis=0)
    tested = size > 0.0
    T = np.asarray(np.linalg.qr(np.concatenate((A, np.eye(len(sd)))), mode="r"))
    ratio = np.minimum(np.linalg.norm(invert_triangular(T), axis=1), 1.0)
    largest = factor.column_norms if reach is None else np.array([reach[name] for name in factor.names])
    bench = tuple(_bench(name) for name in factor.names)
    # single mounts are many: each term that they hide is told with all of them, the strongest first. A
    # rotation about the input axis of a sensor that is misaligned does what one across it does, a thousand
    # times less: it hides no term, and must not stand for the one that does
    mounts = np.flatnonzero([kind and (kind == LACK or kind_of(kind).each == "mount") for kind in bench])
    decades = np.round(np.log10(np.maximum(size[mounts], np.finfo(float).tiny)))
    first = mounts[np.argsort(-decades, kind="stable")]
    late = np.concatenate([first, np.setdiff1d(np.arange(len(bench)), mounts)])
    exact = tuple(_exact(A, size, largest * sd, late))
    # that the data say little of an error of the test bench by itself is no news
    faint = (c for c in _below_noise(A, size, exact) if not bench[int(np.argmax(np.abs(c.v)))])
    combinations = (*_felt(exact, bench, ratio), *faint)
    groups = tuple(_group(factor.names, c, A, sd, facts) for c in combinations)
    alone = 1.0 / np.sqrt(1.0 + size**2)
    return Observability(factor.names, tested, ratio, alone, _inflation(A, size, tested), groups)


def carried(seen: Observability, carriers: Mapping[str, str]) -> Observability:
    """What a test can tell of every column; of one that another carries, what it tells of the carrier."""
    where = [seen.names.index(carriers.get(name, name)) for name in seen.names]
    moved = {key: getattr(seen, key)[where] for key in ("tested", "ratio", "alone", "vif")}
    return replace(seen, **moved)


class _Combination(NamedTuple):
    """A direction v (p,) in units of the prior, which terms take part, and whether it cancels to rounding."""

    v: FloatArray
    part: NDArray[np.bool_]
    exact: bool


def _exact(
    A: FloatArray, size: FloatArray, effect: FloatArray, late: NDArray[np.intp]
) -> Iterator[_Combination]:
    """Combinations that cancel to the digits of the inputs, and that the data say less of than the prior.

    `effect` (p,) is that of a prior-sized coefficient, for its share in the cancellation; `late` (p,) are the
    columns in the order in which they are taken for pivots, last first.
    """
    where = np.flatnonzero(size > 0.0)
    d, Vt = _all_singular(A[:, where] / size[where])
    near = np.linalg.qr((Vt[d <= ROUNDING * d[:1]] / size[where]).T)[0]
    seen, turn = _all_singular(A[:, where] @ near)
    order = np.searchsorted(where, late[size[late] > 0.0])
    basis = np.linalg.qr(size[where, None] * (near @ turn[seen < UNSEEN].T))[0].T
    for row in _sparse(basis, order):
        v = _embed(row / size[where], where, len(size))
        v /= np.linalg.norm(v)
        share = np.abs(v) * effect
        if np.linalg.norm(A @ v) < UNSEEN:
            part = _complete(A, v, share >= TAKES_PART * share.max())
            yield _Combination(v, part, exact=True)


def _complete(A: FloatArray, v: FloatArray, part: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Terms of a direction that hide each other: they move along it alone by less than the noise.

    Where they do change them, others whose effect is smaller take part too, the largest first.
    """
    for largest in np.argsort(-np.abs(v) * np.linalg.norm(A, axis=0), kind="stable").tolist():
        if np.linalg.norm(A[:, part] @ v[part]) < UNSEEN:
            break
        part = part | (np.arange(len(v)) == largest)
    return part


def _below_noise(A: FloatArray, size: FloatArray, exact: tuple[_Combination, ...]) -> Iterator[_Combination]:
    """Combinations of visible terms, apart from the exact ones, of which the data say less than the prior."""
    where = np.flatnonzero(size > 0.0)
    taken = np.array([c.v[where] for c in exact]).reshape(len(exact), len(where))
    rest = np.linalg.qr(taken.T, mode="complete")[0][:, len(exact) :]
    d, Vt = _all_singular(A[:, where] @ rest)
    for row in _sparse(Vt[d < UNSEEN] @ rest.T, np.arange(len(where))):
        v = _embed(row / np.linalg.norm(row), where, len(size))
        effect = np.abs(v) * size
        part = (effect >= SHARE * effect.max()) & (effect >= VISIBLE * np.abs(v).max())
        if np.sum(part) >= 2:
            yield _Combination(v, _complete(A, v, part), exact=False)


def _felt(
    exact: tuple[_Combination, ...], bench: tuple[str, ...], ratio: FloatArray
) -> Iterator[_Combination]:
    """Combinations without the terms that the errors of the test bench in them hardly hide.

    A rotation about the input axis moves a misalignment by the product of two small angles: that cancels as
    exactly as others do, and matters to nobody.
    """
    terms = np.array([kind == "" for kind in bench])
    directions = np.array([c.v for c in exact]).reshape(len(exact), len(ratio))
    unseen = np.linalg.norm(np.linalg.qr(directions.T)[0], axis=1)  # (p,) of the whole null space
    most = SHARE * np.abs(directions).max(axis=0, initial=0.0)
    for c in exact:
        hidden = (unseen >= SHARE * ratio) & (np.abs(c.v) >= most)
        part = c.part if terms[c.part].all() else c.part & (hidden | ~terms)
        kinds = {bench[k] for k in np.flatnonzero(part)}
        if np.sum(part) > 1 and ("" in kinds or (len(kinds) > 1 and not terms[c.part].any())):
            yield c._replace(part=part)


def _all_singular(A: FloatArray) -> tuple[FloatArray, FloatArray]:
    """As many singular values as columns, zeros where there are fewer rows, and directions, row by row."""
    _, d, Vt = np.linalg.svd(A)
    return np.pad(d, (0, A.shape[1] - len(d))), Vt


def _sparse(basis: FloatArray, order: NDArray[np.intp]) -> FloatArray:
    """Basis of the same span in reduced echelon form: each vector has a pivot term that no other has.

    Singular vectors of one singular value mix what has nothing to do with each other, and differ from machine
    to machine; the echelon form is unique. Later columns of the order are pivots first: they are refinements.
    """
    basis, done = basis.copy(), 0
    for floor in (PIVOT, 0.0):
        for column in order[::-1]:
            if done == len(basis):
                break
            row = done + int(np.argmax(np.abs(basis[done:, column])))
            if abs(basis[row, column]) > floor:
                basis[[done, row]] = basis[[row, done]]
                basis[done] /= basis[done, column]
                others = np.arange(len(basis)) != done
                basis[others] -= np.outer(basis[others, column], basis[done])
                done += 1
    return basis


def _embed(values: NDArray, where: NDArray[np.intp], length: int) -> NDArray:
    out = np.zeros(length, dtype=values.dtype)
    out[where] = values
    return out


def _group(
    names: tuple[str, ...], c: _Combination, A: FloatArray, sd: FloatArray, facts: Facts
) -> Confounded:
    terms = tuple(name for name, inside in zip(names, c.part, strict=True) if inside)
    heads = frozenset(_head(name) for name in terms)
    alone = frozenset(head for head in heads if not _bench(head))
    if not c.exact and len(alone) > 1:
        heads = alone  # a passenger where terms alone look alike
    reason, remedy = _words(heads, facts)
    seen = 1.0 / float(np.sqrt(1.0 + np.linalg.norm(A @ c.v) ** 2))
    return Confounded(terms, tuple((c.v * sd)[c.part].tolist()), seen, c.exact, reason, remedy)


def _inflation(A: FloatArray, size: FloatArray, tested: NDArray[np.bool_]) -> FloatArray:
    """Variance inflation without a prior; inf for a term of an exact cancellation, NaN if untested.

    Of a term that takes no part in the cancellations, or only in second order of small angles, it is what it
    would be without these: else it would hang on what rounding leaves of them.
    """
    out = np.full(len(size), np.nan)
    where = np.flatnonzero(tested)
    if len(where):
        d, Vt = _all_singular(A[:, where] / size[where])
        lost = d <= CANCELLED * d[0]
        out[where] = ((Vt[~lost] / d[~lost, None]) ** 2).sum(axis=0)
        out[where[np.linalg.norm(Vt[lost], axis=0) >= TAKES_PART**2]] = np.inf
    return out


def _head(name: str) -> str:
    """Name of a column without where it is: ``b0`` of ``ax.b0``, ``fixture_j`` of ``fixture_j.tumble.2``."""
    first, _, rest = name.partition(".")
    return rest if first in COMPONENTS else first


def _bench(name: str) -> str:
    """Kind of error that a column is, or what stands for what the library lacks; empty for a term."""
    head = _head(name)
    return LACK if head.startswith(f"{LACK}_") else HEADS.get(head, "")


def _words(terms: frozenset[str], facts: Facts) -> tuple[str, str]:
    """Reason and remedy of a cancellation."""
    driven = sorted(name for name in terms if not _bench(name))
    if kinds := [kind for kind in _BENCH if any(_bench(name) == kind for name in terms)]:
        texts = ["function that the library lacks" if k == LACK else kind_of(k).text for k in kinds]
        errors, acts = " and ".join(f"the {text}" for text in texts), "acts" if len(kinds) == 1 else "act"
        as_terms = f"as {', '.join(driven)} {'does' if len(driven) == 1 else 'do'}" if driven else "alike"
        return f"{errors} {acts} on the output {as_terms}", f"{_BENCH[kinds[0]]} would separate them"
    if facts.reference_free:
        return _REFERENCE_FREE[facts.kind if facts.force else "turntable"]
    for applies, reason, remedy in _REASONS:
        if applies(terms, facts):
            at_rest = abs(facts.force / STANDARD_GRAVITY - 1.0) < LOCAL
            earth = abs(facts.rate / EARTH_RATE - 1.0) < LOCAL
            force = "|f| = g" if at_rest else "|f| is the same"
            rate = "|w| = the Earth's rate" if earth else "|w| is the same"
            own, *sizes = ("f_i", force, rate) if facts.kind == "accelerometer" else ("w_i", rate, force)
            return reason.format(*sizes, own=own), remedy[facts.kind]
    moved = " or ".join([name for name in driven if name != "b0"][:2])
    return "", f"a run in which the input of {moved} changes by itself would separate them"


def _lengths(facts: Facts) -> tuple[float, float]:
    """Lengths of the own input and of the other one where they are the same in every row."""
    return (facts.force, facts.rate) if facts.kind == "accelerometer" else (facts.rate, facts.force)


_BENCH = {
    "turn_on": "more runs, with the sensor turned off before each,",
    "fixture_common": "a run with the case turned over in its fixture, or a survey of its faces,",
    "fixture": "a run with the case turned over in its fixture, or a survey of its faces,",
    **{kind.name: "a survey of the faces of the case" for kind in SHORTENING.values()},
    "table_zero": "a tumble in three planes, or in both senses of rotation,",
    "plane_zero": "a tumble in three planes, or in both senses of rotation,",
    "latency": "one clock for rig and sensor",
    "gravity": "a survey of local gravity",
    "radius": "a tumble, or a survey of the arm,",
    "arm_stretch": "a survey of the arm under load",
    "rate_scale": "a count of whole turns against a clock",
    EARTH: "as many turns in the other sense",
    LACK: "a library that has what this one lacks",
}
"""What separates each kind of error of the test bench from the terms that it hides."""

_REFERENCE_FREE = {
    "accelerometer": (
        "only |f| = g is known of each still",
        "a tumble with known directions would separate them",
    ),
    "gyroscope": (
        "of each turn only the direction of gravity before and after it is known",
        "rate steps on a table in several mounts would separate them",
    ),
    "turntable": (
        "only the size of the rate is known of each section",
        "rate steps in several known mounts would separate them",
    ),
}
"""Reason and remedy of a cancellation where there is no reference but gravity, or the rate of a table."""

_MORE_LEVELS = {
    "accelerometer": "a centrifuge run at several levels with the input axis both ways would separate them",
    "gyroscope": "rate steps over more of the range in both directions would separate them",
}
_OWN_SIZE = {
    "accelerometer": "a centrifuge run would separate them",
    "gyroscope": "rate steps on a table in several mounts would separate them",
}
_OTHER_SIZE = {
    "accelerometer": "runs at several rates would separate them",
    "gyroscope": "a run at more than 1 g (centrifuge) would separate them",
}
_BOTH_WAYS = {
    "accelerometer": "a run with the input axis turned over would separate them",
    "gyroscope": "a run with the rotation reversed would separate them",
}
_ODD, _EVEN = frozenset({"b1", "b3", "b0p", "b2p", "b4p"}), frozenset({"b0", "b2", "b4", "b1p", "b3p"})

_SQUARES, _TRACE = frozenset({"b2", "c_jj", "c_kk"}), frozenset({"S_ii", "S_jj", "S_kk"})
"""Terms whose sum is the square of the length of the own input, and of the other one."""

_TURNED_OVER, _IN_POSITIONS = _ODD | {"m_j", "m_k", "g_i", "g_j", "g_k"}, frozenset({"c_ij", "c_ik", "c_jk"})
"""Terms that change sign where the case is turned over, and that do in some positions of a tumble."""

_KINDS = ("accelerometer", "gyroscope")

_REASONS: tuple[tuple[Callable[[frozenset[str], Facts], bool], str, dict[str, str]], ...] = (
    (lambda terms, facts: _lengths(facts)[0] > 0.0 and {"b0", *_SQUARES} <= terms,
     "{0} in every row", _OWN_SIZE),
    (lambda terms, facts: _lengths(facts)[1] > 0.0 and {"b0", *_TRACE} <= terms,
     "{1} in every row", _OTHER_SIZE),
    (lambda terms, facts: facts.still and len(terms - {"b0"}) == 1 and terms - {"b0"} <= _TURNED_OVER,
     "f and w are the same in every row",
     dict.fromkeys(_KINDS, "a run with the case turned over would separate them")),
    (lambda terms, facts: facts.still and terms - {"b0"} <= _IN_POSITIONS,
     "f and w are the same in every row", dict.fromkeys(_KINDS, "a tumble would separate them")),
    (lambda terms, facts: facts.one_sided and any(f"{name}p" in terms for name in terms),
     "{own} never changes sign", _BOTH_WAYS),
    (lambda terms, facts: terms <= _ODD,
     "odd functions of {own} look alike over the levels tested", _MORE_LEVELS),
    (lambda terms, facts: terms <= _EVEN,
     "even functions of {own} look alike over the levels tested", _MORE_LEVELS),
    (lambda terms, facts: facts.kind == "accelerometer" and facts.force > 0.0 and "b0" in terms,
     "{0} in every row", _OWN_SIZE),
)  # fmt: skip
"""(when, reason, remedy by kind) of the cancellations that have a name; the first that applies is told."""
