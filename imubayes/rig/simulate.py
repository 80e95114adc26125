"""Simulated runs: the model's output over a procedure's inputs, with the noise of a class.

Every noise process is averaged over each sample and drawn exactly from its own distribution at the given time
stamps, gaps included.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cache, partial
from itertools import takewhile

import numpy as np

from imubayes.algebra import FloatArray
from imubayes.errors import InputError, StudyError, TermError
from imubayes.rig.bench import OFFSET, bench_with, errors_of, true_inputs
from imubayes.rig.inputs import Inputs, Part, Run, Source, case_inputs, frozen, joined_parts, own_inputs
from imubayes.rig.plans import Plan
from imubayes.rig.recordings import FREE_TUMBLE, RunSpec
from imubayes.rig.rotations import centrifuge, oscillation, rate_table, vibration
from imubayes.rig.runs import averaged_parts, renewed
from imubayes.rig.sequences import planned
from imubayes.rig.tumbles import free_tumble, positions, static, thermal, tumble
from imubayes.sensors.catalogue import SensorClass, draw_unit, typical_noise
from imubayes.sensors.imu import COMPONENTS, kind_of
from imubayes.sensors.noise import Noise, flicker
from imubayes.sensors.terms import HIGHEST_POWER, Kind, Library, Term, column, columns, held_sign, library

_RATIO = 4.0
"""Ratio of neighbouring time constants: the Allan variance is flat to 0.1 %."""

_FASTEST = 0.25
"""Averaging time over a sample's from which bias instability is drawn as such: what is faster is white."""

_EVEN = 1e-6
"""Spread of the steps between rows, over a sample, below which they are all one."""

_SLOW = 0.01
"""Sample over a time constant below which three terms of a series are right to 1e-9 of the variance."""

_SPANS = 10.0
"""Longest time constant over the run's span, at least."""


PROFILES = {
    "static": static,
    "tumble": tumble,
    "positions": positions,
    "free-tumble": free_tumble,
    "rate-table": rate_table,
    "oscillation": oscillation,
    "centrifuge": centrifuge,
    "vibration": vibration,
    "thermal": thermal,
}
"""Functions that plan what can be simulated, by the profile's name."""


def simulate(
    sensor: SensorClass,
    plans: Iterable[Plan],
    *,
    seed: int | np.random.Generator,
    truth: Mapping[str, float] | None = None,
    noise: Noise | Sequence[Noise | None] | None = None,
    said: Sequence[Inputs] = (),
    errors: Mapping[str, float] | None = None,
) -> tuple[Run, ...]:
    """Run the plans on a simulated sensor: ``output = input + X theta + noise``.

    Parameters
    ----------
    sensor : class of the sensor.
    plans : what the rig does; plans of one name are numbered.
    seed : of the draw; runs have independent noise.
    truth : coefficients in SI by name, those not named being zero: any term of any library, also of orders
        that the slides do not reach (``b4``, ``S_ii``, ``b0*T2``). Without it a unit is drawn from the
        class over the slide library (draw it with `draw_unit` to keep it).
    noise : of every run, or of each; the class's typical N, B and K where absent.
    said : what the rig says of each plan's inputs, where something moved these (see `held_sign`): those of
        the runs.
    errors : of the bench, SI by name, of which the inputs of the runs say nothing.

    Raises
    ------
    TermError : if `truth` names a term that the kind does not have.

    Examples
    --------
    >>> from imubayes.rig.tumbles import tumble
    >>> from imubayes.sensors.catalogue import sensor
    >>> tactical = sensor("mems_tactical", kind="accelerometer")
    >>> (run,) = simulate(tactical, [tumble(angles=4, planes=1)], seed=1, truth={"b0": 0.0147})
    >>> bool(abs(run.output.mean() - 0.0147) < 2e-3), run.source.file
    (True, 'simulated')
    """
    rng = np.random.default_rng(seed)
    if truth is None:
        truth = draw_unit(sensor, library(sensor.kind), rng)
    lib = library_of(sensor.kind, truth)
    source = Source(notes=(f"simulated: {sensor.kind} of class {sensor.id}",))
    plans = tuple(plans)
    runs, told_of = list[Run](), said or [plan.inputs for plan in plans]
    noises = [noise] * len(plans) if noise is None or isinstance(noise, Noise) else noise
    for (name, plan), told, own in zip(_numbered(plans), told_of, noises, strict=True):
        applied = true_inputs(plan, errors) if errors else plan.inputs
        output = synthesise(own or typical_noise(sensor), applied.t, applied.interval, rng)
        output += applied.channels.get(lib.own, 0.0)
        for term in lib.terms:
            held = held_sign(term, told.channels, applied.channels)
            output += truth[term.name] * column(term, applied.channels) * held
        offset = (errors or {}).get(f"{OFFSET}.{name}", 0.0)
        runs.append(Run(name, plan.procedure, told, output + offset, source))
    return tuple(runs)


