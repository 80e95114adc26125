"""What the library does not contain, and in which input the residuals show it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from imubayes.algebra import FloatArray, IntArray
from imubayes.algebra import factor as algebra
from imubayes.inference.free_functions import BLOCKS, HYSTERESIS, TIME, Look, lacked, looks_at, terms_at
from imubayes.inference.linear import Linear, blocks_of, once, with_columns
from imubayes.inference.noise_model import NBK, mode_of, nbk_model, span
from imubayes.inference.residuals import SUSPECT
from imubayes.inference.summary import RunSummary, Summary
from imubayes.inference.whiten import Together, nbk, processes, whiten, whiten_by
from imubayes.rig.recordings import OUTPUT_UNIT
from imubayes.sensors.noise import Noise


@dataclass(frozen=True, slots=True, eq=False)
class Dependence:
    """Dependence of a run's residuals on one input.

    Attributes
    ----------
    run : its name; empty where all runs are looked at together.
    input : channel (``f_i`` ... ``T``, ``dT``), ``t`` for time, ``hysteresis of T``: the same input, met
        while it rises and while it falls; of all runs the name of a term that the library lacks.
    p : p-value that chance explains it, corrected for the number of inputs that were looked at, and for the
        other tests of the study.
    share : of the variance of the residuals' block means that the dependence explains.
    size : rms of the dependence, SI of the output.
    x : (k,) where the residual is shown, SI of the input; of a term nothing is shown.
    mean, sd : (k,) mean residual there and its standard error, SI of the output.
    branch : (k,) +1 while the input rises, -1 while it falls, 0 where that makes no difference.
    """

    run: str
    input: str
    p: float
    share: float
    size: float
    x: FloatArray
    mean: FloatArray
    sd: FloatArray
    branch: FloatArray

    @property
    def channel(self) -> str:
        """Input channel, without what is said of its branches; empty for a term."""
        return self.input.removeprefix(HYSTERESIS) if self.run else ""

    @property
    def where(self) -> str:
        """Where: ``f_i in run arm``, ``T between heating and cooling in run ramp``, ``b3 over all runs``."""
        if not self.run:
            return f"{self.input} over all runs"
        if self.channel == self.input:
            return f"{'time' if self.input == TIME else self.input} in run {self.run}"
        branches = "heating and cooling" if self.channel == "T" else "rising and falling"
        return f"{self.channel} between {branches} in run {self.run}"


@dataclass(frozen=True, slots=True, eq=False)
class Misfit:
    """Whether the library misses something: dependences of every run on every input, worst first.

    Attributes
    ----------
    found : those that chance does not explain.
    predictive_p : posterior predictive p-value of each run's residual size, by run.
    text : in words: nothing is missing, or "something the library does not contain", and where it shows.
    level : predictive p-value, from either end, that calls for a second look.
    """

    dependences: tuple[Dependence, ...]
    found: tuple[Dependence, ...]
    predictive_p: dict[str, float]
    text: str
    level: float = SUSPECT


SHOWN = 12
"""Groups of blocks, of each branch, that a dependence is shown in."""

LEFT = 1e-4
"""Share of a function that the library must leave over for it to be told from the library."""

SPARE = 5
"""Degrees of freedom that must be left to judge the noise by."""

HERMITE = (
    (0.0, 8.0 / 15.0),
    (1.3556262, 0.2220759),
    (-1.3556262, 0.2220759),
    (2.8569700, 0.0112574),
    (-2.8569700, 0.0112574),
)
"""Nodes in sds and weights of a mean over a normal distribution, exact to the ninth power."""

DRAWS = 1000
"""Posterior draws behind a predictive p-value."""

NOISES = 200
"""Draws of the noise of all runs that a look at them together is a mean over."""

AT_ONCE = 20
"""How many of them are taken together."""


def find_misfit(
    rows: Sequence[Linear],
    channels: Sequence[Mapping[str, FloatArray]],
    summary: Summary,
    sd: FloatArray,
    *,
    rng: np.random.Generator,
    share: int = 1,
) -> Misfit:
    """Look for what the library does not contain.

    In each run the library is set against the library plus a free function of one input: piecewise linear
    between nine knots, with a jump where the input changes sign. For temperature and the own input there is a
    second look, at hysteresis: beside a free function of the input, at what lags behind it by some play (a
    sum of play operators, continuous where the input turns). Both are generalised least squares over averages
    of blocks, and the F test has the degrees of freedom that the library leaves to the function within the
    run.

    What runs show only together, as one at small inputs and one at large ones, and what a free function of
    one input is not, or would use up the averages for, is looked for in all runs: each term of the model
    equation that the library lacks (see `lacked`), of which the likeliest is told, and others that it does
    not explain.

    The noise is estimated anew with each function in the mean, under the class's prior: the noise of the
    library alone has long taken what is missing for random walk. A p-value is the mean over the posterior of
    ln B and ln K. Where the noise was given it is taken as it is, and so it is for time, whose wandering
    belongs to the noise unless it is beyond it.

    The p-values are multiplied by the number of looks at all runs and by `share` (Bonferroni), and then held
    against `SUSPECT`, the level of all residual tests of a study. Inputs of a test go together, so one that
    chance does not explain is named only for what those before it do not explain; time, of which everything
    is a function, comes last.

    The predictive p-value of a run is the probability that its averages, predicted anew from posterior draws
    of the coefficients, lie farther from the model than the measured ones do. Where the run's own residuals
    gave the noise, it speaks of disagreement between the runs.

    Parameters
    ----------
    rows, summary : of the runs.
    channels : (n,) arrays by input of each run, SI; of a free tumble the forces that were found.
    sd : (p,) prior sd of every column, SI.
    share : into how many parts the level is divided, of which these looks have one, and the predictive
        p-values another.
    """
    lib = summary.library
    own = lib.own if lib and not summary.facts.reference_free else ""
    sds = dict(zip(summary.names, sd.tolist(), strict=True))
    parts = list(zip(rows, channels, summary.runs, strict=True))
    looks = [look for part, inputs, run in parts for look in looks_at(part, inputs, run, own, sds)]
    of_runs = [((look,), one) for look in looks if (one := _dependence(look)) is not None]
    beyond = lacked(lib) if lib and own else None
    by_term = zip(*(terms_at(*part, beyond, sds) for part in parts if beyond), strict=True)
    of_terms = [(looks, one) for looks in by_term if (one := _together(looks, rng)) is not None]
    tests = share * (len(of_runs) + len(of_terms))
    found = [
        one
        for run in summary.runs
        for one in _apart([pair for pair in of_runs if pair[0][0].run is run], tests, _of_run)
    ]
    found += _apart(of_terms, tests, partial(_together, rng=rng))
    every = [replace(one, p=min(1.0, one.p * tests)) for _, one in (*of_runs, *of_terms)]
    T = algebra.with_prior_rows(summary.factor.R, 1.0 / sd)
    z = T[:-1, -1:] + rng.standard_normal((len(sd), DRAWS))
    draws = algebra.solve_triangular(T[:-1, :-1], z)
    return Misfit(
        dependences=tuple(sorted(every, key=_worst)),
        found=tuple(sorted(found, key=_worst)),
        predictive_p={
            run.name: _predictive(part, run, draws) for part, run in zip(rows, summary.runs, strict=True)
        },
        text=_text(found, OUTPUT_UNIT[lib.kind if lib else "accelerometer"]),
        level=SUSPECT / (2 * share * max(len(rows), 1)),
    )


def _worst(one: Dependence) -> tuple[bool, float, float]:
    # of inputs that explain as much, as on a sphere, the first comes first, and not what rounding prefers
    return one.input == TIME, one.p, -round(one.share, 6)


def _apart(
    tested: Sequence[tuple[tuple[Look, ...], Dependence]],
    tests: int,
    test: Callable[[tuple[Look, ...]], Dependence | None],
) -> Iterator[Dependence]:
    """Dependences that neither chance explains nor those before them, worst first, of which each is a `test`.

    Each is of its looks, of one run or of all.
    """
    suspects = [(looks, one) for looks, one in tested if one.p * tests < SUSPECT]
    while suspects:
        (explaining, worst), *others = sorted(suspects, key=lambda pair: _worst(pair[1]))
        yield replace(worst, p=worst.p * tests)
        suspects = []
        for looks, before in others:
            more = tuple(map(_beside, looks, explaining))
            left = test(more)
            if left is not None and left.p * tests < SUSPECT:
                suspects.append((more, replace(before, p=left.p)))


def _beside(look: Look, explaining: Look) -> Look:
    return replace(look, beside=np.column_stack((look.beside, explaining.columns)))


def _of_run(looks: tuple[Look, ...]) -> Dependence | None:
    return _dependence(looks[0])


def _dependence(look: Look) -> Dependence | None:
    """Test one free function; None where the library leaves nothing of it, or too little beside it.

    Under each noise, what the whitened columns leave of the function is the end of their triangular factor.
    """
    from scipy.special import fdtrc

    log_prior, noises = _noises(look)
    basis = span(np.column_stack((look.blocks.X, look.beside)))
    free = len(basis) - basis.shape[1]
    if free <= SPARE:
        return None
    white, log_det = _whitened(look, noises, basis)
    R, b = np.asarray(np.linalg.qr(white, mode="r")), basis.shape[1]
    left, size = R[:, b:, b:], np.linalg.norm(R[0, :, b:-1], axis=0)
    if not np.isfinite(left).all():  # a run without noise
        return None
    size = np.where(size > 0.0, size, 1.0)
    U, s, Vt = np.linalg.svd(left[:, :, :-1] / size, full_matrices=False)
    rank = int(np.sum(s[0] > LEFT))
    y, dof = left[:, :, -1:], free - rank
    total, amplitude = np.sum(y**2, axis=(1, 2)), np.swapaxes(U[:, :, :rank], 1, 2) @ y
    if rank == 0 or dof < SPARE or total[0] == 0.0:  # an output in coarse steps may not change at all
        return None
    explained = np.sum(amplitude**2, axis=(1, 2))
    of_mean = np.concatenate((np.abs(np.diagonal(R, axis1=1, axis2=2)[:, :b]), s[:, :rank]), axis=1)
    weights = _weights(log_prior, log_det, of_mean, total - explained)
    scale = np.maximum(total - explained, np.finfo(float).tiny) / dof
    # without what the library could take over from it
    shape = _off(basis, look.columns) @ (Vt[0, :rank].T / s[0, :rank] / size[:, None])
    wander, chance = shape @ amplitude[0, :, 0], scale[0] * float(np.mean(np.sum(shape**2, axis=1)))
    x, mean, sd, branch = _shown(look, wander, shape * math.sqrt(scale[0]))
    return Dependence(
        run=look.run.name,
        input=look.input,
        p=float(weights @ fdtrc(rank, dof, explained / rank / scale)),
        share=float(explained[0] / total[0]),
        size=math.sqrt(max(0.0, float(np.mean(wander**2)) - chance)),
        x=x,
        mean=mean,
        sd=sd,
        branch=branch,
    )


def _together(looks: tuple[Look, ...], rng: np.random.Generator) -> Dependence | None:
    """Test one term over all runs, in which the library has the same coefficients.

    Of a single run it is the F test. Else the noise of each run is drawn from what its own rows say of it:
    its ratios as `_noises` weighs them, and its size, which the F test has in its degrees of freedom.
    """
    from scipy.special import chdtrc

    size = np.concatenate([np.full(len(look.columns), look.run.noise.N or 1.0) for look in looks])[:, None]
    X = np.concatenate([np.column_stack((look.blocks.X, look.beside)) for look in looks])
    basis, column = span(X / size), np.concatenate([look.columns for look in looks]) / size
    shape, b = _off(basis, column), basis.shape[1]
    if not np.linalg.norm(shape) > LEFT * np.linalg.norm(column):
        return None
    if len(looks) == 1:
        one = _dependence(looks[0])
        return replace(one, run="") if one else None
    parts = np.split(basis * size, np.cumsum([len(look.columns) for look in looks])[:-1])
    drawn = [_drawn(look, part, rng) for look, part in zip(looks, parts, strict=True)]
    left = np.empty((NOISES, 2, 2))
    for some in np.split(np.arange(NOISES), NOISES // AT_ONCE):
        rows = np.concatenate([R[at[some]] / scale[some, None, None] for R, at, scale in drawn], axis=1)
        left[some] = np.asarray(np.linalg.qr(rows, mode="r"))[:, b:, b:]
    if not np.isfinite(left).all():
        return None
    # per draw what the library leaves of the term, its share of the response, and the rest of that
    of_term, explained, rest = left[:, 0, 0], left[:, 0, 1] ** 2, left[:, 1, 1] ** 2
    amplitude = left[:, 0, 1] / of_term
    chance = float(np.var(amplitude) + np.mean(1.0 / of_term**2))
    square = float(np.mean((shape * size) ** 2))
    return Dependence(
        run="",
        input=looks[0].input,
        p=float(np.mean(chdtrc(1, explained))),
        share=float(np.mean(explained / (explained + rest))),
        size=math.sqrt(max(0.0, square * (float(np.mean(amplitude)) ** 2 - chance))),
        x=np.zeros(0),
        mean=np.zeros(0),
        sd=np.zeros(0),
        branch=np.zeros(0),
    )


def _drawn(
    look: Look, basis: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Triangular factors (k, w, w) of a run's rows, white by each of k noises, and `NOISES` draws of these.

    With each draw the size of the noise beside what it was whitened by, NaN where the rows show none.
    """
    own = span(np.column_stack((look.blocks.X, look.beside, look.columns)))
    free = len(own) - own.shape[1]
    log_prior, noises = _noises(look) if free > SPARE else (np.zeros(1), [look.run.noise])
    white, log_det = _whitened(look, noises, basis)
    R = np.asarray(np.linalg.qr(white, mode="r"))
    if free <= SPARE or not np.isfinite(R).all():
        return R, np.zeros(NOISES, dtype=np.int64), np.ones(NOISES)
    norm = np.linalg.norm(R[0, :, :-1], axis=0)
    U, s, _ = np.linalg.svd(R[:, :, :-1] / np.where(norm > 0.0, norm, 1.0), full_matrices=False)
    taken, y = U[:, :, : own.shape[1]], R[:, :, -1:]
    total = np.sum((y - taken @ (np.swapaxes(taken, 1, 2) @ y)) ** 2, axis=(1, 2))
    weights = _weights(log_prior, log_det, s[:, : own.shape[1]], total)
    at = rng.choice(len(noises), NOISES, p=weights)
    scale = np.sqrt(total[at] / rng.chisquare(free, NOISES))
    return R, at, np.where(scale > 0.0, scale, np.nan)


