"""The grid of extremes: problems that go from ordinary to the ends of what a double can hold."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.inference.linear import Rows
from imubayes.inference.prior import GFamily, GPrior, HyperG, ZellnerSiow
from imubayes.inference.whiten import Processes
from imubayes.sensors.equations.mapping import row
from imubayes.sensors.noise import Noise
from imubayes.sensors.terms import columns, library

ROWS = 48
"""Rows of most cases: few enough for exact arithmetic."""

DEGREE = np.pi / 180.0
GRAVITY = 9.80665
"""m/s^2."""


@dataclass(frozen=True, slots=True, eq=False)
class Stamps:
    """When rows with coloured noise were taken, and the noise."""

    rows: Rows
    noise: Noise
    parts: Processes

    @property
    def plain(self) -> bool:
        """Whether the noise is white and of unit variance in every row, so that whitening changes nothing."""
        unit = bool(np.all(self.rows.duration == self.noise.N**2))
        return unit and self.noise.B == self.noise.K == 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """One problem: columns `X` (n, p), which may be in single precision, and a response `y` (n,).

    Attributes
    ----------
    family, label : what is driven to an extreme, and how far.
    sd : (p,) prior sds in the columns' units.
    always : leading columns that are in every model.
    doublings : how often the rows are stacked on themselves: 2^doublings copies of each.
    stamps : of rows with coloured noise of known scale; None for white noise of unknown scale.
    condition : of the equilibrated columns where it was chosen; None where it was not.
    prior : of the g-family, in place of the physical one; None for that.
    """

    family: str
    label: str
    X: NDArray[np.floating]
    y: NDArray[np.floating]
    sd: FloatArray
    always: int = 0
    doublings: int = 0
    stamps: Stamps | None = None
    condition: float | None = None
    prior: GFamily | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(f"x{j}" for j in range(self.X.shape[1]))


def _regular(rng: np.random.Generator, p: int = 3, n: int = ROWS) -> FloatArray:
    return rng.normal(size=(n, p))


def _case(
    family: str, label: str, X: FloatArray, rng: np.random.Generator, *, noise: float = 1.0, always: int = 0
) -> Case:
    """Coefficients whose effects are 30, 3 and 0 noise sd over all rows, in turn; priors ten times wider."""
    size = np.sqrt(len(X)) * np.abs(X).max(axis=0)
    unit = noise / np.where(size > 0.0, size, 1.0)
    theta = np.resize([30.0, 3.0, 0.0], X.shape[1]) * unit
    y = X @ theta + noise * rng.normal(size=len(X))
    return Case(family, label, X, y, 300.0 * unit, always)


def conditions(rng: np.random.Generator) -> Iterator[Case]:
    """Yield columns whose smallest singular value falls to rounding."""
    for k in range(17):
        U = np.linalg.qr(_regular(rng))[0]
        V = np.linalg.qr(_regular(rng, 3, 3))[0]
        X = U * [1.0, 10.0 ** (-k / 2), 10.0**-k] @ V.T
        made = _case("condition", f"1e{k}", X, rng)
        yield replace(made, condition=10.0**k)


def inputs(rng: np.random.Generator) -> Iterator[Case]:
    """Yield powers and products of specific forces from 1e-6 g to 1e5 g."""
    lib = library("accelerometer", powers=3, asymmetry=1)
    for k in range(-6, 6):
        f = 10.0**k * GRAVITY * rng.uniform(-1.0, 1.0, size=(3, ROWS))
        X = columns(lib, dict(zip(("f_i", "f_j", "f_k"), f, strict=True)), ROWS)
        taken = [lib.names.index(name) for name in ("b0", "b1", "b3", "c_ij")]
        yield _case("specific force, g", f"1e{k}", X[:, taken], rng, noise=1e-3)


def rates(rng: np.random.Generator) -> Iterator[Case]:
    """Yield powers and products of rates from 1e-9 to 1e5 deg/s."""
    lib = library("gyroscope", powers=3, asymmetry=1)
    for k in range(-9, 6):
        w = 10.0**k * DEGREE * rng.uniform(-1.0, 1.0, size=(3, ROWS))
        X = columns(lib, dict(zip(("w_i", "w_j", "w_k"), w, strict=True)), ROWS)
        taken = [lib.names.index(name) for name in ("b0", "b1", "b3", "c_jk")]
        yield _case("rate, deg/s", f"1e{k}", X[:, taken], rng, noise=1e-6)


def noises(rng: np.random.Generator) -> Iterator[Case]:
    """Yield noise from 1e-12 to 1e2 beside coefficients of one."""
    for k in range(-12, 3):
        X = _regular(rng)
        y = X @ [1.0, -0.5, 0.0] + 10.0**k * rng.normal(size=ROWS)
        yield Case("noise", f"1e{k}", X, y, np.ones(3))


def powers(rng: np.random.Generator) -> Iterator[Case]:
    """Yield powers to 12 of an input of one sign, the two highest in question."""
    for k in range(1, 13):
        u = rng.uniform(0.0, 20.0, size=ROWS)
        X = columns(library("accelerometer", powers=k, asymmetry=-1), {"f_i": u}, ROWS)[:, : k + 1]
        yield _case("powers", f"{k}", X, rng, always=k - 1)


def widths(rng: np.random.Generator) -> Iterator[Case]:
    """Yield priors of 1e-12 to 1e12, alike, and of both ends beside each other."""
    X = _regular(rng)
    X[:, 2] += X[:, 0]
    y = X @ [1.0, 0.1, 0.0] + rng.normal(size=ROWS)
    for k in range(-12, 13, 2):
        yield Case("prior width", f"1e{k}", X, y, np.full(3, 10.0**k))
    yield Case("prior width", "1e±12", X, y, np.array([1e12, 1e-12, 1.0]))
    yield Case("prior width", "1e∓12", X, y, np.array([1e-12, 1e12, 1e12]))


def rows(rng: np.random.Generator) -> Iterator[Case]:
    """Yield one row to 1e9, the long ones by stacking factors on themselves."""
    for n in (1, 2, 3, 4, 6):
        yield replace(_case("rows", f"{n}", _regular(rng, 3, n), rng), sd=np.ones(3))
    for n in (1, 2):
        X = _regular(rng, 3, n)
        yield Case("rows", f"{n}, prior fits", X, X @ [0.5, 0.2, 0.0] + 0.1 * rng.normal(size=n), np.ones(3))
    for doublings in range(0, 27, 2):
        yield _stacked(rng, doublings)


def _stacked(rng: np.random.Generator, doublings: int, n: int = 16) -> Case:
    """Rows to be stacked on themselves, with effects of 30, 2 and 1 noise sd over all the copies."""
    X = _regular(rng, 3, n)
    Q = np.linalg.qr(X)[0]
    noise = rng.normal(size=n)
    unit = 1.0 / np.sqrt(n * 2.0**doublings)
    y = noise - Q @ (Q.T @ noise) + X @ (np.array([30.0, 2.0, 1.0]) * unit)
    return Case("rows", f"{n * 2**doublings:.0e}", X, y, np.full(3, 300.0 * unit), doublings=doublings)


def alike(rng: np.random.Generator) -> Iterator[Case]:
    """Yield zero, constant, duplicate, opposite, summed and nearly equal columns."""
    plain = _regular(rng)
    one = np.ones(ROWS)
    other = rng.normal(size=ROWS)
    made: dict[str, Sequence[FloatArray]] = {
        "zero": (plain[:, 0], 0.0 * one, plain[:, 1]),
        "constant": (one, plain[:, 0], 7.0 * one),
        "duplicate": (plain[:, 0], plain[:, 1], plain[:, 0]),
        "opposite": (plain[:, 0], plain[:, 1], -plain[:, 0]),
        "sum of two": (plain[:, 0], plain[:, 1], plain[:, 0] + plain[:, 1]),
    }
    made |= {
        f"equal to 1e-{k}": (plain[:, 0], plain[:, 1], plain[:, 0] + 10.0**-k * other) for k in (4, 8, 12, 15)
    }
    for label, taken in made.items():
        yield _case("columns", label, np.column_stack(taken), rng)


def exact_fits(rng: np.random.Generator) -> Iterator[Case]:
    """Yield no noise at all: integers that fit exactly, doubles that fit to rounding, no response."""
    whole = rng.integers(-9, 10, size=(ROWS, 3)).astype(float)
    plain = _regular(rng)
    yield Case("noise 0", "integers", whole, whole @ [2.0, -1.0, 0.0], np.ones(3))
    yield Case("noise 0", "integers, all in", whole, whole @ [2.0, -1.0, 3.0], np.ones(3))
    yield Case("noise 0", "rounded", plain, plain @ [1.0, -0.3, 0.0], np.ones(3))
    yield Case("noise 0", "no response", plain, np.zeros(ROWS), np.ones(3))


def misalignments(rng: np.random.Generator) -> Iterator[Case]:
    """Yield a direction vector at angles that go to zero, noise a thousandth of them."""
    f = GRAVITY * np.array([rng.uniform(-1.0, 1.0, ROWS) for _ in range(3)]).T
    for k in (0, 1, 2, 3, 4, 6, 8, 12, 20, 100, 300):
        alpha = 10.0**-k
        y = f @ row(0.0, alpha, -0.5 * alpha) + alpha * 1e-3 * rng.normal(size=ROWS)
        yield Case("misalignment, rad", f"1e-{k}", f, y, np.full(3, alpha))
    yield Case("misalignment, rad", "0", f, 1e-3 * rng.normal(size=ROWS), np.full(3, 1e-3))


def magnitudes(rng: np.random.Generator) -> Iterator[Case]:
    """Yield columns and responses of 1e-300 and 1e300, alone and beside each other."""
    X = _regular(rng)
    y = X @ [1.0, 0.1, 0.0] + rng.normal(size=ROWS)
    for label, column, response in (
        ("columns 1e-300", [1e-300] * 3, 1.0),
        ("columns 1e300", [1e300] * 3, 1.0),
        ("columns 1e±300", [1e300, 1.0, 1e-300], 1.0),
        ("response 1e-300", [1.0] * 3, 1e-300),
        ("response 1e300", [1.0] * 3, 1e300),
        ("all 1e-300", [1e-300] * 3, 1e-300),
        ("all 1e300", [1e300] * 3, 1e300),
        ("1e150, response 1e-150", [1e150] * 3, 1e-150),
    ):
        yield Case("magnitude", label, X * column, y * response, response / np.array(column))


def singles(rng: np.random.Generator) -> Iterator[Case]:
    """Yield inputs in single precision, columns regular and nearly alike."""
    for label, apart in (("regular", 1.0), ("alike to 1e-3", 1e-3), ("alike to 1e-6", 1e-6)):
        X = _regular(rng)
        X[:, 2] = X[:, 0] + apart * X[:, 2]
        single = X.astype(np.float32)
        made = _case("single precision", label, single.astype(float), rng)
        yield replace(made, X=single, y=made.y.astype(np.float32))


def stamps(rng: np.random.Generator) -> Iterator[Case]:
    """Yield coloured noise at time stamps from 0 to 1e9 s, whitened by differences of time."""
    n, interval = 24, 0.25
    noise = Noise(0.1, 0.05, 0.02)
    parts = Processes(np.array([0.3, 0.5]), np.array([0.6, 12.0]))
    for label, start in (("0", 0.0), ("1e3", 1e3), ("1e6", 1e6), ("1e9", 1e9)):
        t = start + interval * np.arange(1, n + 1) + np.where(np.arange(n) > 11, 300.0, 0.0)
        made = _case("time stamps, s", label, np.column_stack((np.ones(n), rng.normal(size=(n, 2)))), rng)
        when = Rows(np.asarray(t, dtype=np.float64), np.full(n, interval))
        yield replace(made, stamps=Stamps(when, noise, parts))


def long_records(rng: np.random.Generator) -> Iterator[Case]:
    """Yield arrays of 4,097 to 1e5 rows, and runs of as many that are whitened, columns nearly dependent.

    The runs have white noise of unit variance a row, which whitens them without a rounding: the reference can
    take the very doubles of the table.
    """
    for n, p, k in ((4097, 3, 10), (20_000, 3, 8), (20_000, 3, 10), (50_000, 4, 0), (100_000, 4, 10)):
        yield _nearly_dependent(rng, n, p, k)
    for n, p, k in ((40, 3, 10), (4097, 3, 10), (20_000, 3, 6), (50_000, 4, 10), (100_000, 3, 10)):
        yield _as_run(_nearly_dependent(rng, n, p, k))


def _as_run(case: Case) -> Case:
    """Rows that come as a run with white noise of unit variance."""
    n = len(case.y)
    when = Rows(np.asarray(0.25 * np.arange(1, n + 1), dtype=np.float64), np.full(n, 0.25))
    white = Stamps(when, Noise(0.5, 0.0, 0.0), Processes(np.empty(0), np.empty(0)))
    return replace(case, label=f"run {case.label}", stamps=white)


def _nearly_dependent(rng: np.random.Generator, n: int, p: int, k: int) -> Case:
    """Rows whose columns have a condition number of 10^k."""
    U = np.linalg.qr(_regular(rng, p, n))[0]
    V = np.linalg.qr(_regular(rng, p, p))[0]
    X = U * 10.0 ** -np.linspace(0.0, k, p) @ V.T
    made = _case("long records", f"{n:,}, 1e{k}", X, rng)
    return replace(made, condition=10.0**k)


def many_columns(rng: np.random.Generator) -> Iterator[Case]:
    """Yield eight candidates, which are weighed by products, alone and beside two that are always in."""
    for k in (0, 10):
        yield replace(_nearly_dependent(rng, 200, 8, k), family="eight candidates", label=f"1e{k}")
    made = _nearly_dependent(rng, 5000, 10, 10)
    yield replace(_as_run(made), family="eight candidates", label="run, 2 always", always=2)


def g_family(rng: np.random.Generator) -> Iterator[Case]:
    """Yield priors of the g-family: fixed, with tails that hardly end, and narrow ones."""
    for n, noise in ((12, 1.0), (400, 1.0), (20, 1e-6)):
        X = _regular(rng, 3, n)
        y = X @ (np.array([3.0, 1.2, 0.0]) / np.sqrt(n)) + noise * rng.normal(size=n)
        for label, prior in _g_priors(n).items():
            yield Case("g-family", f"{label}, {n} rows", X, y, np.ones(3), prior=prior)


def _g_priors(n: int) -> dict[str, GFamily]:
    hyper = {f"hyper g {a:g}": HyperG(a) for a in (3.0, 2.01, 40.0)}
    return {"g = n": GPrior(float(n)), **hyper, "Zellner, Siow": ZellnerSiow(1.0)}


FAMILIES: dict[str, Callable[[np.random.Generator], Iterator[Case]]] = {
    "condition": conditions,
    "specific force": inputs,
    "rate": rates,
    "noise": noises,
    "powers": powers,
    "prior width": widths,
    "rows": rows,
    "columns": alike,
    "noise 0": exact_fits,
    "misalignment": misalignments,
    "magnitude": magnitudes,
    "single precision": singles,
    "time stamps": stamps,
    "long records": long_records,
    "eight candidates": many_columns,
    "g-family": g_family,
}
"""Every family of the grid by its name in a study."""


def cases(families: Sequence[str], *, seed: int, every: int = 1) -> Iterator[Case]:
    """Yield the cases of the families: of each the first, then every so many, and the last."""
    for name in families:
        number = list(FAMILIES).index(name)
        made = list(FAMILIES[name](np.random.default_rng([seed, number])))
        yield from (one for k, one in enumerate(made) if k % every == 0 or k == len(made) - 1)
