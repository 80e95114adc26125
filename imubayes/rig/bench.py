"""A run on equipment with errors: what was applied in truth, where the rig says something else.

Errors of the reference equipment perturb what the rig says that it applied; an analysis and a simulation use
the same functions.

Vectors v (f, w and dw) are components along the case axes, and ``f = +g`` up at rest:

- the zero of a tumble's table off by d about the normal n of a plane, right-handed in the sense in which its
  positions turn: ``v' = v + d n x v``;
- the case turned by rho in its fixture: ``v' = v - rho x v``;
- gravity off by dg: ``f' = f + dg up``, up being along f at rest, along the axis of what turns, and along the
  mean of f in a mount that is shaken;
- radius off by dR/R: ``across' = (1 + dR/R) across``, the part of f across the axis of a centrifuge; a
  stretch k of the arm by its level: ``across' = (1 + k |across|) across``;
- a rate off by s: ``w' = (1 + s) w``, and the part of f across its axis by the powers of the rate in it;
- a latency tau: what the rig says for t was applied at ``t + tau``.

Errors are applied exactly, not linearised: rotations keep every length. Time comes first, then sizes, then
the table, then the case.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imubayes.algebra import FloatArray
from imubayes.errors import DataError, TermError, UnobservableError
from imubayes.rig import motion
from imubayes.rig.inputs import GAP, Inputs, Run, between_gaps, facts_of
from imubayes.rig.plans import Plan
from imubayes.sensors import terms
from imubayes.units import STANDARD_GRAVITY, factor

EARTH = "earth_rate"
"""The kind of error that the Earth is: its rate along the axis of a table is not in what the table tells."""

ANY_AXIS = 8.68
"""deg/h: sd of the Earth's rate along an axis that may point anywhere, 15.04 / sqrt(3)."""

OFFSET = "turn_on"
"""The kind of error that is none of the inputs."""

TURNING = ("centrifuge", "rate-table", "oscillation")
"""Procedures about an axis that w tells; but where |f| is the same in every row, all of f is gravity."""

EVERY = ("tumble", *TURNING, "thermal", "static", "other")
"""Procedures with known inputs."""


@dataclass(frozen=True, slots=True, eq=False)
class Kind:
    """A kind of error of the reference equipment.

    Attributes
    ----------
    name : key in a study.
    unit, printed : SI unit, and the unit that people use; those of ``turn_on`` are for an accelerometer, see
        `for_sensor`.
    key : of its size in the catalogue; empty where the catalogue has none.
    procedures : that it applies to.
    each : what it is one error of: ``bench``, ``machine`` (all runs of a procedure), ``run`` or ``mount``.
    parts : axes of the case where it is a vector, else one empty text.
    text : in words.
    step : for the derivative of the output, SI (in sampling intervals for ``latency``): so small that the
        curvature over it is below 1e-7 of the slope, so large that rounding is below 1e-9.
    apply : gives the perturbed motion for sizes (n, parts) of the error in each row; None for an error that
        is none of the motion.
    """

    name: str
    unit: str
    printed: str
    key: str
    procedures: tuple[str, ...]
    each: str
    parts: tuple[str, ...]
    text: str
    step: float
    apply: Callable[[motion.Motion, FloatArray], motion.Motion] | None

    @property
    def default(self) -> float | None:
        """Sd in SI that the catalogue holds for typical, of the Earth any axis; None where there is none."""
        from imubayes.sensors.catalogue import reference_errors

        usual = ANY_AXIS * factor(self.printed, self.unit) if self.name == EARTH else None
        return reference_errors()[self.key][1] if self.key else usual


def for_sensor(kind: Kind, sensor: terms.Kind) -> Kind:
    """Kind of error with the units of a sensor's output where it is an error of the output.

    Examples
    --------
    >>> for_sensor(KINDS["turn_on"], "gyroscope").unit, for_sensor(KINDS["gravity"], "gyroscope").unit
    ('rad/s', 'm/s^2')
    """
    gyroscope = kind.name == OFFSET and sensor == "gyroscope"
    return replace(kind, unit="rad/s", printed="deg/h") if gyroscope else kind


_AXES, _ONE = tuple(terms.AXES), ("",)

