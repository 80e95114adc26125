"""The posterior of a campaign from every row, as one would write it who has no factor.

Two problems. Noise given: the rows are whitened beforehand, and a density is one product of a matrix.
Noise free: N, B and K of each run are parameters under the class's log-normal prior, and a density factors
the covariance of all rows with celerite2, whose own reverse derivatives give the gradient.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from celerite2 import driver  # pyright: ignore[reportAttributeAccessIssue]: a compiled module without stubs
from numba import njit

from imubayes.algebra import FloatArray
from imubayes.inference.linear import Linear
from imubayes.inference.mcmc.density import Density, log_joint
from imubayes.inference.whiten import processes, whiten
from imubayes.sensors.noise import Noise, NoisePrior


@dataclass(frozen=True, slots=True, eq=False)
class Coordinates:
    """Parameters are ``center + basis x``, with independent normal priors of this mean and sd (d,).

    The center (d,) is that of the posterior at given noise: coefficients, SI, then ln N, ln B, ln K of each
    run.
    """

    center: FloatArray
    basis: FloatArray
    mean: FloatArray
    sd: FloatArray

    def __len__(self) -> int:
        return len(self.center)

    def parameters(self, x: FloatArray) -> FloatArray:
        """Parameters (..., d) at the coordinates x (..., d)."""
        return self.center + x @ self.basis.T


@dataclass(frozen=True, slots=True, eq=False)
class GivenNoise:
    """Log density of d coefficients at given noise; their prior is d more rows.

    `A` (d, n + d) are the whitened rows in the coordinates, a row a column: products are twice as fast so;
    `b` (n + d,) is the whitened response.
    """

    coordinates: Coordinates
    A: FloatArray
    b: FloatArray

    def values(self, x: FloatArray) -> FloatArray:
        """Log density (m,) at the coordinates x (m, d), in one product of matrices."""
        left = x @ self.A
        left -= self.b
        return -0.5 * np.einsum("ij,ij->i", left, left)

    def gradient(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Log density and its gradient (d,) at the coordinates x (d,)."""
        left = self.b - x @ self.A
        return -0.5 * float(left @ left), self.A @ left


