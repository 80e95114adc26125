"""What others would use for the same problems. Each is imported where it is used, and need not be there."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from functools import cache
from importlib.util import find_spec
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from imubayes.algebra import FloatArray
from studies.speed.contests import Self

LONGEST = 600.0
"""s; that a script of R may take."""

ENOUGH = 1_000.0
"""Effective samples that the time of a sampler is counted for."""


def missing(needs: tuple[str, ...]) -> str:
    """Say why an entrant cannot take part; empty if it can."""
    for need in needs:
        package = need.removeprefix("R:")
        if package == need and find_spec(need) is None:
            return f"{need} is not installed: pip install 'imubayes[benchmark]'"
        if package != need and shutil.which("Rscript") is None:
            return "R is not installed: there is no Rscript on the PATH"
        if package != need and not _r_has(package):
            return f"R has no package {package}: install.packages('{package}')"
    return ""


@cache
def _r_has(package: str) -> bool:
    asked = f"quit(status = !requireNamespace('{package}', quietly = TRUE))"
    return subprocess.run(["Rscript", "-e", asked], capture_output=True, check=False).returncode == 0


def numpy_lstsq(X: FloatArray, y: FloatArray) -> FloatArray:
    """Singular values, those below ``n eps`` of the largest cut off."""
    return np.asarray(np.linalg.lstsq(X, y, rcond=None)[0], dtype=float)


def normal_equations(X: FloatArray, y: FloatArray) -> FloatArray:
    """The textbook's ``(X'X)^-1 X'y``."""
    return np.asarray(np.linalg.solve(X.T @ X, X.T @ y), dtype=float)


def statsmodels_ols(X: FloatArray, y: FloatArray) -> FloatArray:
    """Ordinary least squares by the pseudoinverse, its default."""
    from statsmodels.regression.linear_model import OLS  # pyright: ignore[reportMissingImports]

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return np.asarray(OLS(y, X).fit().params)


def sklearn_linear(X: FloatArray, y: FloatArray) -> FloatArray:
    """Linear regression without an intercept of its own, which is among the columns."""
    from sklearn.linear_model import LinearRegression

    return LinearRegression(fit_intercept=False).fit(X, y).coef_


def supports(p: int) -> Iterator[tuple[int, ...]]:
    """Every subset of p columns."""
    for k in range(p + 1):
        yield from combinations(range(p), k)


def statsmodels_subsets(X: FloatArray, y: FloatArray) -> FloatArray:
    """Inclusion (p,) by the weights ``exp(-BIC/2)`` of every subset, each fitted by OLS."""
    from statsmodels.regression.linear_model import OLS  # pyright: ignore[reportMissingImports]

    n, p = X.shape
    inside = list(supports(p))
    bic = np.array([n * np.log(y @ y)] + [_bic(OLS(y, X[:, one]).fit(), n, len(one)) for one in inside[1:]])
    weight = np.exp(-0.5 * (bic - bic.min()))
    member = np.zeros((len(inside), p))
    for row, one in enumerate(inside):
        member[row, list(one)] = 1.0
    return weight @ member / weight.sum()


def _bic(fit, n: int, k: int) -> float:
    """BIC of a fit with k columns, up to what all fits have in common."""
    return n * float(np.log(fit.ssr)) + k * float(np.log(n))


def abess_best(X: FloatArray, y: FloatArray) -> FloatArray:
    """Support (p,) of the best subset, 1 or 0, chosen by BIC along the path of all sizes."""
    from abess import LinearRegression  # pyright: ignore[reportMissingImports]

    sizes = range(X.shape[1] + 1)
    return (
        LinearRegression(support_size=sizes, ic_type="bic", fit_intercept=False).fit(X, y).coef_ != 0.0
    ).astype(float)


def every_least_squares(X: FloatArray, y: FloatArray, g: float) -> FloatArray:
    """Inclusion (p,) under a g-prior by a least squares for each subset, as one would script it."""
    n, p = X.shape
    total, logs, member = float(y @ y), [], []
    for one in supports(p):
        left = total
        if one:
            theta, *_ = np.linalg.lstsq(X[:, one], y, rcond=None)
            left = float(np.sum((y - X[:, one] @ theta) ** 2))
        logs.append(0.5 * (n - len(one)) * np.log1p(g) - 0.5 * n * np.log1p(g * left / total))
        member.append(np.isin(np.arange(p), one))
    weight = np.exp(np.array(logs) - max(logs))
    return weight @ np.array(member, dtype=float) / weight.sum()