KINDS: Mapping[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind("latency", "s", "ms", "", EVERY, "bench", _ONE,
             "latency of the sensor behind the rig", 1e-4, None),
        Kind("gravity", "m/s^2", "ug", "gravity", EVERY, "bench", _ONE,
             "error of local gravity", 1e-3, motion.heavier),
        Kind("rate_scale", "1", "ppm", "rate_accuracy", TURNING, "machine", _ONE,
             "scale error of the rig's rate", 1e-4, motion.faster),
        Kind(EARTH, "rad/s", "deg/h", "", ("free-tumble",), "bench", _ONE,
             "Earth's rate along the table's axis", 1e-7, None),
        Kind("radius", "1", "ppm", "centrifuge_radius", ("centrifuge",), "bench", _ONE,
             "error of the arm's radius", 1e-4, motion.longer),
        Kind("arm_stretch", "1/(m/s^2)", "ppm/g", "centrifuge_arm_stretch", ("centrifuge",), "bench", _ONE,
             "stretch of the arm by its level", 1e-7, motion.stretched),
        Kind("table_zero", "rad", "arcsec", "index_table", ("tumble",), "bench", _ONE,
             "common zero of the tumble's table", 1e-4, motion.on_table),
        Kind("plane_zero", "rad", "arcsec", "index_table", ("tumble",), "mount", _ONE,
             "zero of the tumble's table", 1e-4, motion.on_table),
        Kind("fixture_common", "rad", "arcsec", "fixture_mount", EVERY, "bench", _AXES,
             "rotation of the case in its fixture", 1e-4, motion.in_fixture),
        Kind("fixture", "rad", "arcsec", "fixture_mount", EVERY, "mount", _AXES,
             "rotation of the case in its fixture", 1e-4, motion.in_fixture),
        Kind(OFFSET, "m/s^2", "ug", "", EVERY, "run", _ONE,
             "offset of the bias since the sensor was turned on", 1.0, None),
    )
}  # fmt: skip
"""Kinds of errors by their key in a study, in the order in which they are applied."""

TILT = Kind("tilt", "rad", "urad", "", EVERY, "bench", ("j", "k"),
            "tilt of the axes that the coefficients refer to", 1e-4, None)  # fmt: skip
"""What comes with a rotation in the fixture. Powers and products of inputs belong to the sensor's own axes,
which the misalignment tilts; the model lets them act along the case's. Without this allowance a strong cubic
would tell a rotation of the case from a misalignment, by nothing but that convention."""

LACK = "lack"
"""What names of functions begin with that stand for what the library lacks: no error of a bench, and a column
beside the terms as these are."""

SHORTENING: Mapping[str, Kind] = {
    rotation: Kind(name, "1", "ppm", "", EVERY, KINDS[rotation].each, _ONE,
                   "shortening of the inputs by tilts that are not seen", 1e-4, motion.shortened)
    for rotation, name in (("fixture", "shortening"), ("fixture_common", "shortening_common"))
}  # fmt: skip
"""What comes with rotations of arcminutes, by their kinds: along an axis an input is shorter by half the
square of its tilts, of which a part is not seen."""

SHORTEST = 1e-7
"""Of an input: a shortening that no scale factor notices."""

_EVERY_KIND = {**KINDS, TILT.name: TILT, **{kind.name: kind for kind in SHORTENING.values()}}


@dataclass(frozen=True, slots=True)
class Error:
    """One unknown number of the test bench: ``gravity``, ``turn_on.log``, ``fixture_j.tumble.2``.

    It is number `part` of the parts of a kind (key of `KINDS`), in words `text`, and may be confined to a
    procedure, a run or a mount: these are empty or None where it is not.
    """

    name: str
    kind: str
    part: int
    text: str
    procedure: str = ""
    run: str = ""
    mount: int | None = None

    def applies(self, run: Run | Plan) -> bool:
        """Tell whether the error moves anything in a run."""
        here = run.procedure in _EVERY_KIND[self.kind].procedures
        return here and self.procedure in ("", run.procedure) and self.run in ("", run.name)


HEADS: Mapping[str, str] = {
    f"{kind.name}_{part}" if part else kind.name: kind.name
    for kind in _EVERY_KIND.values()
    for part in kind.parts
}
"""What the names of errors begin with, before the first dot, and the kinds that they are of."""


