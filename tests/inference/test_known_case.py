"""A whole IMU with known inputs: six sensors apart, the forward model, drawn units, what a fixture hides."""

import math
from dataclasses import replace

import hands
import numpy as np
import pytest

from imubayes.algebra.factor import posterior, posterior_root
from imubayes.errors import UnobservableError
from imubayes.inference.case import TriadSpec
from imubayes.inference.known_case import solve_known_case
from imubayes.inference.prior import ScalePrior, class_sd
from imubayes.inference.summary import summarize
from imubayes.inference.triad import RELATIVE, angles_of
from imubayes.rig.inputs import Inputs, Run
from imubayes.rig.recordings import RunSpec
from imubayes.rig.simulate import simulate_imu
from imubayes.sensors.catalogue import sensor, typical_noise
from imubayes.sensors.imu import COMPONENTS, Component, forward, imu_of, kind_of, signals
from imubayes.sensors.noise import Noise, NoiseRule
from imubayes.sensors.terms import library

KINDS = ("accelerometer", "gyroscope")
CLASSES = {kind: sensor("mems_tactical", kind=kind) for kind in KINDS}
SMALL = {
    "accelerometer": library("accelerometer", powers=2, asymmetry=-1),
    "gyroscope": library("gyroscope", powers=2, asymmetry=-1),
}
SPECS = (
    RunSpec("tumble", "tumble", simulate={"profile": "tumble", "angles": 8, "dwell": 10.0, "rate": 2.0}),
    RunSpec(
        "table",
        "rate-table",
        simulate={"profile": "rate-table", "rates": (-1.0, 0.3, 2.0), "dwell": 10.0, "rate": 2.0},
    ),
)
QUIET = {"accelerometer": Noise(1e-5, 0.0, 0.0), "gyroscope": Noise(1e-7, 0.0, 0.0)}


def asked(lib=SMALL, *, rules=None, reference=None):
    """What is asked of each kind; `rules` gives the noise rule of every run of a kind."""
    return tuple(
        TriadSpec(
            lib[kind],
            ScalePrior(np.tile(class_sd(CLASSES[kind], lib[kind]), 3)),
            CLASSES[kind],
            None if rules is None else dict.fromkeys(("tumble", "table", "run"), rules[kind]),
            dict(reference or {}),
        )
        for kind in KINDS
    )


def fixed(noises):
    return {kind: NoiseRule("fixed", noise) for kind, noise in noises.items()}


def given():
    """Noise that the simulation has."""
    return fixed({kind: typical_noise(entry) for kind, entry in CLASSES.items()})


def simulated(seed, reference=None, truth=None, lib=SMALL, specs=SPECS):
    bench = {kind: dict(reference) for kind in KINDS} if reference else {}
    rng = np.random.default_rng(seed)
    return simulate_imu(specs, CLASSES, lib, truth=truth or {}, bench=bench, rng=rng)


def estimates(case, wanted):
    mean, sd = posterior(case.summary.factor, hands.prior_of(wanted, case))
    return dict(zip(case.summary.names, zip(mean, sd, strict=True), strict=True))


def angles(case, wanted):
    found = angles_of(case.triads, case.summary, hands.prior_of(wanted, case))
    return {(angle.of, angle.name): angle for angle in found}


def spoken(f, w, truth, noise=None):
    """Run whose outputs are those of the vectorised forward model."""
    n = len(f)
    parts = {}
    for name in COMPONENTS:
        lib = SMALL[kind_of(name)]
        parts[name] = Component(lib, np.array([truth.get(f"{name}.{term}", 0.0) for term in lib.names]))
    said = forward(imu_of(parts), signals(f, w))
    output = np.column_stack((said.f, said.w))
    channels = {f"{q}_{axis}": v[:, k] for q, v in (("f", f), ("w", w)) for k, axis in enumerate("xyz")}
    return Run("run", "other", Inputs(np.arange(n) * 1.0, channels, 1.0), output)


def applied(run):
    """What an IMU without errors says (n, 6)."""
    nothing = np.zeros(len(run.inputs))
    return np.column_stack([run.inputs.channels.get(f"{q}_{axis}", nothing) for q in "fw" for axis in "xyz"])