def drawn_errors(
    plans: Sequence[Run | Plan], sds: Mapping[str, float], rng: np.random.Generator
) -> dict[str, float]:
    """One draw of the errors of a bench, SI, by name: normal, with the sd of each kind."""
    return {error.name: float(rng.normal(0.0, sds[error.kind])) for error in errors_of(plans, sds)}


def plan_run(spec: RunSpec) -> Plan:
    """Plan of a simulated run, under the run's own name.

    A `StudyError` names a run that is not simulated, or whose options make no run.
    """
    if spec.simulate is None:
        raise StudyError(f"run '{spec.name}' is recorded: it has no profile to simulate")
    options = {key: value for key, value in spec.simulate.items() if key != "profile"}
    try:
        plan = planned(PROFILES[str(spec.simulate["profile"])], options)
    except InputError as error:
        raise StudyError(f"run '{spec.name}': {error}") from None
    return replace(plan, name=spec.name)


def simulate_runs(
    specs: Iterable[RunSpec],
    sensor_class: SensorClass,
    lib: Library,
    *,
    truth: Mapping[str, float],
    rng: np.random.Generator,
    bench: Mapping[str, float] | None = None,
    noise: Noise | None = None,
) -> tuple[tuple[Run, ...], Mapping[str, float]]:
    """Runs of one sensor, and their truth: coefficients, and errors of the bench by name, SI.

    A run has the `noise`, by default that which its spec states by numbers, or else the class's typical one.
    Where `truth` is empty the class gives a unit over the terms of `lib`. Of the sd in SI of each kind of
    error of the `bench` one draw is made, and the runs say nothing of it. It is a `StudyError` if the options
    of a run make no run.
    """
    specs = tuple(specs)
    plans = [plan_run(spec) for spec in specs]
    unit = truth or draw_unit(sensor_class, lib, rng)
    errors = drawn_errors(plans, bench or {}, rng)
    noises = noise or [spec.noise.value for spec in specs]
    runs = simulate(sensor_class, plans, seed=rng, truth=unit, noise=noises, errors=errors)
    return runs, {**unit, **errors}


def simulate_imu(
    specs: Iterable[RunSpec],
    classes: Mapping[Kind, SensorClass],
    libraries: Mapping[Kind, Library],
    *,
    truth: Mapping[str, float],
    rng: np.random.Generator,
    bench: Mapping[Kind, Mapping[str, float]] | None = None,
    noises: Mapping[Kind, Sequence[Noise | None]] | None = None,
) -> tuple[tuple[Run, ...], Mapping[str, float]]:
    """Simulate the runs of a whole IMU, or of a triad: the axes i, j, k of a plan are x, y, z of the case.

    All components see the same motion, errors of the bench included, each along its own axes; their noise
    is independent. Drawn are units, then the bench, then the noise of each component. The truth is as of
    `simulate_runs`, with coefficients by component and term (``ax.b0``); those not named are zero. The
    bench's sds of accelerometers and of gyroscopes differ in ``turn_on``. The `noises` are those of each run,
    as of `simulate`.
    """
    plans = [plan_run(spec) for spec in specs]
    kinds: dict[str, Kind] = {name: kind_of(name) for name in COMPONENTS if kind_of(name) in classes}
    truth = truth or {
        f"{name}.{term}": value
        for name, kind in kinds.items()
        for term, value in draw_unit(classes[kind], libraries[kind], rng).items()
    }
    errors = dict(_bench(plans, bench or {}, rng))
    moved = [replace(plan, inputs=case_inputs(true_inputs(plan, errors))) for plan in plans]
    nominal = [case_inputs(plan.inputs) for plan in plans]
    own = noises or {}
    said = [
        _component(name, classes[kind], moved, nominal, truth, errors, own.get(kind), rng)
        for name, kind in kinds.items()
    ]
    source = Source(notes=(_note(classes),))
    runs: list[Run] = []
    for plan, inputs, *outputs in zip(plans, nominal, *said, strict=True):
        gravity = 0.0
        if plan.procedure == FREE_TUMBLE:  # of a case in the hand only gravity is known
            gravity = float(np.linalg.norm(plan.inputs.vectors("f")[0]))
            inputs = replace(plan.inputs, channels={})
        output = np.column_stack(outputs)
        runs.append(Run(plan.name, plan.procedure, inputs, output, source, gravity=gravity))
    return tuple(runs), {**truth, **errors}


