"""Problems that are timed, each with the truth that an answer is held against."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import factor_of
from imubayes.inference.prior import GPrior, ScalePrior
from imubayes.inference.summary import Summary
from imubayes.selection.enumerate import enumerate_models
from imubayes.selection.model_sets import sizes, tally
from imubayes.sensors.terms import Library, columns, library
from imubayes.units import STANDARD_GRAVITY
from studies.speed import peers
from studies.speed.contests import Contest, Entrant, Subject

LIBRARY = library("accelerometer", powers=3, asymmetry=0, set="extended")
"""Of 21 terms, the library of the speed goals."""

POWERS = library("accelerometer", powers=7, asymmetry=-1)
"""Of 21 terms too, of which eight are powers of the input."""

SIZE = 30.0
"""Standard deviations from zero of a coefficient whose column is orthogonal to the others."""

RANGE = 50.0 * STANDARD_GRAVITY
"""m/s^2; drive of the input axis, so that columns differ by eight decades."""

REFINEMENTS = 4
"""Of the reference solution, each of which takes ten digits off its error."""

ROWS = 500
"""Of a problem of subsets: their number is in the factor only."""

BY_LOGS = 20
"""Most candidates whose enumeration is held against the slow way by logarithms."""


def drive(n: int, rng: np.random.Generator) -> dict[str, FloatArray]:
    """Inputs of n rows that excite every term, SI."""
    force = {"f_i": rng.uniform(-RANGE, RANGE, n), "f_j": rng.normal(0.0, 20.0, n)}
    rates = {f"{kind}_{axis}": rng.normal(0.0, 3.0, n) for kind in ("w", "dw") for axis in "ijk"}
    return force | {"f_k": rng.normal(0.0, 20.0, n)} | rates


def least_squares(n: int, seed: int) -> Contest:
    """Least squares of 21 terms over n rows in SI units, as they come."""
    rng = np.random.default_rng([seed, 1, n])
    title = f"Least squares, {n:,} rows by {len(LIBRARY.terms)} terms in SI units"
    return _fits("least squares", title, LIBRARY, drive(n, rng), rng)


def one_sided(n: int, seed: int) -> Contest:
    """The same with seven powers of an input from 40 to 50 g: columns that are nearly alike."""
    rng = np.random.default_rng([seed, 7, n])
    inputs = drive(n, rng) | {"f_i": rng.uniform(0.8 * RANGE, RANGE, n)}
    title = f"Least squares, {n:,} rows by {len(POWERS.terms)} terms, seven powers of 40 to 50 g"
    return _fits("one-sided", title, POWERS, inputs, rng)


def _fits(
    subject: Subject, title: str, lib: Library, inputs: dict[str, FloatArray], rng: np.random.Generator
) -> Contest:
    """Least squares of a library's terms by everybody."""
    n = len(inputs["f_i"])
    X = np.empty((n, len(lib.terms)))
    columns(lib, inputs, n, out=X)
    y = X @ (SIZE * rng.normal(size=X.shape[1]) / np.linalg.norm(X, axis=0)) + rng.normal(size=n)
    exact, sd = refined(X, y)

    def off(theta: FloatArray) -> float:
        return float(np.max(np.abs(theta - exact) / sd))

    def ours() -> FloatArray:
        return Summary.from_arrays(X, y, lib.names).least_squares().mean

    others = {
        "numpy.linalg.lstsq": (peers.numpy_lstsq, "numpy"),
        "normal equations": (peers.normal_equations, "numpy"),
        "statsmodels OLS": (peers.statsmodels_ols, "statsmodels"),
        "scikit-learn": (peers.sklearn_linear, "sklearn"),
    }
    entrants = [Entrant(name, partial(solve, X, y), off, (need,)) for name, (solve, need) in others.items()]
    error = "largest error of a coefficient, in its standard errors"
    return Contest(
        subject, n, title, error, "solution", (Entrant("imubayes", ours, off, ours=True), *entrants)
    )