def _weights(log_prior: FloatArray, log_det: FloatArray, of_mean: FloatArray, rest: FloatArray) -> FloatArray:
    """Weights (k,) of noises by the restricted likelihood, of which `rest` is what the mean leaves."""
    of_mean = np.maximum(of_mean, np.finfo(float).tiny)
    level = log_prior - log_det - np.log(of_mean).sum(axis=1) - 0.5 * rest
    return np.exp(level - np.logaddexp.reduce(level))


def _whitened(look: Look, noises: Sequence[Noise], basis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What is beside a function, its columns, and the response, whitened by each of k noises: (k, m, w).

    With it half of the logarithm of the determinant (k,) of each.
    """
    rows, table = look.blocks.rows, np.column_stack((basis, look.columns, look.blocks.y))
    white = np.repeat(table[None], len(noises), axis=0)
    units, log_det = dict[float, Together](), list[float]()
    for noise, part in zip(noises, white, strict=True):
        if noise.B not in units:
            units[noise.B] = nbk(processes(rows, noise), rows)
        d = whiten_by(units[noise.B].sized(np.array([noise.N, noise.B, noise.K])), rows, part)
        log_det.append(0.5 * float(np.sum(np.log(d))))
    return white, np.array(log_det)


def _noises(look: Look) -> tuple[FloatArray, Sequence[Noise]]:
    """Noises of a run with a free function in the mean, the likeliest first, and logarithms of prior weights.

    A weight is the prior density there times the volume that the noise stands for.
    """
    run, X = look.run, look.blocks.X
    if run.found.origin != "REML" or look.input == TIME:
        return np.zeros(1), [run.noise]

    def mode(
        X: FloatArray, start: FloatArray, near: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        model = nbk_model(with_columns(look.blocks, X), run.found.steering, None)
        return mode_of(model, NBK, start, near)

    # a function changes little of what is found without it, unless it is what was missing
    own = once(look.blocks, run.noise, lambda: mode(X, np.log([run.noise.N, run.noise.B, run.noise.K])))
    more = np.column_stack((look.beside, look.columns))
    left = _off(once(look.blocks, "span", lambda: span(X)), more)
    there = np.linalg.norm(left, axis=0) > LEFT * np.linalg.norm(more, axis=0)
    found, covariance = mode(np.column_stack((X, more)), *own) if there.any() else own
    node, weight = np.array(HERMITE).T
    median, width = np.array([run.found.steering[name] for name in NBK[1:]]).T[:, :, None]
    x = found[1:, None] + node * np.sqrt(np.diag(covariance)[1:, None])
    log = np.log(weight) + 0.5 * node**2 - 0.5 * ((x - np.log(median)) / width) ** 2
    B, K = np.exp(x).tolist()
    return np.add.outer(*log).ravel(), [Noise(math.exp(found[0]), b, k) for b in B for k in K]


def _off(basis: FloatArray, columns: FloatArray) -> FloatArray:
    """What orthonormal columns leave of others; taken off twice, so that rounding goes too."""
    left = columns - basis @ (basis.T @ columns)
    return left - basis @ (basis.T @ left)


def _shown(
    look: Look, wander: FloatArray, shape: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Averages over groups of blocks with alike input: input, dependence, standard error, branch."""
    ordered = np.argsort(look.x, kind="stable")
    groups = [
        group
        for side in ((-1.0, 1.0) if look.branch.any() else (0.0,))
        for group in np.array_split(ordered[look.branch[ordered] == side], SHOWN)
        if len(group)
    ]
    return (
        np.array([look.x[g].mean() for g in groups]),
        np.array([wander[g].mean() for g in groups]),
        np.array([float(np.linalg.norm(shape[g].mean(axis=0))) for g in groups]),
        np.array([look.branch[g[0]] for g in groups]),
    )


def _predictive(rows: Linear, run: RunSummary, draws: FloatArray) -> float:
    """Probability that averages predicted anew lie farther from the model than the measured ones."""
    from scipy.special import chdtrc

    blocks = blocks_of(rows, BLOCKS)
    white = whiten(run.noise, blocks.rows, np.column_stack((blocks.X, blocks.y)))[0]
    R = np.linalg.qr(white)[1]
    distance = np.sum((R[:, -1:] - R[:, :-1] @ draws) ** 2, axis=0)
    return float(np.mean(chdtrc(len(white), distance)))


def _text(dependences: Sequence[Dependence], unit: str) -> str:
    if not dependences:
        return "Residuals depend neither on an input nor on time by more than chance."
    p_of = (f"= {d.p:.1g}" if d.p > 1e-12 else "below 1e-12" for d in dependences)
    shows = [f"{d.where} (p {p}, rms {d.size:.2g} {unit})" for d, p in zip(dependences, p_of, strict=True)]
    return f"There is something the library does not contain: it shows in {'; '.join(shows)}."