def errors_of(runs: Sequence[Run | Plan], kinds: Iterable[str]) -> tuple[Error, ...]:
    """Unknown numbers of the given kinds over the runs; a `TermError` if a kind is not known.

    Examples
    --------
    >>> from imubayes.rig.tumbles import tumble
    >>> [error.name for error in errors_of([tumble(planes=2)], ["gravity", "plane_zero"])]
    ['gravity', 'plane_zero.tumble.0', 'plane_zero.tumble.1']
    """
    return tuple(
        Error(
            ".".join((f"{kind.name}_{axis}" if axis else kind.name, *place)),
            kind.name,
            part,
            " ".join(filter(None, (kind.text, f"about {axis}" if axis else "", where))),
            **confined,
        )
        for kind in map(kind_of, kinds)
        for place, where, confined in _places(
            [run for run in runs if run.procedure in kind.procedures], kind.each
        )
        for part, axis in enumerate(kind.parts)
    )


def kind_of(name: str) -> Kind:
    """Kind of error by its name; a `TermError` if it is not known."""
    if name not in _EVERY_KIND:
        raise TermError(f"'{name}' is no error of a test bench: known are {', '.join(KINDS)}")
    return _EVERY_KIND[name]


def _places(runs: Sequence[Run | Plan], each: str) -> list[tuple[tuple[str, ...], str, dict]]:
    """Return what the errors of a kind are confined to: the name's tail, in words, and as fields."""
    if each == "machine":
        procedures = dict.fromkeys(run.procedure for run in runs)
        return [((p,), f"in {p} runs", {"procedure": p}) for p in procedures]
    if each == "run":
        return [((run.name,), f"in run {run.name}", {"run": run.name}) for run in runs]
    if each == "mount":
        return [
            ((run.name, str(m)), f"in mount {m} of run {run.name}", {"run": run.name, "mount": m})
            for run in runs
            for m in np.unique(run.inputs.mounts).tolist()
        ]
    return [((), "", {})]


Errors = Mapping[str, FloatArray]
"""Size of each kind of error in each mount of a run: arrays (mounts, parts) by kind."""

FLAT = 0.1
"""Positions that leave their plane by less than this share of their spread turn in it."""

AT_REST = 0.05
"""Share of 1 g by which the mean force of a mount may differ from it if the case hangs or stands there: ten
times what gravity itself differs from place to place, since a dwell may end amid a swing."""


@dataclass(frozen=True, slots=True, eq=False)
class Bench:
    """A run on equipment with errors.

    Attributes
    ----------
    run : what was applied if there were none.
    mounts : numbers of its mounts.
    place : (n,) index of each row's mount in `mounts`.
    normals : (mounts, 3) of the planes of a tumble, where an error about them is asked for; else zero.
    uprights : (mounts, 3) unit vectors against gravity, where the case is shaken and an error of gravity is
        asked for; else zero.
    turning : whether f across the axis of w comes from turning; else all of f is gravity.
    """

    run: Run | Plan
    mounts: tuple[int, ...]
    place: NDArray[np.intp]
    normals: FloatArray
    uprights: FloatArray
    turning: bool

    def of(self, inputs: Inputs) -> Bench:
        """The same bench in some of the rows of its run."""
        place = np.searchsorted(self.mounts, inputs.mounts)
        return replace(self, run=replace(self.run, inputs=inputs), place=place)

    def sizes(self, errors: Sequence[Error], values: Sequence[float] | FloatArray) -> dict[str, FloatArray]:
        """Sizes (mounts, parts) of each kind that applies to the run, from the values (SI) of the errors."""
        tables: dict[str, FloatArray] = {}
        for error, value in zip(errors, values, strict=True):
            if error.applies(self.run):
                shape = len(self.mounts), len(kind_of(error.kind).parts)
                table = tables.setdefault(error.kind, np.zeros(shape))
                rows = slice(None) if error.mount is None else self.mounts.index(error.mount)
                table[rows, error.part] += value
        return tables

    def channels(self, sizes: Errors, start: int = 0, stop: int | None = None) -> dict[str, FloatArray]:
        """What was applied in the rows from start to stop, in truth, if the errors have these sizes."""
        stop = len(self.place) if stop is None else stop
        latency = float(sizes["latency"][0, 0]) if "latency" in sizes else 0.0
        channels = delayed(self.run.inputs, latency, start, stop)
        there = [kind for kind in _EVERY_KIND.values() if kind.name in sizes and sizes[kind.name].any()]
        wanted = [(kind.apply, sizes[kind.name]) for kind in there if kind.apply]
        if not wanted:
            return channels
        place = self.place[start:stop]
        moved = motion.motion_of(channels, self.normals[place], self.uprights[place], turning=self.turning)
        for apply, size in wanted:
            moved = apply(moved, size[place])
        return {**channels, **motion.components(moved, channels)}