def refined(X: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least squares by refinement with residuals and products in extended precision, and standard errors."""
    unit = np.linalg.norm(X, axis=0)
    R = np.asarray(np.linalg.qr(X / unit, mode="r"))
    wide, response = X.astype(np.longdouble), y.astype(np.longdouble)
    theta = np.zeros(X.shape[1], np.longdouble)
    for _ in range(REFINEMENTS):
        slope = (wide.T @ (response - wide @ theta)).astype(float) / unit
        theta += np.linalg.solve(R, np.linalg.solve(R.T, slope)) / unit
    left = (response - wide @ theta).astype(float)
    spread = np.linalg.norm(np.linalg.inv(R), axis=1) / unit
    return theta.astype(float), spread * np.linalg.norm(left) / np.sqrt(len(y) - X.shape[1])


def _few(p: int, seed: int) -> tuple[FloatArray, FloatArray]:
    """Rows of p correlated columns, of which three are in the response, weakly."""
    rng = np.random.default_rng([seed, 2, p])
    X = rng.normal(size=(ROWS, p)) + 0.7 * rng.normal(size=(ROWS, 1))
    return X, X[:, :3] @ np.array([0.5, -0.2, 0.1]) + rng.normal(size=ROWS)


def _names(p: int) -> tuple[str, ...]:
    return tuple(f"x{j}" for j in range(p))


def subsets(p: int, seed: int) -> Contest:
    """Inclusion of p terms by the BIC of every subset."""
    X, y = _few(p, seed)
    brute = _brute_residuals(X, y)
    off, best = _farthest_from(_from_residuals(brute, p)), _bits(int(np.argmin(_bic(brute, p))), p)
    path = f"{2**p:,} subsets"
    return Contest(
        "subsets",
        p,
        f"Every subset of {p} terms by BIC: {path}",
        "largest error of an inclusion",
        "all subsets",
        (
            Entrant("imubayes, the tree", lambda: _from_residuals(_tree_residuals(X, y), p), off, ours=True),
            Entrant("statsmodels OLS", lambda: peers.statsmodels_subsets(X, y), off, ("statsmodels",)),
            Entrant(
                "abess",
                lambda: peers.abess_best(X, y),
                _farthest_from(best),
                ("abess",),
                remark="one best subset, without probabilities: its error is whether that is the best",
            ),
        ),
    )


def _farthest_from(exact: FloatArray) -> Callable[[FloatArray], float]:
    return lambda found: float(np.max(np.abs(found - exact)))


def _tree_residuals(X: FloatArray, y: FloatArray) -> FloatArray:
    from imubayes.selection.lanes import residuals

    return residuals(factor_of(X, y, _names(X.shape[1])).R)


def _brute_residuals(X: FloatArray, y: FloatArray) -> FloatArray:
    """Residual sum of squares of every mask, from a QR of its own each."""
    p = X.shape[1]
    small = np.asarray(np.linalg.qr(np.column_stack((X, y)), mode="r"))
    rss = np.empty(1 << p)
    for one in peers.supports(p):
        Q, _ = np.linalg.qr(small[:, one])
        rss[sum(1 << j for j in one)] = np.sum((small[:, -1] - Q @ (Q.T @ small[:, -1])) ** 2)
    return rss


def _from_residuals(rss: FloatArray, p: int) -> FloatArray:
    """Inclusion (p,) by the weights ``exp(-BIC/2)`` of every mask."""
    bic = _bic(rss, p)
    told = tally(np.exp(-0.5 * (bic - bic.min())), p)
    return told.having / told.total


def _bic(rss: FloatArray, p: int) -> FloatArray:
    """BIC of every mask, up to what all have in common."""
    return ROWS * np.log(rss) + sizes(p) * np.log(ROWS)


def _bits(mask: int, p: int) -> FloatArray:
    return np.array([float(mask >> j & 1) for j in range(p)])


def g_prior(p: int, seed: int) -> Contest:
    """Inclusion of p terms under a g-prior with g = n and no intercept, every model equally likely."""
    X, y = _few(p, seed)
    s = Summary.from_arrays(X, y, _names(p))

    def ours() -> FloatArray:
        return enumerate_models(s, GPrior(float(ROWS)), "uniform").inclusion

    off = _farthest_from(_g_inclusion(_tree_residuals(X, y), float(y @ y), p))
    by_script = partial(peers.every_least_squares, X, y, float(ROWS))
    scripted = Entrant("numpy, one by one", by_script, off, ("numpy",))
    in_r = [
        Entrant(f"R, {name}", partial(peers.in_r, name, X, y), off, (f"R:{name}",))
        for name in peers.R_SCRIPTS
    ]
    return Contest(
        "g-prior",
        p,
        f"Posterior over 2^{p} models under a g-prior",
        "largest error of an inclusion",
        "posterior",
        (Entrant("imubayes", ours, off, ours=True), *([scripted] if p <= SCRIPTED else []), *in_r),
    )


SCRIPTED = 14
"""Most candidates for which a least squares for each subset is waited for."""


def _g_inclusion(rss: FloatArray, total: float, p: int) -> FloatArray:
    """Inclusion (p,) by the closed form of each model's Bayes factor, g = n."""
    g = float(ROWS)
    logs = 0.5 * (ROWS - sizes(p)) * np.log1p(g) - 0.5 * ROWS * np.log1p(g * rss / total)
    told = tally(np.exp(logs - logs.max()), p)
    return told.having / told.total


def enumeration(p: int, seed: int) -> Contest:
    """Posterior over 2^p models under a physical prior: inclusion, moments, the best models, the evidence."""
    X, y = _few(p, seed)
    s, prior = Summary.from_arrays(X, y, _names(p)), ScalePrior(1.0)
    off = _farthest_from(_by_logarithms(s, prior)) if p <= BY_LOGS else lambda found: float("nan")
    return Contest(
        "enumeration",
        p,
        f"Posterior over 2^{p} = {2**p:,} models",
        "largest difference of an inclusion from the walk with logarithms",
        "posterior",
        (
            Entrant(
                "imubayes, noise given",
                lambda: enumerate_models(s, prior, scale=1.0).inclusion,
                off,
                ours=True,
            ),
            Entrant(
                "imubayes, noise scale integrated",
                lambda: enumerate_models(s, prior).inclusion,
                lambda found: float("nan"),
                ours=True,
                remark="the same at several noise scales",
            ),
        ),
    )


def _by_logarithms(s: Summary, prior: ScalePrior) -> FloatArray:
    """Inclusion (p,) by the logarithm of each model's determinant, on one thread."""
    from imubayes.selection.lanes import walk
    from imubayes.selection.mixture import candidates
    from imubayes.selection.model_sets import log_model_prior, sizes, subset_sums

    p = len(s.names)
    c = candidates(s.factor, s.names, (), np.full(p, float(prior.sd.ravel()[0])))
    rss, log_det = walk(c.at(1.0))
    log = subset_sums(-np.log(c.sd)) + log_model_prior("beta-binomial", p)[sizes(p)] - 0.5 * rss - log_det
    weight = np.exp(log - log.max())
    told = tally(weight, p)
    return told.having / told.total