def _bench(
    plans: list[Plan], bench: Mapping[Kind, Mapping[str, float]], rng: np.random.Generator
) -> Iterator[tuple[str, float]]:
    """One draw of the errors of the bench, by name; an offset of the output is each component's own."""
    shared = {name: sd for sds in bench.values() for name, sd in sds.items() if name != OFFSET}
    yield from drawn_errors(plans, shared, rng).items()
    for name in COMPONENTS if bench else ():
        sd = bench.get(kind_of(name), {}).get(OFFSET, 0.0)
        yield from ((f"{OFFSET}.{plan.name}.{name}", rng.normal(0.0, sd)) for plan in plans if sd)


def _component(
    name: str,
    sensor: SensorClass,
    moved: list[Plan],
    nominal: Sequence[Inputs],
    truth: Mapping[str, float],
    errors: Mapping[str, float],
    noise: Sequence[Noise | None] | None,
    rng: np.random.Generator,
) -> list[FloatArray]:
    """What a component says in each run, when the case is moved so."""
    own = {key.partition(".")[2]: value for key, value in truth.items() if key.partition(".")[0] == name}
    plans = [replace(plan, inputs=own_inputs(plan.inputs, name)) for plan in moved]
    told = [own_inputs(inputs, name) for inputs in nominal]
    runs = simulate(sensor, plans, seed=rng, truth=own, noise=noise, said=told)
    return [run.output + errors.get(f"{OFFSET}.{run.name}.{name}", 0.0) for run in runs]


def _note(classes: Mapping[Kind, SensorClass]) -> str:
    if len(classes) == 2 and len({entry.id for entry in classes.values()}) == 1:
        return f"simulated: IMU of class {classes['gyroscope'].id}"
    return f"simulated: {', '.join(f'{kind}s of {entry.id}' for kind, entry in classes.items())}"


def synthesise(noise: Noise, t: FloatArray, interval: float, rng: np.random.Generator) -> FloatArray:
    """One realisation of a noise at arbitrary time stamps.

    Every row is an average over `interval`, s. White noise has the sd ``N / sqrt(interval)``; bias
    instability is a sum of stationary Gauss-Markov processes with time constants in ratio 4 up to ten times
    the span, of which those below a sixteenth of the interval are white; the random walk begins at zero with
    the first row. Rows that are closer than the interval count as rows beside each other. It is an
    `InputError` if t (n,) is empty or not strictly increasing, or the interval not positive.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> synthesise(Noise(0.0, 0.0, 0.0), np.array([0.0, 1.0, 7.5]), 1.0, rng).tolist()
    [0.0, 0.0, 0.0]
    """
    return Drawn(noise, interval, float(np.diff(t).sum()), rng).next(t)