def bench_of(run: Run | Plan, kinds: Iterable[str]) -> Bench:
    """Bench of a run with known inputs, for the kinds of errors that will be asked for.

    It is a `DataError` if an error needs what the run does not tell: the plane that a mount of a tumble turns
    in, or the axis that a centrifuge turns about.
    """
    wanted = {name for name in kinds if run.procedure in kind_of(name).procedures}
    mounts, place = np.unique(run.inputs.mounts, return_inverse=True)
    turning, normals, uprights = _turning(run, wanted), *np.zeros((2, len(mounts), 3))
    f = run.inputs.vectors("f")
    if wanted & {"table_zero", "plane_zero"}:
        normals = np.array([_normal(f[place == k], run.name, m) for k, m in enumerate(mounts.tolist())])
    if "gravity" in wanted and not turning and not _one_length(run):
        uprights = np.array([_upright(f[place == k]) for k in range(len(mounts))])
    return Bench(run, tuple(mounts.tolist()), place, normals, uprights, turning)


def _turning(run: Run | Plan, wanted: set[str]) -> bool:
    """Tell whether part of f comes from turning, which w must then tell."""
    channels = run.inputs.channels
    if run.procedure not in TURNING or _one_length(run):
        return False
    lacking = sorted(wanted & {"gravity", "rate_scale", "radius", "arm_stretch"})
    if lacking and not any(f"w_{axis}" in channels for axis in terms.AXES):
        raise DataError(
            f"run '{run.name}': without the rate (w_i, w_j, w_k) nobody knows which part of f is centripetal,"
            f" and {' and '.join(lacking)} cannot be allowed for: record the rate, or leave"
            f" {'it' if len(lacking) == 1 else 'them'} out of the errors of the reference"
        )
    return True


def _one_length(run: Run | Plan) -> bool:
    """Tell whether |f| is the same in every row: then all of f is gravity, in whatever position."""
    rows = run.extremes if isinstance(run, Run) else run.inputs.channels
    return facts_of([rows], "gyroscope").force > 0.0


def true_inputs(run: Run | Plan, errors: Mapping[str, float]) -> Inputs:
    """What a rig with errors applied while it said that it applied the run's inputs.

    The errors are values in SI by name (see `Error`); those of other runs are passed over. An offset of the
    output (``turn_on``) is no input. It is a `TermError` if a name is none of a test bench's.

    Examples
    --------
    >>> from imubayes.rig.tumbles import tumble
    >>> plan = tumble(angles=4, planes=1, dwell=1.0, rate=1.0)
    >>> true_inputs(plan, {"table_zero": 1e-6}).channels["f_j"].round(7).tolist()
    [9.8e-06, 9.80665, -9.8e-06, -9.80665]
    """
    known = [head for head, kind in HEADS.items() if kind in KINDS]
    strange = [name for name in errors if name.partition(".")[0] not in known]
    if strange:
        raise TermError(f"'{strange[0]}' is no error of a test bench: names begin with {', '.join(known)}")
    bench, sizes = bench_with(run, errors)
    return replace(run.inputs, channels=bench.channels(sizes))


def bench_with(run: Run | Plan, errors: Mapping[str, float]) -> tuple[Bench, Errors]:
    """Bench of a run with errors, SI by name, and their sizes there."""
    kinds = {HEADS[name.partition(".")[0]] for name in errors}
    known, bench = errors_of([run], kinds), bench_of(run, kinds)
    return bench, bench.sizes(known, [errors.get(error.name, 0.0) for error in known])


def refuse_idle(runs: Sequence[Run | Plan], kinds: Iterable[str]) -> None:
    """Refuse kinds of errors that change nothing in any run.

    An `UnobservableError` names the first and what run it needs; a `TermError` a kind that is not known.
    """
    for kind in map(kind_of, kinds):
        if needed := _needed(runs, kind):
            raise UnobservableError(
                f"'{kind.name}' ({kind.text}) changes nothing in any run: it needs a run {needed};"
                " add one, or leave it out of the errors of the reference",
                (kind.name,),
            )


def effective(runs: Sequence[Run | Plan], kinds: Iterable[str]) -> tuple[str, ...]:
    """Those of the kinds that change something in a run."""
    return tuple(name for name in kinds if not _needed(runs, kind_of(name)))