R_SCRIPTS = {
    "BAS": """
fit <- function() BAS::bas.lm(y ~ . - 1, data = d, prior = 'g-prior', alpha = nrow(d),
  modelprior = BAS::uniform(), method = 'deterministic', n.models = 2^p)
found <- function(m) m$probne0
""",
    "BMS": """
fit <- function() BMS::bms(d, g = nrow(d), mprior = 'uniform', mcmc = 'enumerate', user.int = FALSE)
found <- function(m) coef(m, order.by.pip = FALSE)[, 'PIP']
""",
}


def in_r(package: str, X: FloatArray, y: FloatArray) -> Self:
    """Inclusion (p,) by R's BAS or BMS under a g-prior, g = n, and the seconds by R's own clock."""
    with tempfile.TemporaryDirectory() as folder:
        rows, out = Path(folder) / "rows.csv", Path(folder) / "found.txt"
        header = ",".join(["y", *(f"x{j}" for j in range(X.shape[1]))])
        np.savetxt(rows, np.column_stack((y, X)), delimiter=",", header=header, comments="")
        script = (
            f"d <- read.csv('{rows.as_posix()}'); p <- ncol(d) - 1\n{R_SCRIPTS[package]}"
            f"seconds <- system.time(m <- fit())['elapsed']\n"
            f"write(c(seconds, tail(found(m), p)), '{out.as_posix()}', ncolumns = 1)\n"
        )
        subprocess.run(["Rscript", "-e", script], capture_output=True, check=True, timeout=LONGEST)
        values = np.loadtxt(out)
    return Self(values[1:], float(values[0]))


def allan_slopes(y: FloatArray, rate: float) -> FloatArray:
    """N, B, K off the overlapping Allan deviation by allantools, as read off the plot.

    N by the slope -1/2 over the first decade, B the minimum over 0.664, K by the slope +1/2 over the last
    decade: the deviation is ``N/sqrt(tau)``, ``0.664 B`` and ``K sqrt(tau/3)`` where one of them rules.
    """
    import allantools

    tau, deviation, *_ = allantools.oadev(y, rate=rate, data_type="freq", taus="decade")
    first, last = tau <= 10.0 * tau[0], tau >= 0.1 * tau[-1]
    white = np.exp(np.mean(np.log(deviation[first] * np.sqrt(tau[first]))))
    walk = np.exp(np.mean(np.log(deviation[last] * np.sqrt(3.0 / tau[last]))))
    return np.array([white, deviation.min() / 0.664, walk])


def nuts(A: FloatArray, b: FloatArray, seed: int) -> Self:
    """Draws (m, d) of nutpie's NUTS from ``exp(-|A x - b|^2/2)``, and its seconds for 1,000 effective ones.

    Its warm-up counts, compilation does not; effective samples by ArviZ' bulk value, of the worst coordinate.
    """
    import arviz

    d, AT = A.shape[1], np.ascontiguousarray(A.T)

    def density(x: FloatArray) -> tuple[float, FloatArray]:
        left = b - A @ x
        return -0.5 * float(left @ left), AT @ left

    draws, seconds = nuts_draws(density, d, tune=400, draws=1000, seed=seed)
    ess = min(float(arviz.ess(draws[None, :, j], method="bulk")) for j in range(d))
    return Self(draws, seconds * ENOUGH / ess)


def nuts_draws(
    density: Callable[[FloatArray], tuple[float, FloatArray]], d: int, **asked: Any
) -> tuple[FloatArray, float]:
    """Draws (m, d) of one chain of nutpie's NUTS from a log density with its gradient, and its seconds."""
    import nutpie  # pyright: ignore[reportMissingImports]
    from nutpie import compiled_pyfunc  # pyright: ignore[reportMissingImports]

    model = compiled_pyfunc.from_pyfunc(
        ndim=d,
        make_logp_fn=lambda: density,
        make_expand_fn=lambda *_: lambda x: {"x": x},
        expanded_dtypes=[np.dtype("float64")],
        expanded_shapes=[(d,)],
        expanded_names=["x"],
        make_initial_point_fn=lambda seed: np.random.default_rng(seed).normal(size=d),
    )
    start = time.perf_counter()
    trace: Any = nutpie.sample(model, chains=1, cores=1, save_warmup=False, progress_bar=False, **asked)
    seconds = time.perf_counter() - start
    return trace.posterior["x"].values[0], seconds
