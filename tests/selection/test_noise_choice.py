"""Which noise processes a run shows: known truths, on a quiet log and under test, and calibration."""

import math

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet as pq
from quiet_logs import quiet_log

from imubayes.campaign import NoiseQuestion
from imubayes.inference.linear import Linear, linear_of
from imubayes.inference.noise_fit import detection_limits, fit_draws, fit_mode
from imubayes.inference.noise_model import likelihood, noise_rows, process_model
from imubayes.rig import runs, streams
from imubayes.rig.recordings import RunSpec
from imubayes.rig.runs import read_run
from imubayes.selection.noise_choice import SIZES, identify_noise, with_curve
from imubayes.sensors.catalogue import classes, sensor
from imubayes.sensors.noise import OPTIONAL, class_prior
from imubayes.sensors.terms import library

CONSUMER = sensor("mems_consumer", kind="gyroscope")
INTERVAL = 0.1


def linear(y, X=None, procedure="static"):
    X = np.ones((len(y), 1)) if X is None else X
    t = INTERVAL * np.arange(len(y))
    names = tuple(f"c{k}" for k in range(X.shape[1]))
    return Linear("log", procedure, names, t, np.full(len(y), INTERVAL), INTERVAL, y, lambda a, b: X[a:b])


def usual(**sizes):
    """Processes as large as usual in the class, times a factor each; a ramp as it is."""
    known = class_prior(CONSUMER, INTERVAL)
    return {"N": known["N"][0]} | {n: f * (known[n][0] if n != "R" else 1.0) for n, f in sizes.items()}


def chosen(noise, *, samples=20_000, seed=1, candidates=OPTIONAL):
    rng = np.random.default_rng(seed)
    return identify_noise(
        linear(quiet_log(noise, samples, INTERVAL, rng)), CONSUMER, rng=rng, candidates=candidates
    )


@pytest.mark.parametrize(
    ("noise", "candidates"),
    [
        (usual(), ("B", "Q")),
        (usual(B=1.5), ("B", "K")),
        (usual(Q=3.0), ("B", "Q")),
        (usual(R=1e-6), ("B", "R")),
        (usual(B=1.0, K=6.0), ("B", "K", "Q")),
    ],
    ids=["N", "NB", "NQ", "NR", "NBK"],
)
def test_processes_well_above_the_limit_are_found_and_no_others(noise, candidates):
    found = chosen(noise, candidates=candidates)
    assert found.identified == tuple(noise)[1:]
    for name in noise:
        told = found.size(name)
        # a log-normal posterior within four of its sds
        assert abs(noise[name] - told.mean) < 4.0 * told.sd
        if name != "N":
            assert abs(noise[name]) > told.detection_limit


def test_a_process_far_below_the_noise_keeps_its_prior_and_is_not_decided():
    quiet = sensor("fog_navigation", kind="gyroscope")
    rng = np.random.default_rng(5)
    y = quiet_log(usual(), 3000, INTERVAL, rng)
    hidden = identify_noise(linear(y), quiet, rng=rng, candidates=("K",)).size("K")
    assert hidden.inclusion == pytest.approx(0.5, abs=0.12) or hidden.verdict == "not needed"


def test_inseparable_processes_are_a_group_of_which_the_log_shows_one():
    """Ten minutes with a drift that bias instability explains as a random walk does, quantization hidden."""
    found = chosen(usual(B=0.25), samples=6000, candidates=("B", "K", "Q"))
    partners = {size.name: size.confounded_with for size in found.sizes}
    assert partners == {"N": (), "B": ("K",), "K": ("B",), "Q": ()}
    neither = sum(p for names, p in found.sets if not {"B", "K"} & set(names))
    assert neither < 0.05 < 1.0 - max(found.size(name).inclusion for name in ("B", "K"))


def test_evidence_of_one_process_is_its_integral_over_the_prior():
    """Importance draws against quadrature over ln N and ln Q."""
    prior = class_prior(CONSUMER, INTERVAL)
    y = quiet_log(usual(Q=1.0), 1500, INTERVAL, np.random.default_rng(2))
    data = process_model(*noise_rows(linear(y)), prior)
    names = ("N", "Q")
    centers = np.log([prior[n][0] for n in names])
    fit = fit_draws(data, fit_mode(data, names, [centers]), np.random.default_rng(3), enough=64.0)
    sds = np.sqrt(np.diag(fit.root @ fit.root.T))
    axes = [np.linspace(m - 6.0 * s, m + 6.0 * s, 41) for m, s in zip(fit.mode, sds, strict=True)]
    widths = [prior[n][1] for n in names]
    levels = np.array(
        [
            [
                likelihood(data, names, np.array([a, b])).levels[0]
                - 0.5 * (((a - centers[0]) / widths[0]) ** 2 + ((b - centers[1]) / widths[1]) ** 2)
                for b in axes[1]
            ]
            for a in axes[0]
        ]
    )
    cell = (axes[0][1] - axes[0][0]) * (axes[1][1] - axes[1][0]) / (2.0 * np.pi * widths[0] * widths[1])
    expected = math.log(np.exp(levels - levels.max()).sum() * cell) + levels.max()
    # 64 effective draws
    assert fit.log_evidence[0] == pytest.approx(expected, abs=4.0 / math.sqrt(64.0))