@dataclass(slots=True, eq=False)
class Drawn:
    """One realisation of a noise, a part at a time: what it carries on from one part to the next.

    Attributes
    ----------
    interval, span : of a sample and of all parts, s.
    last : time of the last row of the parts before, s.
    drifts, walk : bias instability's processes, and the random walk, at that row's end.
    inside : source of what the processes do within a row.
    """

    noise: Noise
    interval: float
    span: float
    rng: np.random.Generator
    last: float = -np.inf
    drifts: dict[float, float] = field(default_factory=dict)
    walk: float = 0.0
    inside: np.random.Generator = field(init=False)

    def __post_init__(self) -> None:
        (self.inside,) = self.rng.spawn(1)

    def next(self, t: FloatArray) -> FloatArray:
        """Noise (n,) of the next rows, as `synthesise` has it of a whole record."""
        noise, interval, rng, steps = self.noise, self.interval, self.rng, np.diff(t, prepend=self.last)
        if len(t) == 0 or not (steps > 0.0).all() or not interval > 0.0:
            raise InputError(
                f"noise of {len(t)} samples every {interval} s: expected 1 or more, time increasing"
            )
        # from the start of a row to that of the next, to the first one from the end of the last part
        first, rest = max(float(steps[0]) - interval, 0.0), steps[1:]
        rest = rest[:1] if len(rest) and np.ptp(rest) < _EVEN * interval else rest
        white, variance = rng.standard_normal(len(t)), np.full(len(t), noise.N**2 / interval)
        values = np.zeros(len(t))
        if noise.B > 0.0:
            longest = max(self.span, interval) * _SPANS
            sizes, taus = flicker(noise.B, _FASTEST * interval, longest / _RATIO, _RATIO)
            variance += 2.0 * sizes[0] * taus[0] / (_RATIO - 1.0) / interval  # all that are faster
            for size, tau in zip(sizes.tolist(), taus.tolist(), strict=True):
                self._drift(first, rest, size, tau, values, variance)
        if noise.K > 0.0:
            self._walk(first, rest, values, variance)
        self.last = float(t[-1])
        return values + np.sqrt(variance) * white

    def _drift(
        self,
        first: float,
        rest: FloatArray,
        size: float,
        tau: float,
        values: FloatArray,
        variance: FloatArray,
    ) -> None:
        """Add a Gauss-Markov process of this variance; steps, s, lead to the starts of the rows."""
        from scipy.linalg import get_lapack_funcs

        (solve_banded,) = get_lapack_funcs(("tbtrs",))
        source, n, x = self.rng if tau >= self.interval else self.inside, len(values), self.interval / tau
        z, sd = source.standard_normal(n), np.sqrt(-size * np.expm1(-2.0 * rest / tau))
        # stationary, of first order, ``x_k - exp(-dt/tau) x_(k-1) = innovation``: one banded solve
        innovations = np.empty((n, 1))
        innovations[0] = math.sqrt(-size * math.expm1(-2.0 * first / tau)) * z[0]
        innovations[0] += math.exp(-first / tau) * self.drifts.get(tau, 0.0)
        innovations[1:, 0] = sd * z[1:]
        bands = np.ones((n, 2)).T
        bands[1, :-1] = -np.exp(-rest / tau)
        start = solve_banded(bands, innovations, uplo="L", diag="U")[0][:, 0]
        lost, to_end = -math.expm1(-x), math.sqrt(-size * math.expm1(-2.0 * x))
        series = x * (2.0 / 3.0 - 0.5 * x + 7.0 * x * x / 30.0)
        own = (2.0 * x - 2.0 * lost - lost**2) / x**2 if x > _SLOW else series
        # covariance of a row's mean and of what brings the process from its start to the next one's
        shared, onward = size * lost**2 / x, np.exp((self.interval - rest) / tau) / sd
        last = self._add((shared * onward, shared / to_end), size * own, z, values, variance)
        values += lost / x * start
        self.drifts[tau] = math.exp(-x) * float(start[-1]) + to_end * last

    def _walk(self, first: float, rest: FloatArray, values: FloatArray, variance: FloatArray) -> None:
        """Add the random walk, which starts from zero at the first row of all."""
        size, interval, begun = self.noise.K, self.interval, math.isfinite(first)
        z = self.rng.standard_normal(len(values) - (not begun))
        z = z if begun else np.append(0.0, z)
        begin = self.walk + size * math.sqrt(first) * z[0] if begun else 0.0
        start = np.cumsum(np.append(begin, size * np.sqrt(rest) * z[1:]))
        shared = 0.5 * size * interval / np.sqrt(rest), 0.5 * size * math.sqrt(interval)
        last = self._add(shared, size**2 * interval / 3.0, z, values, variance)
        values += start
        self.walk = float(start[-1]) + size * math.sqrt(interval) * last

    def _add(
        self,
        shared: tuple[FloatArray, float],
        own: float,
        z: FloatArray,
        values: FloatArray,
        variance: FloatArray,
    ) -> float:
        """Add what rows (n,) have beside their starts: by what follows, and a variance of their own.

        It has the covariance `shared` with the normal draw z that follows: for all but the last row, and for
        that. What follows the last row is drawn, and returned.
        """
        last, most = float(self.inside.standard_normal()), math.sqrt(own)
        alike, at_last = np.minimum(shared[0], most), min(shared[1], most)
        values[:-1] += alike * z[1:]
        variance[:-1] += own - alike**2
        values[-1] += at_last * last
        variance[-1] += own - at_last**2
        return last


