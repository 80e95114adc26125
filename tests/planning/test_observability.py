"""What a test can tell: the facts of real procedures and benches in words, and the laws of the numbers."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import imubayes as ib
from imubayes.algebra.factor import factor_of, reorder
from imubayes.inference.nuisances import extras_for, rows_with
from imubayes.inference.observability import observe
from imubayes.inference.prior import class_sd
from imubayes.inference.summary import summarize
from imubayes.rig.bench import KINDS
from imubayes.rig.inputs import UNKNOWN, Inputs, Run
from imubayes.rig.plans import Plan
from imubayes.sensors.catalogue import typical_noise
from imubayes.sensors.noise import NoiseRule

seeds = st.integers(0, 2**32 - 1)
SPHERE = ("b0", "b2", "c_jj", "c_kk")
SERVO, FOG = "quartz_flexure_servo", "fog_navigation"


def observed(class_id, plans, bench=(), **options):
    """Observability of plans on a sensor with the typical noise of its class, and the summary it is of."""
    kind = "gyroscope" if class_id == FOG else "accelerometer"
    sensor, library = ib.sensor(class_id, kind=kind), ib.library(kind, **options)
    runs = ib.simulate(sensor, plans, seed=1, truth={})
    rules = {run.name: NoiseRule("fixed", typical_noise(sensor)) for run in runs}
    extras = extras_for(runs, dict(bench), sensor=kind)
    rows = rows_with(runs, library, extras, np.zeros(len(library.terms)), np.zeros(len(extras)))
    summary = summarize(runs, library, sensor=sensor, rules=rules, rows=rows, extras=extras)
    sd = np.concatenate((class_sd(sensor, library), [extra.sd for extra in extras]))
    return observe(summary.factor, sd, summary.facts, reach=summary.reach), summary


def untested(seen):
    return {name for name, tested in zip(seen.names, seen.tested, strict=True) if not tested}


def test_three_plane_tumble_hides_one_combination():
    seen, summary = observed("quartz_flexure_servo", [ib.tumble(angles=24, planes=3, rate=1.0)])
    (group,) = [group for group in seen.groups if group.exact]
    assert group.terms == SPHERE
    assert group.reason == "|f| = g in every row"
    assert group.remedy == "a centrifuge run would separate them"
    assert group.seen == pytest.approx(1.0, abs=1e-9)
    # b0 + (b2, c_jj, c_kk) |f|^2: the sum is g^2 times what is added to the three, taken from the bias
    g2 = 9.80665**2
    np.testing.assert_allclose(
        np.array(group.direction) / group.direction[1], [-g2, 1.0, 1.0, 1.0], rtol=1e-6, atol=0.0
    )
    assert untested(seen) == {"S_ij", "S_ik", "S_jk", "s_i", "s_j", "s_k"}
    assert all(seen.partners(name) == tuple(t for t in SPHERE if t != name) for name in SPHERE)
    assert summary.facts.force == pytest.approx(9.80665)


def test_what_a_log_at_rest_hides_is_told_by_turning_the_sensor_over_where_that_does():
    log, turned = (ib.static(3600.0, 0.1, up=(x, x / 2.0, x / 5.0)) for x in (1.0, -1.0))
    options = {"powers": 1, "asymmetry": -1}
    seen, _ = observed("mems_tactical", [log], **options)
    groups = [group for group in seen.groups if "case turned over" in group.remedy]
    assert {name for group in groups for name in group.terms} == {"b0", "b1", "m_j", "m_k"}
    assert {group.reason for group in groups} == {"f and w are the same in every row"}
    both, _ = observed("mems_tactical", [log, replace(turned, name="turned")], **options)
    assert not {"b1", "m_j", "m_k"} & set(both.partners("b0"))


def test_tumble_and_centrifuge_together_hide_nothing_exactly():
    plans = [ib.tumble(angles=24, rate=1.0), ib.centrifuge([1, 5, 10, 20], rate=1.0)]
    seen, _ = observed("mems_tactical", plans)
    assert not [group for group in seen.groups if group.exact]
    assert untested(seen) == {"s_i", "s_j", "s_k"}
    assert np.all(np.isfinite(seen.vif[seen.tested]))
    assert {"b0", "b1", "b2", "c_jj", "c_kk"} <= {
        name for name, ratio in zip(seen.names, seen.ratio, strict=True) if ratio < 0.5
    }


def design(seed, n=40, p=6):
    rng = np.random.default_rng(seed)
    X = (
        rng.normal(size=(n, p))
        @ (np.eye(p) + np.triu(rng.normal(size=(p, p)), 1))
        * 10.0 ** rng.uniform(-4.0, 4.0, p)
    )
    return X, 10.0 ** rng.uniform(-1.0, 1.0, p) / np.linalg.norm(X, axis=0)


def seen_of(X, sd, scale=1.0):
    names = tuple(f"x{j}" for j in range(X.shape[1]))
    return observe(factor_of(X, np.zeros(len(X)), names), sd, UNKNOWN, scale=scale)


def textbook(X, j):
    """Variance inflation 1 / (1 - R^2) of a column by the others."""
    others = np.delete(X, j, axis=1) / np.linalg.norm(np.delete(X, j, axis=1), axis=0)
    left = X[:, j] - others @ np.linalg.lstsq(others, X[:, j], rcond=None)[0]
    return X[:, j] @ X[:, j] / (left @ left)


@given(seeds)
def test_variance_inflation_is_the_textbook_formula(seed):
    X, sd = design(seed)
    expected = [textbook(X, j) for j in range(X.shape[1])]
    # rounding in either route grows with the inflation itself
    np.testing.assert_allclose(seen_of(X, sd).vif, expected, rtol=1e-12 * max(expected) + 1e-10)


@given(seeds, st.floats(0.1, 10.0))
def test_ratio_is_posterior_over_prior_sd_of_the_dense_posterior(seed, scale):
    X, sd = design(seed)
    posterior = np.linalg.inv((X * sd).T @ (X * sd) / scale**2 + np.eye(X.shape[1]))  # prior sds as units
    seen = seen_of(X, sd, scale)
    np.testing.assert_allclose(seen.ratio, np.sqrt(np.diag(posterior)), rtol=1e-8)
    alone = 1.0 / np.sqrt(1.0 + np.sum((X * sd) ** 2, axis=0) / scale**2)
    np.testing.assert_allclose(seen.alone, alone, rtol=1e-12)
    assert np.all(seen.ratio >= seen.alone * (1.0 - 1e-12))


def planted(seed):
    """Seven columns: x1 is a mixture of x3 and x5, and x6 is x0 in another unit."""
    X, _ = design(seed, p=7)
    unit = X / np.linalg.norm(X, axis=0)
    X[:, 1] = (unit[:, 3] - 0.5 * unit[:, 5]) * 3e2
    X[:, 6] = 1e-3 * X[:, 0]
    return X, 5.0 / np.linalg.norm(X, axis=0)


@given(seeds)
def test_planted_dependence_is_found_and_its_direction_cancels(seed):
    X, sd = planted(seed)
    groups = {group.terms: group for group in seen_of(X, sd).groups if group.exact}
    assert set(groups) == {("x1", "x3", "x5"), ("x0", "x6")}
    for terms, group in groups.items():
        columns = X[:, [int(name[1]) for name in terms]] * group.direction
        assert np.linalg.norm(columns.sum(axis=1)) < 1e-10 * np.linalg.norm(columns)
    rounded = X * (1.0 + 1e-9 * np.random.default_rng(seed).normal(size=X.shape))
    expected = [textbook(X[:, [0, 2, 3, 4, 5]], j) for j in (1, 3)]
    for vif in (seen_of(X, sd).vif, seen_of(rounded, sd).vif):
        assert np.all(np.isinf(vif[[0, 1, 3, 5, 6]]))
        np.testing.assert_allclose(vif[[2, 4]], expected, rtol=1e-5)


@pytest.mark.parametrize(
    "plan", [ib.static(600.0, 1.0), ib.centrifuge([1, 5, 20], mounts=2, rate=1.0)], ids=lambda plan: plan.name
)
def test_partners_do_not_depend_on_the_order_of_the_library(plan):
    """Where several combinations cancel, their null space has many bases."""
    seen, summary = observed("mems_tactical", [plan])
    library, rng = summary.library, np.random.default_rng(1)
    sd = ib.prior(ib.sensor("mems_tactical", kind="accelerometer"), library).sd
    for _ in range(5):
        order = rng.permutation(len(sd))
        names = [library.names[j] for j in order]
        other = observe(reorder(summary.factor, names), sd[order], summary.facts)
        assert all(set(other.partners(name)) == set(seen.partners(name)) for name in names)


def test_columns_that_differ_by_less_than_the_noise_are_told_as_such():
    rng = np.random.default_rng(3)
    a, b = np.linalg.qr(rng.normal(size=(50, 2)))[0].T
    X = np.column_stack((100.0 * a, 100.0 * a + 0.3 * b))
    (group,) = seen_of(X, np.ones(2)).groups
    assert group.terms == ("x0", "x1") and not group.exact
    assert 0.7 < group.seen < 1.0
    # what they have in common is seen; turned up thirtyfold, so is what tells them apart
    assert not seen_of(30.0 * X, np.ones(2)).groups


def test_a_term_s_partner_is_the_rotation_that_moves_the_output_as_it_does():
    """Six positions of three faces: one about the input axis moves a misaligned sensor 200 times less."""
    sensor, library = ib.sensor("mems_consumer", kind="accelerometer"), ib.library("accelerometer", powers=1)
    faces = 9.81 * np.repeat(np.vstack((np.eye(3), -np.eye(3)))[[0, 3, 1, 4, 2, 5]], 3, axis=0)
    channels = dict(zip(("f_i", "f_j", "f_k"), faces.T, strict=True))
    inputs = Inputs(np.arange(18.0), channels, 1.0, np.repeat(np.arange(3), 6))
    run = Run("tumble", "tumble", inputs, faces[:, 0])
    extras = extras_for([run], {"fixture": 1e-3})
    tilted = np.where(np.isin(library.names, ["m_j", "m_k"]), 5e-3, 0.0)
    rows = rows_with([run], library, extras, tilted, np.zeros(len(extras)))
    rules = {"tumble": NoiseRule("fixed", ib.Noise(1e-4, 0.0, 0.0))}
    summary = summarize([run], library, rules=rules, rows=rows, extras=extras)
    sd = np.append(ib.prior(sensor, library).sd, [extra.sd for extra in extras])
    seen = observe(summary.factor, sd, summary.facts, reach=summary.reach)
    hidden = {name: [n for n in seen.partners(name) if n.startswith("fixture")] for name in ("m_j", "m_k")}
    assert hidden == {"m_j": ["fixture_k.tumble.1"], "m_k": ["fixture_j.tumble.2"]}
    columns = rows[0].X
    for name, (partner,) in hidden.items():
        ways = columns[:, [summary.names.index(name), summary.names.index(partner)]]
        move = np.linalg.svd(ways)[2][-1]  # along the direction that they share nothing moves
        assert np.linalg.norm(ways @ move) < 1e-3 * np.linalg.norm(ways[:, 0] * move[0])
        assert 0.3 < abs(move[1] / move[0]) < 3.0


@pytest.mark.parametrize(("angles", "class_id"), [(4, "mems_consumer"), (24, "quartz_flexure_servo")])
def test_partners_move_together_without_a_trace(angles, class_id):
    """Along the direction that they are said to share, prior-sized: by less than the noise over the test."""
    plans = [ib.tumble(angles=angles, rate=1.0), ib.centrifuge([1, 5, 20], mounts=6, rate=1.0)]
    seen, summary = observed(class_id, plans)
    for group in seen.groups:
        theta = np.zeros(len(seen.names))
        theta[[seen.names.index(name) for name in group.terms]] = group.direction
        assert np.linalg.norm(summary.factor.R[:-1, :-1] @ theta) < 1.0, group.terms


TUMBLE = ib.tumble(angles=24, rate=1.0)
PLANE = ib.tumble(angles=24, planes=1, rate=1.0)
ARM = ib.centrifuge([1, 2, 5, 10, 20], rate=1.0)
FLAT = ib.centrifuge([1, 2, 5, 10, 20], mounts=8, rate=1.0)
OUTWARD = ib.centrifuge([1, 2, 5, 10, 20], mounts=1, rate=1.0)
TABLE = ib.rate_table(np.radians([-200, -50, -10, 10, 50, 200]), rate=1.0)
T = np.arange(4000) / 100.0
SWING = Plan(
    "swing",
    "oscillation",
    Inputs(T, {"w_i": np.sin(2.0 * T), "dw_i": 2.0 * np.cos(2.0 * T), "f_i": np.full(4000, 9.8)}, 0.01),
)


FIXTURE = "rotation of the case in its fixture"
HIDDEN = [
    (SERVO, [TUMBLE], {"gravity": 1e-3}, ("b1", "gravity"), "error of local gravity", "a survey of local"),
    (SERVO, [FLAT], {"radius": 50e-6}, ("b1", "radius"), "error of the arm's radius", "tumble"),
    (SERVO, [TUMBLE, FLAT], {"radius": 50e-6, "gravity": 1e-3}, ("b1", "radius", "gravity"),
     "error of local gravity and the error of the arm's radius act on the output as b1 does", "survey"),
    (SERVO, [OUTWARD], {"arm_stretch": 1e-7}, ("b2", "arm_stretch"), "stretch of the arm", "under load"),
    (SERVO, [TUMBLE], {"turn_on": 1e-3}, ("b0", "turn_on.tumble"), "turned on", "turned off before each"),
    (SERVO, [TUMBLE, ARM], {"turn_on": 1e-3}, ("b0", "turn_on.tumble", "turn_on.centrifuge"),
     "turned on", "turned off before each"),
    (SERVO, [PLANE], {"plane_zero": 1e-5}, ("m_j", "plane_zero.tumble.0"), "tumble's table", "three planes"),
    (SERVO, [PLANE], {"table_zero": 1e-5}, ("m_j", "table_zero"), "common zero", "three planes"),
    (SERVO, [TUMBLE, ARM], {"fixture_common": 1e-4}, ("m_j", "fixture_common_k"), FIXTURE, "turned over"),
    (SERVO, [TUMBLE, ARM], {"fixture_common": 1e-4}, ("m_k", "fixture_common_j"), FIXTURE, "turned over"),
    (FOG, [TABLE], {"fixture_common": 1e-4}, ("m_j", "fixture_common_k"), FIXTURE, "turned over"),
    (FOG, [TABLE], {}, ("b0", "S_ii", "S_jj", "S_kk"), "|f| = g in every row", "more than 1 g"),
    (FOG, [TABLE], {"rate_scale": 5e-6}, ("b1", "rate_scale.rate-table"), "scale error", "whole turns"),
    (FOG, [SWING], {"latency": 1e-3}, ("s_i", "latency"), "latency", "one clock for rig and sensor"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("class_id", "plans", "kinds", "terms", "reason", "remedy"),
    HIDDEN,
    ids=lambda v: getattr(v, "name", None),
)
def test_what_an_error_of_the_bench_hides_is_told_with_a_remedy(
    class_id, plans, kinds, terms, reason, remedy
):
    seen, _ = observed(class_id, plans, kinds, set="extended" if class_id == FOG else "slide")
    (group,) = [group for group in seen.groups if set(group.terms) == set(terms)]
    assert group.exact and group.seen == pytest.approx(1.0, abs=1e-6)
    assert reason in group.reason and remedy in group.remedy
    assert group.remedy.endswith("would separate them")
    assert set(terms) <= {terms[0], *seen.partners(terms[0])}


def test_every_kind_of_error_has_a_case_here():
    told = {kind for _, _, kinds, *_ in HIDDEN for kind in kinds}
    assert told == KINDS.keys() - {"fixture", "earth_rate"}  # which a turntable shows


def test_a_rotation_in_each_mount_is_told_with_each_term_that_it_hides():
    seen, _ = observed(SERVO, [TUMBLE, ARM], {"fixture": 1e-4})
    for term, axis in (("m_j", "k"), ("m_k", "j")):
        (group,) = [group for group in seen.groups if term in group.terms and group.exact]
        others = [name for name in group.terms if name != term]
        # every mount in which the axis across is ever excited takes part
        assert all(name.startswith(f"fixture_{axis}.") for name in others)
        assert len(others) > 10
        # and what hides two terms does not make them partners
        assert seen.partners(term) == tuple(name for name in seen.names if name in others)


def test_gravity_is_told_from_the_scale_factor_by_a_centrifuge():
    seen, _ = observed(SERVO, [TUMBLE, ARM], {"gravity": 1e-2})
    assert "gravity" not in seen.partners("b1")