def _needed(runs: Sequence[Run | Plan], kind: Kind) -> str:
    """What run a kind of error lacks, in words; empty where it has one."""
    concerned = [run for run in runs if run.procedure in kind.procedures]
    if not concerned:
        return f"of procedure {' or '.join(kind.procedures)}"
    if kind.name == "latency" and not any(_moves(run.inputs) for run in concerned):
        return "in which an input changes while it is recorded"
    if kind.apply and not any(_changes(run, kind) for run in concerned):
        turns = set(kind.procedures) <= set(TURNING)
        shown = "the rate that it turns at (w_i, w_j, w_k)" if turns else "a force or a rate (f_i, ..., w_k)"
        return f"with {shown} in its file"
    return ""


def _moves(inputs: Inputs) -> bool:
    inside = np.diff(inputs.t) <= GAP * inputs.interval
    return any(bool(np.any(np.diff(values)[inside])) for values in inputs.channels.values())


def _changes(run: Run | Plan, kind: Kind) -> bool:
    before = run.inputs.channels
    after = true_inputs(run, {error.name: kind.step for error in errors_of([run], [kind.name])}).channels
    return any(bool(np.any(values != before.get(name, 0.0))) for name, values in after.items())


def _upright(f: FloatArray) -> FloatArray:
    """Direction (3,) of the mean force f (n, 3) of a shaken case; zero if that is not gravity alone."""
    mean = f.mean(axis=0)
    size = float(np.linalg.norm(mean))
    return mean / size if abs(size / STANDARD_GRAVITY - 1.0) < AT_REST else np.zeros(3)


def _normal(f: FloatArray, run: str, mount: int) -> FloatArray:
    """Normal (3,) of the plane in which positions f (n, 3) turn, right-handed in the sense that they do."""
    new = np.any(np.diff(f, axis=0) != 0.0, axis=1)
    positions = f[np.concatenate(([True], new))]
    _, spread, axes = np.linalg.svd(np.concatenate((positions, np.zeros((3, 3)))), full_matrices=False)
    if spread[1] <= FLAT * spread[0] or spread[2] > FLAT * spread[1]:
        raise DataError(
            f"run '{run}': the positions of mount {mount} do not turn in one plane, so that the zero of the"
            " table has no axis: give a column 'mount' with the number of each row's plane, or leave"
            " table_zero and plane_zero out"
        )
    turns = np.cross(positions[:-1], positions[1:]) @ axes[2]
    large = turns[np.abs(turns) > 0.5 * np.abs(turns).max()]
    return axes[2] * np.sign(large[0])


def delayed(inputs: Inputs, latency: float, start: int, stop: int) -> dict[str, FloatArray]:
    """Channels in the rows from start to stop as they were `latency` earlier, s.

    Cubics with central slopes of five points between the samples of a part without gaps; straight on beyond
    its ends.

    Examples
    --------
    >>> inputs = Inputs(np.arange(4.0), {"w_i": 2.0 * np.arange(4.0)}, 1.0)
    >>> delayed(inputs, 0.25, 1, 3)["w_i"].tolist()
    [1.5, 3.5]
    """
    if latency == 0.0 or not inputs.channels:
        return {name: values[start:stop] for name, values in inputs.channels.items()}
    from scipy.interpolate import CubicHermiteSpline

    # three neighbours beyond the reach of the latency settle the slopes on both sides
    first = max(int(np.searchsorted(inputs.t, inputs.t[start] - abs(latency))) - 3, 0)
    last = min(int(np.searchsorted(inputs.t, inputs.t[stop - 1] + abs(latency))) + 4, len(inputs))
    t, rows = inputs.t[first:last], slice(start - first, stop - first)
    values = np.column_stack([channel[first:last] for channel in inputs.channels.values()])
    slopes, begin, end = np.zeros_like(values), *np.zeros((2, len(t)), dtype=np.intp)
    for low, high in between_gaps(t, inputs.interval):
        begin[low:high], end[low:high] = low, high - 1
        if high - low > 1:
            slopes[low:high] = np.gradient(values[low:high], t[low:high], axis=0)
            # a central slope of a sine is too small by a sixth of what its own curvature says
            slopes[low + 1 : high - 1] -= np.diff(slopes[low:high], 2, axis=0) / 6.0
    begin, end, wanted = begin[rows], end[rows], t[rows] - latency
    held = np.clip(wanted, t[begin], t[end])
    beyond = (wanted - held)[:, None] * np.where((wanted < held)[:, None], slopes[begin], slopes[end])
    moved = CubicHermiteSpline(t, values, slopes)(held) + beyond if len(t) > 1 else values
    return dict(zip(inputs.channels, np.ascontiguousarray(moved.T), strict=True))