def test_a_unit_under_test_shows_the_same_processes_as_a_quiet_log():
    """Dwells of a tumble: what the library explains is projected out, however large."""
    rng = np.random.default_rng(4)
    noise = usual(B=1.5)
    y = quiet_log(noise, 20_000, INTERVAL, rng)
    angle = np.repeat(np.arange(50) * 0.4, 400)
    X = np.column_stack((np.ones(20_000), np.cos(angle), np.sin(angle), np.cos(2.0 * angle)))
    tested = identify_noise(
        linear(y + X @ [1.0, 0.3, -0.2, 0.1], X, "tumble"), CONSUMER, rng=rng, candidates=("B", "Q")
    )
    assert tested.identified == ("B",)
    assert abs(tested.size("B").mean - noise["B"]) < 4.0 * tested.size("B").sd


def test_two_routes_agree_on_the_sizes():
    noise = usual(B=1.5, Q=2.0)
    rng = np.random.default_rng(6)
    y = quiet_log(noise, 20_000, INTERVAL, rng)
    rows = linear(y)
    choice = identify_noise(rows, CONSUMER, rng=rng, candidates=("B", "Q"))
    found = with_curve(choice, rows, np.array([y.mean()]))
    assert found.fit.names == ("N", "B", "Q")
    for name, value, log_sd in zip(found.fit.names, found.fit.values, found.fit.log_sd, strict=True):
        size = found.size(name)
        assert abs(value - size.mean) < 4.0 * math.hypot(size.sd, value * log_sd)


def test_only_the_runs_that_are_asked_are_judged():
    log, tumble = linear(np.zeros(200)), linear(np.zeros(200), procedure="tumble")
    asked = {
        ask: (NoiseQuestion(ask).asks(log), NoiseQuestion(ask).asks(tumble))
        for ask in ("static", "all", "none")
    }
    assert asked == {"static": (True, False), "all": (True, True), "none": (False, False)}
    assert not NoiseQuestion("all").asks(linear(np.zeros(50)))


def calibration(logs, samples=36_000, seed=20):
    """Sizes and processes drawn from the priors of every class: what the identification says of each log.

    Of each size, whether its 90 % interval holds the truth; and counts of processes above their limits, of
    these not found, found and not there, of logs with all processes above, and of these with the right set.
    """
    rng = np.random.default_rng(seed)
    inside = {name: [] for name in SIZES}
    count = dict.fromkeys(("strong", "missed", "false", "judged", "right"), 0)
    for k in range(logs):
        entry = classes()[k % len(classes())]
        prior = class_prior(entry, INTERVAL)
        drawn = ("N", "B", "K", "Q", "G", "tau")
        known = {n: prior[n][0] * math.exp(prior[n][1] * rng.standard_normal()) for n in drawn}
        present = [name for name in OPTIONAL if rng.random() < 0.5]
        known["R"] = prior["R"][1] * rng.standard_normal() if "R" in present else 0.0
        there = ("N", *present, *(["tau"] if "G" in present else []))
        noise = {name: known[name] for name in there}
        rows = linear(quiet_log(noise, samples, INTERVAL, rng))
        choice = identify_noise(rows, entry, rng=rng)
        for size in choice.sizes:
            if size.name in there and math.isfinite(size.q05):
                inside[size.name].append(size.q05 <= noise[size.name] <= size.q95)
        limits = detection_limits(process_model(*noise_rows(rows), prior), noise, OPTIONAL)
        strong = {name for name in present if abs(noise[name]) > limits[name]}
        found = set(choice.identified)
        count["strong"] += len(strong)
        count["missed"] += len(strong - found)
        count["false"] += len(found - set(present))
        if strong == set(present):
            count["judged"] += 1
            count["right"] += found == strong
    return inside, count


@pytest.mark.slow
def test_catalogue_wide_intervals_cover_and_sets_are_right_above_their_limits():
    """Intervals of 90 %, 19 of 20 processes found above their limits, and 19 of 20 sets right."""
    inside, count = calibration(120)
    for held in inside.values():
        assert abs(np.mean(held) - 0.9) < 4.0 * math.sqrt(0.09 / len(held))
    assert count["missed"] <= 0.05 * count["strong"] + 4.0 * math.sqrt(0.0475 * count["strong"])
    assert count["right"] >= 0.95 * count["judged"] - 4.0 * math.sqrt(0.0475 * count["judged"])
    assert count["false"] <= 0.01 * 120 * len(OPTIONAL)


def test_a_streamed_log_shows_the_processes_that_its_rows_in_memory_show(tmp_path, monkeypatch):
    """Quantization shows in single samples of a stretch, random walk in averages over the whole run."""
    noise = usual(Q=3.0, K=20.0)
    samples = 40_000
    y = quiet_log(noise, samples, INTERVAL, np.random.default_rng(2))
    table = {"t [s]": INTERVAL * np.arange(samples), "output [rad/s]": y}
    pq.write_table(pa.table(table), tmp_path / "log.parquet")
    monkeypatch.setattr(streams, "STREAMED", 1000)
    monkeypatch.setattr(runs, "STRETCH", 4096)
    lib = library("gyroscope", powers=1, asymmetry=-1)
    run = read_run(RunSpec("log", "static", file=tmp_path / "log.parquet"), "gyroscope")
    assert run.record is not None  # coefficients are of means, noise of what quantization shows in
    rows = linear_of(run.record, lib)
    candidates = ("B", "K", "Q")
    theta = np.zeros(len(lib.names))
    choice = identify_noise(rows, CONSUMER, rng=np.random.default_rng(1), candidates=candidates)
    found = with_curve(choice, rows, theta)
    assert found.identified == ("K", "Q")
    assert found.samples == samples
    for name in ("N", "K", "Q"):
        told = found.size(name)
        assert abs(noise[name] - told.mean) < 4.0 * told.sd
    assert found.fit is not None
    assert "Q" not in found.fit.names
