"""Noise of an exported IMU: Kalibr's file, and the Gauss-Markov process that stands for bias instability."""

from __future__ import annotations

import math
from collections.abc import Iterator

from imubayes.errors import InputError
from imubayes.reporting.export.characterized import Characterized, Part
from imubayes.reporting.export.heading import heading, identifier
from imubayes.sensors.noise import FLOOR, Noise

PEAK = 0.61736
"""Allan deviation of a first-order Gauss-Markov process at its peak, over the process's sd."""

PEAK_AT = 1.8926
"""Averaging time of that peak, over the process's time constant."""

TYPICAL = 100.0
"""s; time constant where N or K is zero, so that nothing tells where the floor lies."""


def kalibr_files(found: Characterized) -> dict[str, str]:
    """Text of Kalibr's (and ROS tools') ``imu.yaml`` by its file name.

    Kalibr has one figure for a triad: the largest over the axes. It refuses a random walk of zero: where the
    result has none, it is that of the process that stands for the bias instability, below its time constant.

    Raises
    ------
    InputError : if the result has no accelerometer or no gyroscope, or neither K nor B of one of them.
    """
    return {f"{identifier(found)}_imu.yaml": "\n".join(_kalibr(found)) + "\n"}


def floor_process(noise: Noise) -> tuple[float, float]:
    """Sd and time constant, s, of the Gauss-Markov process that has B's floor of the Allan deviation.

    Its peak ``0.617 sd`` is ``sqrt(2 ln 2 / pi) B`` high, and lies where N and K cross, at ``sqrt(3) N/K``.

    Examples
    --------
    >>> sd, tau = floor_process(Noise(1e-3, 1e-4, 1e-5))
    >>> f"{sd:.3e} {tau:.1f}"
    '1.076e-04 91.5'
    """
    crossing = math.sqrt(3.0) * noise.N / noise.K if noise.N > 0.0 and noise.K > 0.0 else PEAK_AT * TYPICAL
    return FLOOR / PEAK * noise.B, crossing / PEAK_AT


def short_walk(noise: Noise) -> float:
    """Random walk K of the Gauss-Markov process of `floor_process` over times below its time constant.

    ``dx/dt = -x/tau + w`` with ``E[w w'] = 2 sd^2/tau`` walks with ``K = sd sqrt(2/tau)`` at first.

    Examples
    --------
    >>> f"{short_walk(Noise(1e-3, 1e-4, 0.0)):.3e}"
    '1.522e-05'
    """
    sd, tau = floor_process(noise)
    return sd * math.sqrt(2.0 / tau)


def triads(found: Characterized) -> dict[str, list[Part]]:
    """Parts by kind.

    Raises
    ------
    InputError : if there is none of a kind.
    """
    kinds = {
        kind: [p for p in found.parts.values() if p.sensor.kind == kind]
        for kind in ("accelerometer", "gyroscope")
    }
    for kind, parts in kinds.items():
        if not parts:
            raise InputError(
                f"{found.source.path}: {found.name} has no {kind}: expected both kinds, of one IMU,"
                " with ids that start alike and end in .ax to .gz; choose another format, or such a result"
            )
    return kinds


def check_noise(found: Characterized) -> None:
    """Refuse a result that does not say what the noise of a component is.

    Raises
    ------
    InputError : names the components.
    """
    silent = [part.sensor.id for part in found.parts.values() if not part.noise.N > 0.0]
    if silent:
        raise InputError(
            f"{found.source.path}: says nothing of the noise of {', '.join(silent)}: expected N of a run of"
            " each; add a static run to the study, or choose a format that needs no noise"
        )


def _kalibr(found: Characterized) -> Iterator[str]:
    check_noise(found)
    kinds = triads(found)
    yield from (f"# {line}" for line in heading(found))
    yield "# Continuous-time figures, the largest over the axes and runs. Kalibr has no bias instability:"
    for kind, parts in kinds.items():
        yield f"# B of the {kind}s is {max(part.noise.B for part in parts):.6g} {_UNITS[kind]}."
    for kind, parts in kinds.items():
        unit = _UNITS[kind]
        walk, source = _walk(found, kind, parts)
        yield f"{kind}_noise_density: {max(p.noise.N for p in parts):.9e} # N, {unit}/sqrt(Hz)"
        yield f"{kind}_random_walk: {walk:.9e} # {source}, {unit}/s/sqrt(Hz) (the same as {unit}/sqrt(s))"
    yield "rostopic: /imu0 # set to yours"
    yield f"update_rate: {1.0 / min(part.interval for part in found.parts.values()):.6g} # Hz, of the runs"


def _walk(found: Characterized, kind: str, parts: list[Part]) -> tuple[float, str]:
    """Random walk of a triad's bias, and what it is taken from."""
    walk = max(part.noise.K for part in parts)
    if walk > 0.0:
        return walk, "K of the bias"
    walk = max(short_walk(part.noise) for part in parts)
    if walk > 0.0:
        return walk, "no K was found: that of the process that stands for B"
    raise InputError(
        f"{found.source.path}: the {kind}s have neither a random walk K nor a bias instability B, and Kalibr"
        " takes no random walk of zero: let the study estimate the noise of a run, or choose another format"
    )


_UNITS = {"accelerometer": "m/s^2", "gyroscope": "rad/s"}
