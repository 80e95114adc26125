"""Does the model explain the data to the noise floor? Tests on the whitened residuals of each run.

Many tests raise false alarms by their number. All residual tests of a study (of each run its whiteness, its
size, blocks that stand out; of each sensor what the residuals depend on, and what the posterior predicts)
divide one level, `SUSPECT`: each is held against its part of it (Bonferroni), so that of studies whose models
are right no more than that share gives an alarm at all.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.algebra.factor import reorder
from imubayes.inference.allan import allan_deviation
from imubayes.inference.linear import Linear, Rows, block_edges, residuals, stretch_of
from imubayes.inference.noise_model import NORMAL_MEDIAN
from imubayes.inference.summary import RunSummary
from imubayes.inference.whiten import whiten
from imubayes.rig.inputs import between_gaps
from imubayes.sensors.noise import allan_variance

LAGS = 20
"""Lags of the Ljung-Box test and of the autocorrelation that is shown."""

SHOWN = 400
"""Blocks that residuals are averaged to for the figures and the test for outliers."""

SUSPECT = 0.01
"""Probability of a false alarm among all tests that share it: those of a study, or one alone."""

TESTS = 3
"""Tests of a run by which it fits: whiteness, size, blocks that stand out."""

FAMILIES = 3
"""Families of tests that share a sensor's part of the level: by run, on inputs and time, on replicates."""

TAKEN = 0.25
"""Share of the blocks beyond which a fit takes so many degrees of freedom that it correlates what is left."""

LEAST = 3.0
"""Degrees of freedom that a fit must leave for the size of the residuals to say something."""

OFF = 0.15
"""Relative error of the noise level that is tolerated at least: what a few hundred blocks can tell."""

STANDARD_ERRORS = 4.0
"""Standard errors of the noise level that are tolerated at least where blocks are few."""


@dataclass(frozen=True, slots=True, eq=False)
class ResidualCheck:
    """Residuals of one run under the full library, whitened by its noise model.

    Attributes
    ----------
    run : name of the run.
    scale : rms of the whitened residuals, averaged over blocks; 1 at the noise floor. NaN where the fit
        leaves too few degrees of freedom.
    whiteness_p : p-value of the Ljung-Box test on the blocks: does something vary from dwell to dwell that
        neither the library nor the noise contains? NaN where the fit itself correlates what is left.
    normality_p : p-value of the Jarque-Bera test on the blocks.
    sample_scale, sample_whiteness_p : the same on samples, where a sensor's own filter shows.
    lags : (m,) lags in blocks of `autocorrelation`.
    autocorrelation : (m,) of the blocks.
    tau, deviation, expected : (k,) averaging times in s, Allan deviation of the raw residuals, and that of
        the fitted noise, in SI.
    t, shown : (q,) time in s and whitened residual, averaged over blocks to at most a few hundred points
        and scaled so that each has unit variance if the noise is white.
    outliers : (start in s, stop in s, size in sd) of blocks beyond what chance allows, worst first.
    fits : verdict on the run: white and of the right size.
    misstated : how far rows scatter beyond the noise that the study states (see `excess`); 1 where they
        do not, or none is stated.
    level : probability of a false alarm of each of its tests, by which it fits or does not.
    """

    run: str
    scale: float
    whiteness_p: float
    normality_p: float
    sample_scale: float
    sample_whiteness_p: float
    lags: NDArray[np.int64]
    autocorrelation: FloatArray
    tau: FloatArray
    deviation: FloatArray
    expected: FloatArray
    t: FloatArray
    shown: FloatArray
    outliers: tuple[tuple[float, float, float], ...]
    fits: bool
    misstated: float = 1.0
    level: float = SUSPECT

    @property
    def white(self) -> bool:
        """Whether chance explains what varies from block to block."""
        return not self.whiteness_p < self.level

    @property
    def weak(self) -> bool:
        """Whether all that is wrong, if anything is, is a noise weaker than its model."""
        return self.white and not self.outliers and self.scale < 1.0


def level_of(share: int, runs: int) -> float:
    """Level of each test of a run: `share` families divide the study's level, and `runs` runs that of theirs.

    Examples
    --------
    >>> round(level_of(1, 8), 6)  # 24 tests, and no other family
    0.000417
    """
    return SUSPECT / (share * TESTS * max(runs, 1))


def check_runs(
    rows: Sequence[Linear], theta: FloatArray, summaries: Sequence[RunSummary], *, cov: FloatArray, share: int
) -> tuple[ResidualCheck, ...]:
    """Test every run of a fit, `share` families and the runs dividing the study's level (see `level_of`).

    `theta` (p,) are coefficients of all columns, SI, and `cov` as `check_residuals` takes it.
    """
    level = level_of(share, len(rows))
    pairs = zip(rows, summaries, strict=True)
    return tuple(check_residuals(one, theta, run, cov=cov, level=level) for one, run in pairs)


def excess(rows: Linear, theta: FloatArray, summary: RunSummary) -> float:
    """Scatter of the rows of a run from each to the next over that by its noise; 1 where it is no larger.

    It is the median of second differences, in which what a library lacks has no part while it changes evenly.
    `theta` (p,) as `check_runs` takes it.
    """
    held = stretch_of(rows)
    raw, parts = residuals(held, theta), between_gaps(held.t, held.interval)
    turns = np.abs(np.concatenate([np.diff(raw[start:stop], 2) for start, stop in parts]))
    if not len(turns):
        return 1.0
    # thrice the variance of a difference, of white noise; less of others
    variance = 6.0 * allan_variance(asdict(summary.noise), np.array([held.interval]))[0]
    ratio = float(np.median(turns)) / (NORMAL_MEDIAN * math.sqrt(variance))
    return ratio if ratio > 1.0 + max(OFF, 2.0 * STANDARD_ERRORS / math.sqrt(len(turns))) else 1.0