@dataclass(frozen=True, slots=True, eq=False)
class FreeRun:
    """Rows of a run whose N, B and K are free.

    The covariance ``diag(a) + tril(U V') + triu(V U')`` is linear in N^2, B^2 and K^2.

    Attributes
    ----------
    t : (n,) s.
    c : (m,) rates at which the columns of U and V decay, 1/s.
    a : (n, 3) diagonal by N^2, B^2, K^2.
    U, V : (n, m); V by B^2, its last column by K^2.
    decay : (n, m) of these columns since the row before.
    X : (n, p) columns.
    y : (n,) response.
    """

    t: FloatArray
    c: FloatArray
    a: FloatArray
    U: FloatArray
    V: FloatArray
    decay: FloatArray
    X: FloatArray
    y: FloatArray

    def value(self, theta: FloatArray, log_noise: FloatArray) -> float:
        """Log likelihood at the coefficients (p,) and ln N, ln B, ln K (3,), up to a constant."""
        z, d, _ = self._whitened(theta, np.exp(2.0 * log_noise))
        return -0.5 * float(np.sum(z * z / d) + np.sum(np.log(d)))

    def gradient(self, theta: FloatArray, log_noise: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        """Log likelihood and its gradients by the coefficients (p,) and by ln N, ln B, ln K (3,)."""
        squares = np.exp(2.0 * log_noise)
        z, d, W = self._whitened(theta, squares)
        by_r, by_a, by_V = _reverse(self.decay, self.U, z, d, W)
        by_column = np.einsum("ij,ij->j", by_V, self.V)
        by_square = by_a @ self.a + np.array([0.0, by_column[:-1].sum(), by_column[-1]])
        value = -0.5 * float(np.sum(z * z / d) + np.sum(np.log(d)))
        return value, -(by_r @ self.X), 2.0 * squares * by_square

    def _whitened(self, theta: FloatArray, squares: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Residual ``z = L^-1 r`` and the factor ``L D L'``, of which W is what celerite2 keeps of L."""
        a, V = self.a @ squares, self.V * self._by_column(squares)
        d, W = driver.factor(self.t, self.c, a, self.U, V, a, V)
        z = (self.y - self.X @ theta)[:, None]
        driver.solve_lower(self.t, self.c, self.U, W, z, z)
        return z[:, 0], d, W

    def _by_column(self, squares: FloatArray) -> FloatArray:
        return np.append(np.full(len(self.c) - 1, squares[1]), squares[2])


@dataclass(frozen=True, slots=True, eq=False)
class FreeNoise:
    """Log density of p coefficients and of three logarithms of noise for each run."""

    coordinates: Coordinates
    runs: tuple[FreeRun, ...]

    def values(self, x: FloatArray) -> FloatArray:
        """Log density (m,) at the coordinates x (m, d), one after the other."""
        return np.array([self._value(phi) for phi in self.coordinates.parameters(x)])

    def gradient(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Log density and its gradient (d,) at the coordinates x (d,)."""
        phi, scale = self.coordinates.parameters(x), self.coordinates
        theta, noise = self._split(phi)
        found = [run.gradient(theta, own) for run, own in zip(self.runs, noise, strict=True)]
        pull = (phi - scale.mean) / scale.sd
        slope = (
            np.concatenate((sum(part[1] for part in found), *(part[2] for part in found))) - pull / scale.sd
        )
        return sum(part[0] for part in found) - 0.5 * float(pull @ pull), slope @ scale.basis

    def _value(self, phi: FloatArray) -> float:
        theta, noise = self._split(phi)
        pull = (phi - self.coordinates.mean) / self.coordinates.sd
        likelihood = sum(run.value(theta, own) for run, own in zip(self.runs, noise, strict=True))
        return likelihood - 0.5 * float(pull @ pull)

    def _split(self, phi: FloatArray) -> tuple[FloatArray, FloatArray]:
        p = self.runs[0].X.shape[1]
        return phi[:p], phi[p:].reshape(-1, 3)


@dataclass(frozen=True, slots=True, eq=False)
class OnFactor:
    """The posterior of `FreeNoise` on our whitenings, in the coordinates of its density.

    An autocorrelation time is the posterior's and the move's, whatever a density costs: a chain long enough
    to tell it takes seconds here, and hours on every row.
    """

    coordinates: Coordinates
    density: Density

    def values(self, x: FloatArray) -> FloatArray:
        """Log density (m,) at the coordinates x (m, d)."""
        p = self.density.p
        logs = self.coordinates.parameters(x)[:, p:]
        return log_joint(self.density, x[:, :p], logs)


FullData = GivenNoise | FreeNoise


def given_noise(runs: Sequence[Linear], noise: Sequence[Noise], sd: FloatArray) -> GivenNoise:
    """Posterior of the coefficients at the noise of each run, in coordinates in which it is standard normal.

    Their prior sds are `sd` (p,), SI.
    """
    white = [_white(rows, own) for rows, own in zip(runs, noise, strict=True)]
    stacked = np.vstack((*white, np.column_stack((np.diag(1.0 / sd), np.zeros(len(sd))))))
    X, y = stacked[:, :-1], stacked[:, -1]
    Q, R = np.linalg.qr(X * sd)
    basis = sd[:, None] * np.linalg.inv(R)
    coordinates = Coordinates(basis @ (Q.T @ y), basis, np.zeros(len(sd)), sd)
    return GivenNoise(coordinates, basis.T @ np.ascontiguousarray(X.T), y - X @ coordinates.center)


def in_prior_scale(problem: GivenNoise) -> GivenNoise:
    """The same posterior in coefficients that are only divided by the sds of their prior."""
    old = problem.coordinates
    back = np.linalg.inv(old.basis)
    b = problem.b + (back @ old.center) @ problem.A
    plain = Coordinates(np.zeros(len(old)), np.diag(old.sd), old.mean, old.sd)
    return GivenNoise(plain, (back * old.sd).T @ problem.A, b)


def free_noise(
    runs: Sequence[Linear],
    given: GivenNoise,
    noise: Sequence[Noise],
    noise_sd: Sequence[tuple[float, float, float]],
    prior: NoisePrior,
) -> FreeNoise:
    """Posterior of the coefficients and of the noise of each run, in coordinates of about unit size.

    `given` is that of the coefficients at the `noise` of each run, whose logarithms have the sds `noise_sd`;
    the prior is that of N, B, K.
    """
    old, g = given.coordinates, len(runs)
    medians, spreads = np.array([*prior.values()]).T
    basis = np.diag(np.concatenate((np.ones(len(old)), *noise_sd)))
    basis[: len(old), : len(old)] = old.basis
    logs = [np.log([own.N, own.B, own.K]) for own in noise]
    coordinates = Coordinates(
        np.concatenate((old.center, *logs)),
        basis,
        np.concatenate((old.mean, np.tile(np.log(medians), g))),
        np.concatenate((old.sd, np.tile(spreads, g))),
    )
    return FreeNoise(coordinates, tuple(_free_run(*each) for each in zip(runs, noise, strict=True)))


def on_factor(problem: FreeNoise, density: Density) -> OnFactor:
    """The same posterior on our whitenings."""
    center, basis, p = problem.coordinates.center.copy(), problem.coordinates.basis.copy(), density.p
    center[:p], basis[:p, :p] = density.coordinates.origin, density.coordinates.inverse
    return OnFactor(replace(problem.coordinates, center=center, basis=basis), density)


def _free_run(rows: Linear, noise: Noise) -> FreeRun:
    taken = rows.rows
    parts = processes(taken, noise)
    T, walked = taken.duration, taken.t - taken.t[0] + 0.5 * taken.duration[0]
    x = T[:, None] / parts.tau
    averaging, one = 2.0 * np.sinh(0.5 * x) / x, np.ones(len(T))
    c = np.append(1.0 / parts.tau, 0.0)
    return FreeRun(
        t=taken.t - taken.t[0],
        c=c,
        a=np.column_stack((1.0 / T, parts.averaged(T), walked - T / 6.0)),
        U=np.column_stack((averaging, one)),
        V=np.column_stack((averaging * parts.variance, walked)),
        decay=np.exp(-np.diff(taken.t, prepend=taken.t[0])[:, None] * c),
        X=rows.columns(0, len(rows)),
        y=rows.y,
    )


def _white(rows: Linear, noise: Noise) -> FloatArray:
    """Whitened columns and response, (n, p + 1)."""
    table = np.column_stack((rows.columns(0, len(rows)), rows.y))
    return whiten(noise, rows.rows, table)[0]


@njit(nogil=True, cache=True)
def _reverse(decay, U, z, d, W):
    """Derivatives of the log likelihood by r (n,), the diagonal (n,) and V (n, m): celerite2's recursions.

    ``S' = decay (S + d W W') decay``, ``d = a - U S U'``, ``W = (V - U S) / d``,
    ``F' = decay (F + W z)`` and ``z = r - U F``, backwards.
    """
    n, m = U.shape
    by_r, by_a, by_V = np.empty(n), np.empty(n), np.empty((n, m))
    by_S, by_F, by_W = np.zeros((m, m)), np.zeros(m), np.empty(m)
    for i in range(n - 1, -1, -1):
        by_z, by_d = -z[i] / d[i], 0.5 * (z[i] ** 2 / d[i] - 1.0) / d[i]
        for j in range(m):
            across = 0.0
            for k in range(m):
                across += by_S[j, k] * W[i, k]
            by_W[j] = by_F[j] * z[i] + 2.0 * d[i] * across
            by_z += by_F[j] * W[i, j]
            by_d += W[i, j] * across - by_W[j] * W[i, j] / d[i]
        by_r[i], by_a[i] = by_z, by_d
        for j in range(m):
            by_V[i, j] = by_W[j] / d[i]
        for j in range(m):
            by_F[j] = decay[i, j] * (by_F[j] - by_z * U[i, j])
            for k in range(m):
                outer = by_d * U[i, j] * U[i, k] + 0.5 * (U[i, j] * by_V[i, k] + U[i, k] * by_V[i, j])
                by_S[j, k] = decay[i, j] * decay[i, k] * (by_S[j, k] - outer)
    return by_r, by_a, by_V