def simulated_over(
    run: Run,
    lib: Library,
    theta: FloatArray,
    *,
    noise: Noise,
    errors: Mapping[str, float],
    rng: np.random.Generator,
) -> Run:
    """Run with the inputs of another and a simulated output, of coefficients theta (p,), SI.

    The `errors` of its bench are in SI by name. Of a run that is read a part at a time every part is
    simulated whenever it is read: the same rows each time.
    """
    if run.stream is None:
        (part,) = _simulated(run, lib, theta, noise, errors, rng, "")
        return replace(run, output=part.output)
    parts = partial(_simulated, run, lib, theta, noise, errors, rng.spawn(1)[0])
    stream = replace(run.stream, parts=parts)

    def write(part: Part, inside: slice, table: FloatArray) -> None:
        table[:, 0] = part.output[inside]

    first, stop = stream.stretch.first, stream.stretch.first + len(stream.stretch)
    fine = joined_parts([*takewhile(lambda part: part.first < stop, parts("simulation"))])
    stream = replace(stream, stretch=fine.some(slice(first, stop)))
    means, _ = averaged_parts(stream, write, 1)
    return renewed(replace(run, output=frozen(means[:, 0]), stream=stream))


def _simulated(
    run: Run,
    lib: Library,
    theta: FloatArray,
    noise: Noise,
    errors: Mapping[str, float],
    rng: np.random.Generator,
    purpose: str,
) -> Iterator[Part]:
    (bench, sizes), stream = bench_with(run, errors), run.stream
    offset = errors.get(f"{OFFSET}.{run.name}", 0.0)
    if stream is not None:
        # by a latency rows look beyond themselves
        late = float(np.max(np.abs(sizes.get("latency", 0.0))))
        margin, rng = late + stream.interval if late else 0.0, deepcopy(rng)
        run = replace(run, stream=replace(stream, margin=margin))
    drawn = Drawn(noise, run.sampling, float(run.t[-1] - run.t[0]), rng)
    for part in run.parts(purpose):
        own = slice(part.own.start, part.own.stop)
        rows, channels = part.some(own), bench.of(part.inputs).channels(sizes, own.start, own.stop)
        output = drawn.next(rows.t)
        output += columns(lib, channels, len(rows), said=rows.inputs.channels) @ theta
        yield replace(rows, output=output + channels.get(lib.own, 0.0) + offset)


def library_of(kind: Kind, names: Iterable[str]) -> Library:
    """Terms by name, of whatever order, in the equation's; a `TermError` if the kind has no such term.

    Examples
    --------
    >>> library_of("gyroscope", ["g_j", "b4", "b0*T2"]).names
    ('b4', 'g_j', 'b0*T2')
    """
    known, wanted = _every_term(kind), set(names)
    unknown = sorted(wanted - known.keys())
    if unknown:
        raise TermError(
            f"'{unknown[0]}' is not a term of kind {kind}: expected a name such as b0, b2p, c_ij, b0*T"
        )
    return Library(kind, tuple(term for name, term in known.items() if name in wanted))


@cache
def _every_term(kind: Kind) -> dict[str, Term]:
    wide = partial(library, kind, powers=HIGHEST_POWER, asymmetry=HIGHEST_POWER, set="extended")
    names = wide().names
    every = wide(temperature=HIGHEST_POWER, temperature_of=names, rate_of=names, gradient_of=names)
    return {term.name: term for term in every.terms}


def _numbered(plans: Iterable[Plan]) -> Iterator[tuple[str, Plan]]:
    """Plans with names that are unique: a second tumble is ``tumble-2``."""
    seen: dict[str, int] = {}
    for plan in plans:
        seen[plan.name] = seen.get(plan.name, 0) + 1
        yield (plan.name if seen[plan.name] == 1 else f"{plan.name}-{seen[plan.name]}"), plan