def check_residuals(
    rows: Linear,
    theta: FloatArray,
    summary: RunSummary,
    *,
    cov: FloatArray | None = None,
    level: float = SUSPECT,
) -> ResidualCheck:
    """Test the residuals of a run under the coefficients `theta` (p,) of all columns, SI.

    Where the run takes part in determining coefficients of the covariance `cov` (p, p), that takes
    ``tr(X cov X')`` degrees of freedom of its whitened rows X; None where they are known from elsewhere. The
    covariance is that by the noise of the summary, not by what the rows scatter by.
    `level` is the probability of a false alarm of each test.
    """
    R = reorder(summary.factor, rows.names).R[:-1, :-1]
    fitted = 0.0 if cov is None else float(np.sum((R @ cov) * R))
    own = replace(summary, interval=rows.interval)
    check = _judged(residuals(rows, theta), rows.rows, own, fitted, level)
    if rows.stream is None:
        return check
    # rows are averages over blocks: samples are looked at on a stretch at full rate
    held = stretch_of(rows)
    fine = _judged(residuals(held, theta), held.rows, summary, 0.0, SUSPECT)
    shorter, curves = fine.tau < rows.interval, ("tau", "deviation", "expected")
    return replace(
        check,
        sample_scale=fine.sample_scale,
        sample_whiteness_p=fine.sample_whiteness_p,
        **{name: np.append(getattr(fine, name)[shorter], getattr(check, name)) for name in curves},
    )


def _judged(raw: FloatArray, rows: Rows, summary: RunSummary, fitted: float, level: float) -> ResidualCheck:
    """Test raw residuals (n,) of rows, SI, of which a fit took so many degrees of freedom."""
    from scipy.special import ndtri

    white = whiten(summary.noise, rows, raw[:, None].copy())[0][:, 0]
    edges = block_edges(rows.t, summary.interval, SHOWN)
    counts = np.diff(np.append(edges, len(white)))
    shown = np.add.reduceat(white, edges) / np.sqrt(counts)
    dof = max(len(shown) - fitted, 1.0)
    size = math.sqrt(float(shown @ shown) / dof)
    scale = size if dof >= LEAST else math.nan
    errors = max(STANDARD_ERRORS, float(-ndtri(0.5 * level)))
    tolerated = max(OFF, errors / math.sqrt(2.0 * dof))
    lags, correlation = _autocorrelation(shown)
    whiteness = _ljung_box(shown) if fitted <= TAKEN * len(shown) else math.nan
    t = np.add.reduceat(rows.t, edges) / counts
    outliers = _outliers(t, shown / (size or 1.0), counts * summary.interval, level)
    tau, measured = allan_deviation(raw, rows.t, summary.interval)
    return ResidualCheck(
        run=summary.name,
        scale=scale,
        whiteness_p=whiteness,
        normality_p=_jarque_bera(shown),
        sample_scale=math.sqrt(float(white @ white) / len(white)),
        sample_whiteness_p=_ljung_box(white),
        lags=lags,
        autocorrelation=correlation,
        tau=tau,
        deviation=measured,
        expected=np.sqrt(allan_variance(asdict(summary.noise), tau)),
        t=t,
        shown=shown,
        outliers=outliers,
        fits=not (whiteness < level or abs(scale - 1.0) >= tolerated or outliers),
        level=level,
    )


def _autocorrelation(white: FloatArray) -> tuple[NDArray[np.int64], FloatArray]:
    lags = np.arange(1, min(LAGS, len(white) - 1) + 1)
    centred = white - white.mean()
    power = float(centred @ centred) or 1.0
    return lags, np.array([float(centred[k:] @ centred[:-k]) for k in lags]) / power


def _ljung_box(white: FloatArray) -> float:
    """p-value that the autocorrelations of the first lags are chance."""
    from scipy.special import chdtrc

    n = len(white)
    lags, r = (values[: max(1, n // 5)] for values in _autocorrelation(white))
    return float(chdtrc(len(lags), n * (n + 2.0) * np.sum(r**2 / (n - lags))))


def _jarque_bera(values: FloatArray) -> float:
    """p-value that skewness and kurtosis of normal values are so far from theirs; 1 where nothing varies."""
    left, sd = values - values.mean(), float(values.std())
    if sd == 0.0:
        return 1.0
    skewness, kurtosis = (float(np.mean((left / sd) ** power)) for power in (3, 4))
    # chi-squared with two degrees of freedom
    return math.exp(-len(values) / 12.0 * (skewness**2 + 0.25 * (kurtosis - 3.0) ** 2))


def _outliers(
    t: FloatArray, z: FloatArray, length: FloatArray, level: float
) -> tuple[tuple[float, float, float], ...]:
    """Blocks farther out than chance allows among so many, worst first: (start, stop, sds)."""
    from scipy.special import ndtri

    beyond = np.flatnonzero(np.abs(z) > -ndtri(0.5 * level / len(z)))
    worst = beyond[np.argsort(-np.abs(z[beyond]))]
    return tuple((float(t[i] - length[i] / 2.0), float(t[i] + length[i] / 2.0), float(z[i])) for i in worst)
