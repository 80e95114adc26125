"""All that is emcee's: samplers, autocorrelation times, and checkpoints in its own file format.

A checkpoint is a whole file that takes the place of the one before: an interruption at any moment leaves the
last one, and the random numbers go on from where it was written, so that a resumed chain is the same chain.
`emcee.backends.HDFBackend` reads it, under the names ``ensemble_0`` and so on.

Walkers of one ensemble propose from each other, so they are no independent chains: the effective size comes
from emcee's autocorrelation time, averaged over the walkers, and split R-hat compares whole ensembles.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from imubayes.algebra.arrays import FloatArray
from imubayes.errors import InputError

LOOKED_AT = 16
"""Walkers that the autocorrelation time is taken from."""


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """What is sampled.

    Attributes
    ----------
    names : d parameters, in the order of the coordinates.
    log_prob : (m, d) -> (m,).
    moves : (kind, proposal or None, weight): ``independent`` with a proposal, ``differential``, ``stretch``.
    start : (generator, size) -> (size, d) first places.
    readable : (..., d) coordinates -> parameters that must mix.
    """

    names: tuple[str, ...]
    log_prob: Callable[[FloatArray], FloatArray]
    moves: tuple[tuple[str, Any, float], ...]
    start: Callable[[np.random.Generator, int], FloatArray]
    readable: Callable[[FloatArray], FloatArray]


def sampler_of(target: Target, walkers: int, backend: Any = None) -> Any:
    """Emcee's sampler of a target, with the chain that it has so far, if any."""
    import emcee

    made = {
        "independent": lambda proposal: emcee.moves.MHMove(
            lambda coords, random: proposal(coords, random), ndim=len(target.names)
        ),
        "differential": lambda _: emcee.moves.DEMove(),
        "stretch": lambda _: emcee.moves.StretchMove(),
    }
    moves = [(made[kind](proposal), weight) for kind, proposal, weight in target.moves]
    return emcee.EnsembleSampler(
        walkers, len(target.names), target.log_prob, moves=moves, backend=backend, vectorize=True
    )


def autocorrelation_time(chain: FloatArray) -> FloatArray:
    """Integrated autocorrelation time (d,) in steps of a chain (steps, walkers, d); 1 at least.

    It is averaged over some walkers: all of them would sharpen it by little, and cost as much as sampling.
    """
    from emcee.autocorr import integrated_time

    chain = chain[:, :LOOKED_AT]
    moved = np.ptp(chain, axis=0) > 0.0
    # a walker that has not moved yet may take as long as the chain, or longer; a constant takes no time
    tau = np.where(moved.any(axis=0), float(len(chain)), 1.0)
    whole = moved.all(axis=0)
    if whole.any():
        tau[whole] = np.maximum(integrated_time(chain[:, :, whole], tol=0), 1.0)
    return tau


def save(file: Path, backends: Sequence[Any], seconds: float, fingerprint: str) -> None:
    """Write the chains of all ensembles to a file, and put it in the place of the one before.

    Raises
    ------
    InputError : if it cannot be written.
    """
    import h5py
    from emcee.backends import HDFBackend

    copy = file.with_suffix(".part")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        copy.unlink(missing_ok=True)
        for k, backend in enumerate(backends):
            _write(HDFBackend(str(copy), name=f"ensemble_{k}"), backend)
        with h5py.File(copy, "a") as stream:
            stream.attrs.update({"seconds": seconds, "fingerprint": fingerprint})
        with copy.open("rb+") as stream:
            os.fsync(stream.fileno())
        copy.replace(file)
    except OSError as problem:
        raise InputError(
            f"{file}: the checkpoint cannot be written ({problem}): choose another --out"
        ) from None


def load(file: Path, shape: tuple[int, int, int], fingerprint: str) -> tuple[tuple[Any, ...], float]:
    """Read the chains of a checkpoint: a backend for each ensemble, and the seconds that they took.

    Parameters
    ----------
    file : of the chains.
    shape : ensembles, walkers of each, and dimensions.
    fingerprint : of the problem.

    Raises
    ------
    InputError : if there is none, it cannot be read, or it is of another problem.
    """
    import h5py
    from emcee.backends import HDFBackend

    if not file.exists():
        raise InputError(f"{file}: there is no checkpoint to resume: run without --resume")
    try:
        with h5py.File(file) as stream:
            seconds, found = float(str(stream.attrs["seconds"])), stream.attrs["fingerprint"]
            kept = {
                (len(stream), int(group.attrs["nwalkers"]), int(group.attrs["ndim"]))
                for group in stream.values()
            }
    except (OSError, KeyError) as problem:
        raise InputError(
            f"{file}: is not a checkpoint that can be read ({problem}): run without --resume"
        ) from None
    if kept != {shape} or found != fingerprint:
        raise InputError(
            f"{file}: was made by another study, seed or method: run without --resume to start anew"
        )
    names = [f"ensemble_{k}" for k in range(shape[0])]
    return tuple(_read(HDFBackend(str(file), name=n, read_only=True)) for n in names), seconds


def _write(into: Any, backend: Any) -> None:
    """Fill an empty file's ensemble with all steps at once."""
    into.reset(*backend.shape)
    into.grow(backend.iteration, None)
    with into.open("a") as stream:
        group = stream[into.name]
        group["chain"][...] = backend.get_chain()
        group["log_prob"][...] = backend.get_log_prob()
        group["accepted"][...] = backend.accepted
        group.attrs["iteration"] = backend.iteration
        for k, value in enumerate(backend.random_state):
            group.attrs[f"random_state_{k}"] = value


def _read(source: Any) -> Any:
    """Read an ensemble into memory."""
    from emcee.backends import Backend

    backend = Backend()
    backend.reset(*source.shape)
    backend.chain, backend.log_prob = source.get_chain(), source.get_log_prob()
    backend.accepted, backend.iteration = source.accepted, source.iteration
    backend.random_state = source.random_state
    return backend


LONG = 50.0
"""Steps in autocorrelation times below which emcee's estimate of that time is not to be trusted."""


def effective_size(chains: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Effective sample size and autocorrelation time (d,) of several ensembles (steps, walkers, d)."""
    taus = np.array([autocorrelation_time(chain) for chain in chains])
    sizes = np.array([chain.shape[0] * chain.shape[1] for chain in chains])
    return np.sum(sizes[:, None] / taus, axis=0), taus.max(axis=0)


def split_rhat(chains: list[FloatArray]) -> FloatArray:
    """Split R-hat (d,) over ensembles (steps, walkers, d): both halves of each one count as chains.

    Gelman et al., Bayesian Data Analysis (2013), section 11.4, with all walkers of an ensemble as one chain.
    """
    half = min(len(chain) for chain in chains) // 2
    d = chains[0].shape[2]
    if half < 1:
        return np.full(d, np.inf)
    parts = [part.reshape(-1, d) for chain in chains for part in (chain[:half], chain[-half:])]
    n = len(parts[0])
    means = np.array([part.mean(axis=0) for part in parts])
    within = np.mean([part.var(axis=0, ddof=1) for part in parts], axis=0)
    between = n * means.var(axis=0, ddof=1)
    still = within == 0.0
    pooled = (n - 1.0) / n * within + between / n
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(still, np.where(between == 0.0, 1.0, np.inf), np.sqrt(pooled / within))
