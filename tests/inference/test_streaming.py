"""A run that is read a part at a time against the same run in memory."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from itertools import pairwise

import hands
import made
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imubayes.algebra.factor import least_squares, reorder
from imubayes.inference.case import TriadSpec
from imubayes.inference.dwells import whitened_factor, within_blocks
from imubayes.inference.known_case import solve_known_case
from imubayes.inference.linear import Rows, linear_of
from imubayes.inference.mcmc.split import coordinates, splits_of, values_at
from imubayes.inference.noise_model import noise_rows
from imubayes.inference.nuisances import extras_for, rows_with
from imubayes.inference.prior import ScalePrior, class_sd
from imubayes.inference.residuals import check_residuals
from imubayes.inference.summary import summarize
from imubayes.inference.whiten import begin, effective_samples, processes, states_of, whiten, whiten_on
from imubayes.rig.runs import read_run
from imubayes.rig.simulate import synthesise
from imubayes.selection.compensations import design_factor
from imubayes.sensors.catalogue import sensor as catalogue_sensor
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.sensors.terms import library
from imubayes.study.method import run as study_run
from imubayes.study.schema import read_study

N, INTERVAL = 60_000, 0.01
NOISE = Noise(1e-3, 3e-4, 2e-6)
LIB = library("accelerometer")
GIVEN = {"r": NoiseRule("fixed", NOISE)}
IDENTITY = 1e-10


def recording(n=N, seed=1):
    """Positions with a gap between every two, a rate that changes from row to row, and coloured noise."""
    rng = np.random.default_rng(seed)
    t = INTERVAL * np.arange(n)
    t += 20.0 * np.floor(t / 60.0)
    angle = np.floor(t / 80.0)
    f_i, f_j, w_i, w_j = 9.8 * np.cos(angle), 9.8 * np.sin(angle), rng.normal(size=n), rng.normal(size=n)
    output = f_i + 1e-3 + 2e-4 * f_i + 1e-4 * w_i * w_j + synthesise(NOISE, t, INTERVAL, rng)
    return {
        "t [s]": t,
        "f_i [m/s^2]": f_i,
        "f_j [m/s^2]": f_j,
        "w_i [rad/s]": w_i,
        "w_j [rad/s]": w_j,
        "output [m/s^2]": output,
    }


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """The run in memory, and read a part at a time."""
    return made.both_ways(made.written(recording(), tmp_path_factory.mktemp("run")), 7001)


def off(R, other):
    """Largest difference of what two triangular factors are factors of, over the columns' norms.

    At 1 g columns are collinear: rows of the factor there are rounding, and only their product is not.
    """
    norms = np.linalg.norm(R, axis=0)
    norms = np.where(norms > 0.0, norms, 1.0)
    return np.max(np.abs(R.T @ R - other.T @ other) / np.outer(norms, norms))


def rows_of(kind, n=400):
    rng = np.random.default_rng(7)
    if kind == "even":
        return Rows(0.5 * np.arange(n) + 0.25, np.full(n, 0.5))
    duration = rng.uniform(0.2, 3.0, n)
    start = np.cumsum(np.concatenate(([7.0], duration[:-1] + rng.exponential(2.0, n - 1))))
    return Rows(start + 0.5 * duration, duration)


@pytest.mark.parametrize("kind", ["even", "uneven"])
@pytest.mark.parametrize(
    "noise", [Noise(1.0, 0.7, 0.05), Noise(2.0, 0.0, 0.0), Noise(0.3, 0.7, 0.0), Noise(0.0, 0.7, 0.05)]
)
@settings(max_examples=20, deadline=None)
@given(cuts=st.lists(st.integers(1, 399), max_size=6))
def test_whitening_in_blocks_of_any_sizes_is_whitening_at_once(kind, noise, cuts):
    rows, width = rows_of(kind), 3
    table = np.random.default_rng(2).normal(size=(len(rows.t), width))
    parts = processes(rows, noise)
    at_once, whole = whiten(noise, rows, table.copy(), parts)
    states = len(states_of(noise, parts, rows.duration).rates)
    carry, d = begin(states, float(rows.t[0] - 0.5 * rows.duration[0]), table.shape[1]), []
    edges = sorted({0, *cuts, len(table)})
    for a, b in pairwise(edges):
        t, lasting = rows.t[a:b], rows.duration[a:b]
        d.append(whiten_on(carry, states_of(noise, parts, lasting), t, lasting, table[a:b]))
    assert np.max(np.abs(table - at_once)) <= IDENTITY * np.max(np.abs(at_once))
    assert np.concatenate(d) == pytest.approx(whole, rel=IDENTITY)


def test_a_random_walk_is_whitened_as_well_a_year_on_as_at_its_start():
    n, noise = 300, Noise(1e-3, 0.0, 1e-3)
    rows = Rows(np.arange(n) + 0.5, np.ones(n))
    table = np.random.default_rng(4).normal(size=(n, 1))
    states = states_of(noise, processes(rows, noise), rows.duration)
    early, late = table.copy(), table.copy()
    for start, values in ((0.0, early), (-3e7, late)):
        carry = begin(len(states.rates), start, table.shape[1])
        whiten_on(carry, states, rows.t, rows.duration, values)
    # the first row tells where the walk is; from the second on its past is over but for N/(K sqrt(year))
    assert np.max(np.abs(late[1:] - early[1:])[20:]) <= 1e-6 * np.max(np.abs(early))


def test_pieces_that_noise_is_judged_by_are_the_stretch_and_the_blocks_beside_it(tmp_path):
    t = 0.1 * np.arange(N)
    table = {"t [s]": t, "output [m/s^2]": synthesise(NOISE, t, 0.1, np.random.default_rng(1))}
    whole, part = (
        linear_of(run, LIB) for run in made.both_ways(made.written(table, tmp_path), 7001, stretch=8192)
    )
    means, _ = noise_rows(part)
    assert means.sampling == pytest.approx(0.1)
    start = means.t - 0.5 * means.duration
    assert (start[:-1] + means.duration[:-1] < start[1:] + 1e-6).all()
    # a block that the stretch cuts is left out at either end
    assert means.duration.sum() == pytest.approx(0.1 * N, abs=0.2 * part.stream.counts.max())
    for k in (0, len(means) // 2, len(means) - 1):
        inside = slice(*np.searchsorted(t + 0.05, start[k] + [1e-6, means.duration[k] + 1e-6]))
        assert means.y[k] == pytest.approx(whole.y[inside].mean(), rel=1e-6)


@pytest.mark.parametrize("rules", [GIVEN, {"r": NoiseRule("white")}], ids=["given", "white"])
def test_the_factor_is_that_of_the_rows_in_memory(runs, rules):
    whole, part = (summarize([run], LIB, rules=rules) for run in runs)
    assert part.factor.n == N
    assert pytest.approx(whole.runs[0].noise.N, rel=IDENTITY) == part.runs[0].noise.N
    assert off(whole.factor.R, part.factor.R) <= IDENTITY
    assert part.factor.log_det == pytest.approx(whole.factor.log_det, rel=IDENTITY)
    assert part.facts == whole.facts
    assert part.reach == whole.reach
    assert part.runs[0].ranges == whole.runs[0].ranges
    assert part.runs[0].interval == pytest.approx(whole.runs[0].interval, rel=1e-9)


def test_nearly_dependent_columns_of_a_stream_are_those_of_the_rows_in_memory(tmp_path):
    """At a condition of 1e9 plain sweeps of 60,000 rows differ by 1e-6 sd; others are zero or alike."""
    table = recording()
    table["f_j [m/s^2]"] = table["f_i [m/s^2]"] * (1.0 + 1e-8 * np.random.default_rng(8).normal(size=N))
    lib, noise = library("accelerometer", powers=1, asymmetry=-1), Noise(1e-3, 0.0, 0.0)
    fits = [
        least_squares(reorder(whitened_factor(linear_of(run, lib), noise, sharp=True), ("b0", "b1", "m_j")))
        for run in made.both_ways(made.written(table, tmp_path), 32_768)
    ]
    assert np.max(np.abs(fits[0].mean - fits[1].mean) / fits[0].sd) <= 1e-8


def test_the_noise_is_that_of_the_rows_in_memory_within_error_bars(runs):
    whole, part = (summarize([run], LIB).runs[0] for run in runs)
    for name, sd, other_sd in zip("NBK", whole.found.sd, part.found.sd, strict=True):
        ratio = getattr(part.noise, name) / getattr(whole.noise, name)
        assert abs(np.log(ratio)) <= max(sd, other_sd)


def test_white_noise_is_seen_where_blocks_are_longer_than_it_lasts(tmp_path):
    """White noise is below bias instability beyond 0.04 s: blocks of 1 s do not tell it, the stretch does."""
    noise, n = Noise(1e-3, 5e-3, 0.0), 150_000
    rng = np.random.default_rng(3)
    t = INTERVAL * np.arange(n)
    table = {"t [s]": t, "output [m/s^2]": synthesise(noise, t, INTERVAL, rng)}
    _, run = made.both_ways(made.written(table, tmp_path), 7001)
    found = summarize([run], LIB).runs[0]
    assert found.found.sd[0] < 0.06
    assert abs(np.log(found.noise.N / noise.N)) < 4.0 * found.found.sd[0]
    assert abs(np.log(found.noise.B / noise.B)) < 4.0 * found.found.sd[1]


def test_what_block_averages_leave_is_what_is_left_of_all_rows(runs):
    whole, rows = linear_of(runs[0], LIB), linear_of(runs[1], LIB)
    counts = runs[1].stream.counts
    table = np.column_stack((whole.columns(0, N), whole.y))
    first = np.cumsum(counts) - counts
    means = np.add.reduceat(table, first, axis=0) / counts[:, None]
    left = (table - np.repeat(means, counts, axis=0)) * np.sqrt(whole.duration)[:, None]
    gram = left.T @ left
    R = within_blocks(rows)
    size = np.sqrt(np.diag(table.T @ table) * INTERVAL)
    assert np.max(np.abs(R.T @ R - gram) / np.outer(size, size).clip(1e-300)) <= IDENTITY


def test_any_noise_in_a_millisecond_is_exact_at_the_maximum(runs):
    """The split of a stream into averages and what they leave, mended by whitenings of all rows."""
    summary = summarize([runs[1]], LIB)
    rows = linear_of(runs[1], LIB)
    c = coordinates(summary.factor, np.ones(len(LIB.names)))
    splits, top = splits_of([rows], summary.runs, c)
    b, k = (top[1:] - top[0]).tolist()
    factor = whitened_factor(rows, Noise(1.0, float(np.exp(b)), float(np.exp(k))), splits[0].parts)
    assert values_at(splits[0], np.array([[b, k]]))[0, -1] == pytest.approx(factor.log_det, rel=1e-8)


def test_residuals_of_a_stream_are_tested_by_averages_and_by_samples(runs):
    summary = summarize([runs[1]], LIB, rules=GIVEN)
    rows = linear_of(runs[1], LIB)
    theta = np.zeros(len(LIB.names))
    for name, value in (("b0", 1e-3), ("b1", 2e-4), ("S_ij", 1e-4)):
        theta[LIB.names.index(name)] = value
    check = check_residuals(rows, theta, summary.runs[0])
    # chi-squares of about 360 averages and of 6,000 samples: four standard errors
    assert abs(check.scale - 1.0) < 4.0 / np.sqrt(2.0 * 340)
    assert abs(check.sample_scale - 1.0) < 4.0 / np.sqrt(2.0 * 5000)
    assert check.tau[0] == pytest.approx(INTERVAL)
    assert np.all(np.diff(check.tau) > 0.0)
    assert check.deviation[0] == pytest.approx(check.expected[0], rel=0.1)


def test_effective_samples_of_a_stream_are_those_of_its_rows_in_memory(runs):
    """In averages bias instability hides less behind white noise than in samples: samples are what counts."""
    counted = []
    for run in runs:
        rows = linear_of(run, LIB)
        f = reorder(whitened_factor(rows, NOISE), ("b0", "b1"))
        counted.append(effective_samples(f, [rows], [NOISE]))
    # positions last many blocks, so that an average has the inputs of its samples but at a turn
    assert counted[1] == pytest.approx(counted[0], rel=0.02)


def test_a_stream_weighs_as_many_samples_in_the_rms_of_its_columns(runs):
    whole, part = (design_factor([linear_of(run, LIB)]) for run in runs)
    assert part.n == whole.n == N
    both = ("b0", "b1")
    assert off(reorder(whole, both).R, reorder(part, both).R) < 0.01


STUDY = """
[study]
title = "long"
seed = 1
[[sensor]]
id = "A"
kind = "accelerometer"
class = "mems_tactical"
[[sensor.run]]
name = "r"
procedure = "other"
file = "run.parquet"
[sensor.run.noise]
N = "1e-3 m/s^2/sqrt(Hz)"
B = "3e-4 m/s^2"
K = "2e-6 m/s^2/sqrt(s)"
"""


BENCH = """
[sensor.reference]
gravity = "1e-4 m/s^2"
fixture = "20 arcsec"
table_zero = "10 arcsec"
turn_on = "1e-4 m/s^2"
"""


def tumbling(n=9000, *, knocked=True):
    """Positions in two planes with a long gap between every two, which a mount tells; one may be off."""
    rng = np.random.default_rng(4)
    dwell = np.arange(n) // 250
    t = INTERVAL * np.arange(n) + 20.0 * dwell
    angle, mount = 2.0 * np.pi * (dwell % 18) / 18.0, dwell // 18
    f_i, across = 9.8 * np.cos(angle), 9.8 * np.sin(angle)
    output = f_i + 1e-3 + 2e-4 * f_i + 3e-4 * across * (mount == 0) + 1e-2 * knocked * (dwell == 7)
    output += synthesise(NOISE, t, INTERVAL, rng)
    return {
        "t [s]": t,
        "f_i [m/s^2]": f_i,
        "f_j [m/s^2]": across * (mount == 0),
        "f_k [m/s^2]": across * (mount == 1),
        "mount": mount,
        "output [m/s^2]": output,
    }


def both_ways(folder, monkeypatch, asked):
    """A study of a tumble, of rows in memory, and read a part at a time."""
    made.written(tumbling(knocked="robust" in asked), folder)
    text = STUDY.replace('"other"', '"tumble"').replace(
        'class = "mems_tactical"',
        f'class = "mems_tactical"\nlibrary = {{ powers = 1, asymmetry = -1 }}\n{asked}',
    )
    (folder / "study.toml").write_text(text)
    study = replace(read_study(folder / "study.toml"), compare=False)
    whole = study_run(study).sensors[0]
    made.in_parts(monkeypatch, 1777, tile=333)
    part = study_run(study).sensors[0]
    assert any("read a part at a time" in note for note in part.runs[0].source.notes)
    return whole, part


@pytest.mark.parametrize("asked", ["", f"robust = true{BENCH}"], ids=["nothing", "robust, on a bench"])
def test_what_is_asked_of_a_tumble_is_answered_of_a_long_file_too(tmp_path, monkeypatch, asked):
    whole, part = both_ways(tmp_path, monkeypatch, asked)
    assert part.samples == whole.samples == (8750 if "robust" in asked else 9000)
    assert [one.start for one in part.distrusted] == pytest.approx([one.start for one in whole.distrusted])
    assert [term.verdict for term in part.selection.terms] == [t.verdict for t in whole.selection.terms]
    for term, other in zip(part.selection.terms, whole.selection.terms, strict=True):
        assert abs(term.mean - other.mean) <= 1e-7 * term.prior_sd
        assert term.inclusion == pytest.approx(other.inclusion, abs=1e-6)
    for extra, other in zip(part.extras, whole.extras, strict=True):
        assert (extra.extra, extra.partners) == (other.extra, other.partners)
        assert abs(extra.mean - other.mean) <= 1e-6 * extra.extra.sd
    for name, ends in whole.runs[0].ranges.items():
        assert part.runs[0].ranges[name] == pytest.approx(ends)


def test_memory_for_errors_of_the_bench_does_not_grow_with_the_file(tmp_path, monkeypatch):
    made.in_parts(monkeypatch, 4096, stretch=4096)
    peaks = []
    for n in (20_000, 80_000):
        run = read_run(made.written(recording(n), tmp_path), "accelerometer")
        extras = extras_for([run], {"gravity": 1e-5, "fixture": 1e-4})
        tracemalloc.start()
        (rows,) = rows_with([run], LIB, extras, np.zeros(len(LIB.names)), np.zeros(len(extras)))
        whitened_factor(rows, NOISE)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert rows.samples == n
    assert peaks[1] < 1.5 * peaks[0]


def swinging(n=4000):
    """A table that swings while a sensor 3 ms behind it is recorded, with gaps; a mount halfway."""
    rng = np.random.default_rng(6)
    t = INTERVAL * np.arange(n) + 7.0 * (np.arange(n) // 1500)
    turned = 0.3 * np.sin(2.0 * np.pi * (t - 3e-3) / 1.7), 2.0 * np.sin(2.0 * np.pi * t / 1.7)
    f_i, w = 9.8 * np.sin(turned[0]), turned[1]
    output = f_i + 1e-3 + 2e-4 * f_i + synthesise(NOISE, t, INTERVAL, rng)
    f_said = 9.8 * np.sin(0.3 * np.sin(2.0 * np.pi * t / 1.7))
    return {"t [s]": t, "f_i [m/s^2]": f_said, "w_i [rad/s]": w, "output [m/s^2]": output}


def test_a_latency_of_a_long_file_is_that_of_its_rows_in_memory(tmp_path, monkeypatch):
    """Parts overlap by what the latency reaches for; borders of parts and tiles fall anywhere."""
    spec = made.written(swinging(), tmp_path, "oscillation")
    lib = library("accelerometer", powers=1, asymmetry=-1)
    factors = []
    for rows, tile in ((None, 0), (4000, 4000), (1777, 333), (20, 333)):
        if rows:
            made.in_parts(monkeypatch, rows, tile=tile)
        run = read_run(spec, "accelerometer")
        extras = extras_for([run], {"latency": 5e-3, "gravity": 1e-4})
        # 30 ms reach across several samples, and of the smallest parts across several of these
        nu = np.array([3e-2 if extra.kind == "latency" else 0.0 for extra in extras])
        (linear,) = rows_with([run], lib, extras, np.full(len(lib.names), 1e-4), nu)
        factors.append(whitened_factor(linear, NOISE, sharp=True))
    for other in factors[1:]:
        assert off(factors[0].R, other.R) <= IDENTITY
        assert other.log_det == pytest.approx(factors[0].log_det, rel=IDENTITY)


NOISES = (NOISE, Noise(0.1 * NOISE.N, 0.1 * NOISE.B, 0.1 * NOISE.K))


def imu_recording():
    """Six components of a case in positions with gaps, on a table that moves: coefficients and noise."""
    rng = np.random.default_rng(9)
    place = np.arange(8000) // 250
    t = INTERVAL * np.arange(8000) + 20.0 * place
    f, w = 9.8 * hands.directions(32, rng)[place], rng.uniform(-2.0, 2.0, (32, 3))[place]
    columns = {"t [s]": t}
    for axis, f_own, across, w_own in zip("xyz", f.T, np.roll(f, -1, axis=1).T, w.T, strict=True):
        noise, other = (synthesise(one, t, INTERVAL, rng) for one in NOISES)
        columns[f"f_{axis} [m/s^2]"], columns[f"w_{axis} [rad/s]"] = f_own, w_own
        columns[f"a{axis} [m/s^2]"] = f_own * (1.0 + 1e-3) + 2e-3 * across + 1e-2 + noise
        columns[f"g{axis} [rad/s]"] = w_own * (1.0 - 5e-4) + 1e-3 + other
    return columns, place


def asked_of_imu(reference):
    """What is asked of both kinds, with the noise given."""
    for kind, noise in zip(("accelerometer", "gyroscope"), NOISES, strict=True):
        lib, sensor = library(kind, powers=1, asymmetry=-1), catalogue_sensor("mems_tactical", kind=kind)
        prior = ScalePrior(np.tile(class_sd(sensor, lib), 3))
        yield TriadSpec(lib, prior, sensor, {"r": NoiseRule("fixed", noise)}, reference)


def test_a_shock_of_two_components_costs_a_long_imu_run_what_it_costs_its_rows_in_memory(tmp_path):
    table, place = imu_recording()
    table["ax [m/s^2]"] += 0.1 * (place == 9)
    table["gy [rad/s]"] += 0.01 * (place == 9)
    runs = made.both_ways(made.written(table, tmp_path), 777, "imu")
    whole, part = (solve_known_case([run], *asked_of_imu({}), rng=np.random.default_rng(1)) for run in runs)
    assert {one.run for one in whole.distrusted} == {"r (ax)", "r (gy)"}
    assert [one.run for one in part.distrusted] == [one.run for one in whole.distrusted]
    assert off(part.summary.factor.R, whole.summary.factor.R) <= IDENTITY
    assert_alike(whole, part)


def test_on_a_bench_with_errors_two_long_files_of_an_imu_say_what_their_rows_in_memory_say(tmp_path):
    table, _ = imu_recording()
    rates = {name: table.pop(name) for name in [*table] if name[0] == "g"}
    (tmp_path / "rates").mkdir()
    second = made.written({"t [s]": table["t [s]"], **rates}, tmp_path / "rates")
    spec = replace(made.written(table, tmp_path), gyroscope_file=second.file)
    reference = {"fixture_common": 1e-3, "gravity": 1e-3}
    runs = made.both_ways(spec, 777, "imu")
    assert_alike(*(solve_known_case([run], *asked_of_imu(reference)) for run in runs))


def assert_alike(whole, part):
    """Of two cases, but for where their linearisation settled."""
    assert part.summary.names == whole.summary.names
    sd = np.concatenate([one.prior.sd for one in asked_of_imu({})])
    assert np.max(np.abs(hands.theta_of(whole) - hands.theta_of(part)) / sd) <= 1e-6
    assert [one.samples for one in part.summary.runs] == [one.samples for one in whole.summary.runs]
    assert [one.facts for one in part.components] == [one.facts for one in whole.components]
