"""Technologies and grades: how large each coefficient and each noise process is in a class of sensors.

The figures are in ``grades.toml`` beside this module, ``[low, typical, high, unit]``, with their sources.
From them come the physical priors: a coefficient is ``N(0, sd^2)`` with the sd of its class, whatever the
noise of the test is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from functools import cache

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.errors import TermError
from imubayes.sensors import Range, SensorClass
from imubayes.sensors.catalogue_file import figure_range, packaged_classes, packaged_tables
from imubayes.sensors.equations import standard, standards_for
from imubayes.sensors.noise import Noise
from imubayes.sensors.terms import Library, Term


def sensor(id: str, *, kind: str, catalogue: Sequence[SensorClass] = ()) -> SensorClass:
    """Class of the catalogue by its id; some ids exist for both kinds.

    Parameters
    ----------
    id, kind : of the class.
    catalogue : own classes beside those of imubayes, see `imubayes.sensors.catalogue_file.read_catalogue`.

    Raises
    ------
    TermError : if there is no such class, naming those that are spelled alike or the other kind.

    Examples
    --------
    >>> sensor("quartz_flexure_servo", kind="accelerometer").grade
    'navigation'
    """
    known = {entry.id: entry for entry in classes(kind, catalogue=catalogue)}
    if id in known:
        return known[id]
    elsewhere = [entry.kind for entry in classes(catalogue=catalogue) if entry.id == id]
    if elsewhere:
        raise TermError(f"class '{id}' is of kind {elsewhere[0]}, not {kind}: known are {', '.join(known)}")
    near = get_close_matches(id, known)
    hint = f"did you mean {' or '.join(near)}?" if near else f"known are {', '.join(known)}"
    raise TermError(f"class '{id}' is not in the catalogue of kind {kind}: {hint}")


def classes(kind: str | None = None, *, catalogue: Sequence[SensorClass] = ()) -> tuple[SensorClass, ...]:
    """Classes of one kind, or of both, in the catalogue's order, own ones last; `TermError`: no such kind.

    Examples
    --------
    >>> len(classes("accelerometer")), len(classes("gyroscope"))
    (6, 13)
    """
    if kind not in (None, "accelerometer", "gyroscope"):
        raise TermError(f"kind '{kind}' is not known: expected accelerometer or gyroscope")
    return tuple(entry for entry in (*packaged_classes(), *catalogue) if kind in (None, entry.kind))


def prior_sd(sensor_class: SensorClass, term: Term) -> tuple[float, str]:
    """Sd of the zero-mean prior of one coefficient, SI, and where it comes from, in words.

    The sd is the class's typical size (a tenth of the highest where the typical one is zero), halved where
    the catalogue holds IEEE 1293's full difference. A lever arm drives the same regressors as the spin and
    angular-acceleration terms, so the two add in squares. Five rules are assumptions (orders of magnitude),
    and their texts say so:

    - a power beyond the catalogue's highest has a third of that one's effect at full scale;
    - a gyroscope's Koq-like ``b2p`` is half of its quadratic nonlinearity;
    - each power of T - T0 beyond the first divides by half the temperature range, and a term without a
      temperature coefficient of its own varies by 1e-3 per kelvin;
    - a term by dT/dt that the catalogue does not give is its temperature coefficient times 60 s: the
      sensing element lags behind its thermometer by about a minute, and reads ``T - 60 s dT/dt``;
    - a term by the difference of two thermometers is its temperature coefficient: the sensing element is
      as warm as the one or the other.

    It is a `TermError` if the class's kind has no such term.

    Examples
    --------
    >>> from imubayes.sensors.terms import library
    >>> tactical = sensor("mems_tactical", kind="accelerometer")
    >>> sd, origin = prior_sd(tactical, library("accelerometer").terms[4])
    >>> f"{sd:.4e} m/s^2, {origin}"
    '2.4517e-05 m/s^2, half of the typical K0p'
    """
    base, _, heat = term.name.partition("*")
    if heat == "dT" and base == "b0" and "Tdot" in sensor_class.coefficients:
        return _size(sensor_class, "Tdot")
    sd, origin = _isothermal_sd(sensor_class, base)
    if heat == "dT":
        size, origin = _heated_sd(sensor_class, base, 1, sd)
        return size * _DRIFT_TIME, f"assumed: {origin.removeprefix('assumed: ')} times 60 s"
    if heat == "gT":
        size, origin = _heated_sd(sensor_class, base, 1, sd)
        return size, f"assumed: {origin.removeprefix('assumed: ')}, by the gradient"
    return _heated_sd(sensor_class, base, int(heat[1:] or 1), sd) if heat else (sd, origin)


def typical_noise(sensor_class: SensorClass) -> Noise:
    """Typical noise of a class, SI."""
    N, B, K = (sensor_class.noise[name][1] for name in ("N", "B", "K"))
    return Noise(N, B, K)


def draw_unit(sensor_class: SensorClass, lib: Library, rng: np.random.Generator) -> dict[str, float]:
    """One sensor of the class at random: every coefficient of `lib` from its prior, SI, by name.

    What a lever arm couples is coupled, see `prior_root`.

    Examples
    --------
    >>> from imubayes.sensors.terms import library
    >>> lib = library("gyroscope", powers=1, asymmetry=-1)
    >>> unit = draw_unit(sensor("mems_consumer", kind="gyroscope"), lib, np.random.default_rng(1))
    >>> list(unit) == list(lib.names)
    True
    """
    root = prior_root(sensor_class, lib)
    theta = root @ rng.standard_normal(root.shape[1])
    return dict(zip(lib.names, theta.tolist(), strict=True))


def prior_root(sensor_class: SensorClass, lib: Library) -> FloatArray:
    """Root A (p, q) of the coefficients' prior covariance: ``theta = A z`` with z standard normal, SI.

    The sensing point of an accelerometer lies at r from the point whose specific force it is given, and feels
    ``w x (w x r) + dw x r`` besides::

        S_ij = r_j + Kspin,  S_ik = r_k,  S_jj = S_kk = -r_i,  s_j = r_k,  s_k = -r_j + Kang

    The three components of r are columns that these share; what else a term has is a column of its own.

    Examples
    --------
    >>> from imubayes.sensors.terms import library
    >>> lib = library("accelerometer", set="extended")
    >>> A = prior_root(sensor("mems_tactical", kind="accelerometer"), lib)
    >>> S_ik, s_j, S_jj, S_kk = (A[lib.names.index(name)] for name in ("S_ik", "s_j", "S_jj", "S_kk"))
    >>> bool((S_ik == s_j).all() and (S_jj == S_kk).all())
    True
    """
    columns: dict[str, FloatArray] = {}
    for row, term in enumerate(lib.terms):
        for source, size in _sources(sensor_class, term):
            columns.setdefault(source, np.zeros(len(lib.terms)))[row] = size
    return np.column_stack(list(columns.values()))


def coupled(lib: Library, sensor_class: SensorClass) -> Library:
    """Library with ties between the coefficients that have all of their causes in common (see `prior_root`).

    Examples
    --------
    >>> from imubayes.sensors.terms import library
    >>> lib = library("accelerometer", set="extended")
    >>> coupled(lib, sensor("mems_tactical", kind="accelerometer")).ties
    (('S_kk', 'S_jj'), ('s_j', 'S_ik'))
    """
    first: dict[tuple[tuple[str, float], ...], str] = {}
    leaders = [(t.name, first.setdefault(tuple(_sources(sensor_class, t)), t.name)) for t in lib.terms]
    return replace(lib, ties=tuple((name, leader) for name, leader in leaders if name != leader))


_LEVER = {"S_ij": ("j", 1.0), "S_ik": ("k", 1.0), "S_jj": ("i", -1.0), "S_kk": ("i", -1.0),
          "s_j": ("k", 1.0), "s_k": ("j", -1.0)}  # fmt: skip
"""Component of the lever arm that drives a term of an accelerometer, and its sign."""


def _sources(entry: SensorClass, term: Term) -> Iterator[tuple[str, float]]:
    """Independent causes of a coefficient, and the part of its sd, with a sign, that each of them makes."""
    sd = prior_sd(entry, term)[0]
    base, _, heat = term.name.partition("*")
    if entry.kind == "gyroscope" or base not in _LEVER:
        yield term.name, sd
        return
    parts = {key: share * _size(entry, key)[0] for key, share in _SHARES[entry.kind][base].items()}
    scale = sd / math.hypot(*parts.values())
    axis, sign = _LEVER[base]
    yield f"r_{axis}*{heat}", sign * scale * parts.pop("lever")
    if parts:
        yield term.name, scale * math.hypot(*parts.values())


@cache
def reference_errors() -> Mapping[str, Range]:
    """Errors of test equipment by the catalogue's key (``index_table``, ``gravity``), one sigma, SI.

    Examples
    --------
    >>> low, typical, high = reference_errors()["centrifuge_radius"]
    >>> round(typical * 1e6)
    50
    """
    return {key: figure_range(figure) for key, figure in packaged_tables()["reference"]["figures"].items()}


def terms_of(kind: str, key: str) -> tuple[str, ...]:
    """Names of the terms whose size a figure of the catalogue tells; empty where it tells none.

    Examples
    --------
    >>> terms_of("accelerometer", "Kx"), terms_of("gyroscope", "Tdot"), terms_of("gyroscope", "lockin")
    (('c_ij', 'c_ik', 'c_jk'), ('b0*dT',), ())
    """
    heated = _HEATED.get(key)
    return (heated,) if heated else tuple(name for name, keys in _SHARES[kind].items() if key in keys)


def figure_symbols(entry: SensorClass, key: str) -> tuple[str, ...]:
    """What a figure of the catalogue is the size of, in the symbols of the class's standard.

    A figure that only adds to another's (a lever arm beside Kspin) has none.

    Examples
    --------
    >>> figure_symbols(sensor("mems_tactical", kind="accelerometer"), "K1p")
    ("K1'",)
    >>> figure_symbols(sensor("fog_navigation", kind="gyroscope"), "sasym")
    ("2 eps_1'",)
    """
    own, *_ = standards_for(entry.kind, entry.technology)
    shares = {_HEATED[key]: {key: 1.0}} if key in _HEATED else _SHARES[entry.kind]
    rows = standard(own, kind=entry.kind).symbols if own != "basic" else ()
    return tuple(
        row.symbol if size == 1.0 else f"{size:g} {row.symbol}"
        for row in rows
        if next(iter(shares.get(row.term, ())), "") == key
        for size in [abs(row.weight) / shares[row.term][key]]
    )


_SHARES: dict[str, dict[str, dict[str, float]]] = {
    # catalogue's figures (and their shares, added in squares) behind each coefficient
    "accelerometer": {
        "b0": {"K0": 1.0}, "b1": {"s": 1.0}, "b2": {"K2": 1.0}, "b3": {"K3": 1.0},
        "b0p": {"K0p": 0.5}, "b1p": {"K1p": 0.5}, "b2p": {"Koq": 1.0},
        "m_j": {"mis": 1.0}, "m_k": {"mis": 1.0},
        "c_ij": {"Kx": 1.0}, "c_ik": {"Kx": 1.0}, "c_jk": {"Kx": 1.0},
        "c_jj": {"Kxx": 1.0}, "c_kk": {"Kxx": 1.0},
        "S_ij": {"Kspin": 1.0, "lever": 1.0}, "S_ik": {"lever": 1.0}, "S_jk": {"Kspin": 1.0},
        "S_ii": {"Kspin": 1.0}, "S_jj": {"lever": 1.0}, "S_kk": {"lever": 1.0},
        "s_i": {"Kaa": 1.0}, "s_j": {"lever": 1.0}, "s_k": {"Kaa": 1.0, "lever": 1.0},
    },
    "gyroscope": {
        "b0": {"b0": 1.0}, "b1": {"s": 1.0}, "b2": {"nl2": 1.0}, "b3": {"nl3": 1.0},
        "b0p": {"b0p": 1.0}, "b1p": {"sasym": 0.5}, "b2p": {"nl2": 0.5},
        "m_j": {"mis": 1.0}, "m_k": {"mis": 1.0},
        **{f"c_{pair}": {"crate": 1.0} for pair in ("ij", "ik", "jj", "jk", "kk")},
        **{f"g_{axis}": {"g1": 1.0} for axis in "ijk"},
        **{f"S_{pair}": {"g2": 1.0} for pair in ("ij", "ik", "jk", "ii", "jj", "kk")},
        **{f"s_{axis}": {"aa": 1.0} for axis in "ijk"},
    },
}  # fmt: skip

_HEATED = {"T0": "b0*T", "T1": "b1*T", "Tdot": "b0*dT"}
"""Terms of the temperature expansion whose sizes the catalogue holds."""

_ASSUMED = {("gyroscope", "b2p")}
"""Coefficients whose share above is an order of magnitude of our own."""

_HIGHEST = {"": 3, "p": 2}
"""Highest power of the own input in the catalogue, without and with the sign."""

_DRIFT_TIME = 60.0
"""s; lag of a sensing element behind its thermometer, where the catalogue gives none (order of magnitude)."""

_HEAT_SENSITIVITY = 1e-3
"""1/K; relative change of a coefficient by temperature where none is given (order of magnitude)."""


def _isothermal_sd(entry: SensorClass, name: str) -> tuple[float, str]:
    shares = _SHARES[entry.kind].get(name)
    if shares is None:  # a power that the catalogue does not hold
        power, family = name[1:].removesuffix("p"), "p" if name.endswith("p") else ""
        if name[0] != "b" or not power.isdigit():
            raise TermError(
                f"kind {entry.kind} has no term '{name}': the catalogue cannot say how large it is"
            )
        known = _HIGHEST[family]
        sd = _isothermal_sd(entry, f"b{known}{family}")[0] / 3.0 * entry.full_scale ** (known - int(power))
        return sd, f"assumed: a third of the effect of b{known}{family} at full scale"
    sizes = [(share, *_size(entry, key)) for key, share in shares.items()]
    sd = math.hypot(*(share * size for share, size, _ in sizes))
    origin = " and ".join(("half of " if share == 0.5 else "") + text for share, _, text in sizes)
    return sd, f"assumed: {origin}" if (entry.kind, name) in _ASSUMED else origin


def _size(entry: SensorClass, key: str) -> tuple[float, str]:
    _, typical, high = entry.coefficients[key]
    return (
        (typical, f"the typical {key}") if typical > 0.0 else (high / 10.0, f"a tenth of the highest {key}")
    )


def _heated_sd(entry: SensorClass, base: str, power: int, sd: float) -> tuple[float, str]:
    if base not in ("b0", "b1"):
        return sd * _HEAT_SENSITIVITY**power, f"assumed: 1e-3 per kelvin of {base}"
    size, origin = _size(entry, f"T{base[1:]}")
    if power == 1:
        return size, origin
    lowest, highest = entry.temperature
    half = (highest - lowest) / 2.0
    return size / half ** (power - 1), f"assumed: {origin} over half the temperature range"