@pytest.mark.parametrize("rule", ["estimated", "white", "given"])
def test_without_errors_of_the_bench_six_components_are_what_each_is_alone(rule):
    rules = {"estimated": None, "white": dict.fromkeys(KINDS, NoiseRule("white")), "given": given()}[rule]
    runs, _ = simulated(3)
    wanted = asked(rules=rules)
    together = estimates(solve_known_case(runs, *wanted), wanted)
    for name in COMPONENTS:
        one = wanted[KINDS.index(kind_of(name))]
        alone = summarize(
            [run.component(name) for run in runs], one.library, sensor=one.sensor, rules=one.rules
        )
        mean, sd = posterior(alone.factor, one.prior.sd[: len(one.library.terms)])
        for term, value, spread in zip(one.library.names, mean, sd, strict=True):
            found = together[f"{name}.{term}"]
            assert found[0] == pytest.approx(value, rel=1e-9, abs=1e-9 * spread), (name, term)
            assert found[1] == pytest.approx(spread, rel=1e-9), (name, term)


def test_forward_model_of_an_imu_is_inverted_term_by_term():
    """Axes of every component, by a route that shares no code with the columns: the vectorised model."""
    rng = np.random.default_rng(1)
    sizes = {
        f"{name}.{term.name}": sd
        for name in COMPONENTS
        for term, sd in zip(
            SMALL[kind_of(name)].terms, class_sd(CLASSES[kind_of(name)], SMALL[kind_of(name)]), strict=True
        )
        if not any(f.channel.startswith("dw") for f in term.factors)
    }
    truth = {name: rng.normal(0.0, sd) for name, sd in sizes.items()}
    run = spoken(rng.normal(0.0, 20.0, (400, 3)), rng.normal(0.0, 2.0, (400, 3)), truth)
    wanted = asked(rules=fixed({kind: Noise(1e-9, 0.0, 0.0) for kind in KINDS}))
    found = estimates(solve_known_case([run], *wanted), wanted)
    for name, value in truth.items():
        assert found[name][0] == pytest.approx(value, rel=0.0, abs=1e-6 * sizes[name]), name


BENCH = {"gravity": 1e-3, "rate_scale": 3e-4, "plane_zero": 2e-4, "turn_on": 1e-3}


def test_units_and_benches_drawn_from_the_priors_are_as_far_off_as_the_posterior_says():
    """Squared distance in the joint posterior is chi-square with as many degrees as columns."""
    distances = []
    for seed in range(4):
        runs, truth = simulated(seed, BENCH)
        wanted = asked(rules=given(), reference=BENCH)
        case = solve_known_case(runs, *wanted)
        mean, root = posterior_root(case.summary.factor, hands.prior_of(wanted, case))
        off = mean - np.array([truth[name] for name in case.summary.names])
        distances.append(float(np.sum(np.linalg.solve(root, off) ** 2)) / len(off))
    freedom = len(distances) * len(mean)
    assert np.mean(distances) == pytest.approx(1.0, abs=4.0 * math.sqrt(2.0 / freedom))


def test_a_rotation_in_the_fixture_moves_the_six_components_as_one_vector():
    """Linearised column of the case against finite rotation of all inputs, by Rodrigues in another frame."""
    rho = np.array([2e-4, -3e-4, 1e-4])
    runs, _ = simulated(1, specs=SPECS[1:])
    (run,) = runs
    wanted = asked(rules=given(), reference={"fixture_common": 1e-3})
    case = solve_known_case(runs, *wanted, blind=True)
    names = case.summary.names
    columns = [names.index(f"fixture_common_{axis}") for axis in "ijk"]
    own_inputs = np.split(applied(run), 2, axis=1)
    for k, rows in enumerate(case.rows):
        own = own_inputs[k // 3]
        moved = -np.cross(rho, own)[:, k % 3]
        np.testing.assert_allclose(rows.columns(0, len(rows))[:, columns] @ rho, moved, atol=1e-9)


LINEAR = {kind: hands.only(kind, ("b0", "b1", "m_j", "m_k")) for kind in KINDS}
FACES = (
    RunSpec("run", "tumble", simulate={"profile": "positions", "positions": 6, "dwell": 50.0, "rate": 1.0}),
)


def test_what_a_fixture_hides_of_a_triad_is_its_rotation_and_not_its_angles():
    """Six faces: each m is known by 100 s at 1 g; an angle is a sum of two, a rotation as its prior."""
    rho, noise = 1e-3, QUIET["accelerometer"]
    (run,), _ = simulated(1, lib=LINEAR, specs=FACES)
    # an IMU without errors: the allowance for tilted axes moves misalignments by what the scale is off
    runs = [replace(run, output=applied(run))]
    wanted = asked(LINEAR, rules=fixed(QUIET), reference={"fixture_common": rho})
    found = angles(solve_known_case(runs, *wanted), wanted)
    one = noise.N / (math.sqrt(100.0) * 9.80665)
    prior = class_sd(CLASSES["accelerometer"], LINEAR["accelerometer"])[
        LINEAR["accelerometer"].names.index("m_j")
    ]
    hidden = 1.0 / math.hypot(1.0 / rho, math.sqrt(2.0) / prior)
    for pair in ("xy", "yz", "zx"):
        angle = found["accelerometer", f"nonorthogonality_{pair}"]
        assert angle.sd == pytest.approx(math.sqrt(2.0) * one, rel=1e-4)
    for axis in "xyz":
        assert found["accelerometer", f"rotation_{axis}"].sd == pytest.approx(hidden, rel=1e-3)


def test_rotation_of_one_triad_against_the_other_does_not_depend_on_the_fixture():
    truth = {"ax.m_j": 4e-4, "ay.m_k": -4e-4, "gx.m_j": -1e-4, "gy.m_k": 3e-4}
    runs, drawn = simulated(4, {"fixture_common": 2e-3}, truth)
    wanted = asked(rules=given(), reference={"fixture_common": 2e-3})
    found = angles(solve_known_case(runs, *wanted), wanted)
    against = found[RELATIVE, "rotation_z"]
    # about z: half the difference of what x has of y and y has of x
    assert against.mean == pytest.approx((-1e-4 - 3e-4) / 2.0 - (4e-4 + 4e-4) / 2.0, abs=4.0 * against.sd)
    assert against.sd < 0.1 * found["gyroscope", "rotation_z"].sd
    angle = found["gyroscope", "nonorthogonality_xy"]
    assert angle.mean == pytest.approx(-1e-4 + 3e-4, abs=4.0 * angle.sd)
    assert abs(drawn["fixture_common_k"]) > 10.0 * against.sd


def test_a_check_does_not_look_at_what_the_imu_said():
    runs, _ = simulated(1)
    silent = [Run(run.name, run.procedure, run.inputs, np.zeros_like(run.output)) for run in runs]
    wanted = asked(rules=given(), reference=BENCH)
    said, unsaid = (solve_known_case(r, *wanted, blind=True).summary.factor.R for r in (runs, silent))
    size = np.linalg.norm(said, axis=0)[:-1]
    shapes = [(R.T @ R)[:-1, :-1] / np.outer(size, size).clip(min=1e-300) for R in (said, unsaid)]
    np.testing.assert_allclose(shapes[0], shapes[1], rtol=0.0, atol=1e-10)


def test_an_error_that_changes_nothing_is_refused():
    runs, _ = simulated(1, specs=SPECS[:1])
    with pytest.raises(UnobservableError, match=r"'radius' .* changes nothing in any run"):
        solve_known_case(runs, *asked(rules=given(), reference={"radius": 1e-4}))


LONGER = replace(SPECS[1], simulate={**SPECS[1].simulate, "rates": tuple(np.linspace(-2.0, 2.0, 12))})


def shocked(runs, dwells, size=300.0):
    """Runs in which dwells of 10 s, by run and component, are off by so many sds of their means."""
    noise = {kind: typical_noise(CLASSES[kind]) for kind in KINDS}
    moved = {run.name: run.output.copy() for run in runs}
    for (run, name), dwell in dwells.items():
        own = noise[kind_of(name)]
        off = size * math.hypot(own.N / math.sqrt(10.0), own.B)
        moved[run][20 * dwell : 20 * (dwell + 1), COMPONENTS.index(name)] += off
    return tuple(replace(run, output=moved[run.name]) for run in runs)


def test_gross_outliers_cost_an_imu_the_dwells_of_the_components_that_they_reached():
    reference = {"fixture_common": 1e-4}
    wanted = asked(reference=reference)
    runs, truth = simulated(5, reference, specs=(SPECS[0], LONGER))
    dwells = {("tumble", "ax"): 4, ("tumble", "gy"): 11, ("table", "gz"): 3}
    spoilt = shocked(runs, dwells)
    found = solve_known_case(spoilt, *wanted, rng=np.random.default_rng(1))
    starts = {run.name: run.inputs.t[::20] - 0.25 for run in runs}
    said = {d.run: d.start for d in found.distrusted}
    assert said == pytest.approx({f"{run} ({c})": starts[run][k] for (run, c), k in dwells.items()})
    told, naive = estimates(found, wanted), estimates(solve_known_case(spoilt, *wanted), wanted)
    pulls = {name: abs(told[name][0] - truth[name]) / told[name][1] for name in truth if name in told}
    assert max(pulls.values()) < 4.0
    assert max(abs(naive[name][0] - truth[name]) / told[name][1] for name in pulls) > 5.0
    kept = [len(run.inputs) - 20 * ((run.name, name) in dwells) for name in COMPONENTS for run in runs]
    assert [len(rows) for rows in found.rows] == kept
