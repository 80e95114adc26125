"""The enumeration against dense evidence and quadrature, against published numbers, and its invariances."""

from __future__ import annotations

import math

import numpy as np
import pytest
from decisions import records, table
from scipy.integrate import quad_vec
from scipy.linalg import null_space
from scipy.special import logsumexp

from imubayes.errors import InputError, TermError, UnobservableError
from imubayes.inference.prior import GPrior, HyperG, ScalePrior, ZellnerSiow
from imubayes.inference.summary import Summary
from imubayes.selection import lanes
from imubayes.selection.enumerate import CURVES, enumerate_models
from imubayes.selection.evidence import NOTHING, Sums
from imubayes.selection.mixture import candidates
from imubayes.selection.models import components_given, inclusion_given

NAMES = ("a", "b", "c", "d", "e", "f")


def _problem(n: int = 12, p: int = 4, seed: int = 5) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Columns, a response with two weak terms in it, and prior sds."""
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(n, p)) @ (np.eye(p) + 0.4)
    y = 0.5 + X[:, :2] @ [0.9, -0.5] + 0.7 * rng.normal(size=n)
    return X, y, rng.uniform(0.3, 3.0, p)


def _columns(mask: int, p: int) -> list[int]:
    return [j for j in range(p) if mask >> j & 1]


def _dense(X, y, sd, included, scale, more=0) -> float:
    """Log p(y | model, sigma) as a density of a multivariate normal along its principal axes.

    So many `more` rows of zeros are what a rotation makes of rows beyond the columns and the response.
    """
    axes, spread, _ = np.linalg.svd(X[:, included] * sd[included])
    variance = scale**2 + np.pad(spread**2, (0, len(y) - len(spread)))
    zeros = more * math.log(2.0 * math.pi * scale**2)
    return float(-0.5 * (np.sum(np.log(2.0 * math.pi * variance) + (axes.T @ y) ** 2 / variance) + zeros))


def _moments(X, y, sd, included, scale) -> tuple[np.ndarray, np.ndarray]:
    """Mean and variance of all coefficients under a model and a noise scale; zero where a column is out."""
    mean, variance = np.zeros((2, X.shape[1]))
    cov = np.linalg.inv(X[:, included].T @ X[:, included] / scale**2 + np.diag(sd[included] ** -2.0))
    mean[included], variance[included] = cov @ X[:, included].T @ y / scale**2, np.diag(cov)
    return mean, variance


def _integrated(X, y, sd, included, more, peak) -> np.ndarray:
    """Evidence, and evidence times first and second moments, over exp(peak), by quadrature over ln sigma."""

    def integrand(log_scale):
        density = math.exp(_dense(X, y, sd, included, math.exp(log_scale), more) - peak)
        mean, variance = _moments(X, y, sd, included, math.exp(log_scale))
        return density * np.concatenate(([1.0], mean, variance + mean**2))

    start, reach = math.log(np.std(y)), 9.0
    if more:
        start, reach = math.log(abs(y[-1]) / math.sqrt(more)), 20.0 / math.sqrt(2.0 * more)
    least = 1e-30 if more else 0.0  # what has none is below what a number holds
    return quad_vec(integrand, start - reach, start + reach, epsabs=least, epsrel=1e-11, norm="max")[0]


def _by_quadrature(X, y, sd, weight, always=(), more=0) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """Log evidence, inclusion, mean, sd over the models; `weight` is the prior probability by size."""
    p = X.shape[1]
    free = [j for j in range(p) if j not in always]
    total, inside = np.zeros(1 + 2 * p), np.zeros(p)
    peak = _dense(X, y, sd, list(range(p)), abs(y[-1]) / math.sqrt(more), more) if more else 0.0
    for mask in range(1 << len(free)):
        included = sorted([*always, *(free[j] for j in _columns(mask, len(free)))])
        part = weight[len(included) - len(always)] * _integrated(X, y, sd, included, more, peak)
        total += part
        inside[included] += part[0]
    mean, square = total[1 : 1 + p] / total[0], total[1 + p :] / total[0]
    return peak + math.log(total[0]), inside / total[0], mean, np.sqrt(square - mean**2)


def _weights(model_prior, p: int) -> np.ndarray:
    k = np.arange(p + 1)
    if model_prior == "beta-binomial":
        return 1.0 / ((p + 1) * np.array([math.comb(p, i) for i in k]))
    share = 0.5 if model_prior == "uniform" else model_prior
    return share**k * (1.0 - share) ** (p - k)


@pytest.mark.parametrize(
    ("model_prior", "always"), [("beta-binomial", ()), ("uniform", ()), (0.15, ()), ("beta-binomial", (1,))]
)
def test_enumeration_is_dense_evidence_integrated_over_the_noise_scale(model_prior, always):
    X, y, sd = _problem()
    named = [NAMES[j] for j in always]
    found = enumerate_models(Summary.from_arrays(X, y, NAMES[:4]), ScalePrior(sd), model_prior, always=named)
    weight = _weights(model_prior, 4 - len(always))
    log_evidence, inclusion, mean, spread = _by_quadrature(X, y, sd, weight, always)
    assert found.n_models == 1 << (4 - len(always))
    assert found.log_evidence == pytest.approx(log_evidence, abs=1e-7)
    np.testing.assert_allclose(found.inclusion, inclusion, rtol=1e-7)
    np.testing.assert_allclose(found.mean, mean, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(found.sd, spread, rtol=1e-7)


@pytest.mark.parametrize(("n", "nodes"), [(160, 18), (500, 10), (3000, 8)])
def test_a_rule_over_the_noise_scale_does_what_quadrature_does(n, nodes):
    X, y, sd = _problem(n)
    found = enumerate_models(Summary.from_arrays(X, y, NAMES[:4]), ScalePrior(sd))
    R = np.linalg.qr(np.column_stack((X, y)), mode="r")
    weight = _weights("beta-binomial", 4)
    log_evidence, inclusion, mean, spread = _by_quadrature(R[:, :4], R[:, 4], sd, weight, more=n - 5)
    assert len(found.scales.at) == nodes
    assert found.log_evidence == pytest.approx(log_evidence, abs=found.quadrature)
    np.testing.assert_allclose(found.inclusion, inclusion, rtol=1e-7)
    np.testing.assert_allclose(found.mean, mean, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(found.sd, spread, rtol=1e-7)


def test_with_many_candidates_a_rule_of_three_nodes_misses_no_more_than_it_says(monkeypatch):
    X, y, sd = _problem(900, 6)
    fine = enumerate_models(Summary.from_arrays(X, y, NAMES), ScalePrior(sd))
    monkeypatch.setattr("imubayes.selection.enumerate.FINE_STEPS", 5)
    rough = enumerate_models(Summary.from_arrays(X, y, NAMES), ScalePrior(sd))
    assert len(rough.scales.at) == 3 and rough.quadrature == 2.5e-3
    assert rough.log_evidence == pytest.approx(fine.log_evidence, abs=5e-4)
    np.testing.assert_allclose(rough.inclusion, fine.inclusion, rtol=1e-3)


@pytest.mark.parametrize(("n", "signal"), [(110, 3.0), (220, 2.0), (500, 3.0)])
def test_models_that_differ_in_their_noise_are_summed_as_well_as_it_says(n, signal, monkeypatch):
    """With many weak terms the peaks of models lie apart, which a rule for one peak must see."""
    module = "imubayes.selection.enumerate"
    for seed in range(8):
        rng = np.random.default_rng(seed)
        X = rng.normal(size=(n, 14))
        y = X @ np.full(14, signal / math.sqrt(n)) + rng.normal(size=n)
        summary = Summary.from_arrays(X, y, [f"x{j}" for j in range(14)])
        with monkeypatch.context() as finer:
            finer.setattr(f"{module}._gauss_rule", lambda *_: None)
            finer.setattr(f"{module}.FEW", 100.0)
            truth = enumerate_models(summary, ScalePrior(1.0), "uniform").log_evidence
        for fine_steps in (22, 5):
            with monkeypatch.context() as usual:
                usual.setattr(f"{module}.FINE_STEPS", fine_steps)
                found = enumerate_models(summary, ScalePrior(1.0), "uniform")
            assert found.log_evidence == pytest.approx(truth, abs=found.quadrature)


@pytest.mark.parametrize(("n", "beside"), [(3, 0), (5, 0), (12, 0), (12, 9), (5, 9)])
def test_every_model_has_its_dense_evidence_summed_over_the_noise_scales(n, beside):
    """Also with fewer rows than columns, or than those always in, where priors make the evidence finite."""
    X, y, sd = _problem(n, 4 + beside)
    names = (*NAMES[:4], *(f"beside {k}" for k in range(beside)))
    found = enumerate_models(Summary.from_arrays(X, y, names), ScalePrior(sd), "uniform", always=names[4:])
    step, always = math.log(found.scales.at[1] / found.scales.at[0]), [*range(4, 4 + beside)]
    assert len(found.weight) == 16 and found.scales.at[-1] > 0.3
    for mask in range(16):
        inside = [*_columns(mask, 4), *always]
        logs = [_dense(X, y, sd, inside, at) + math.log(step / 16.0) for at in found.scales.at]
        joint = math.log(found.weight[mask]) + found.log_evidence
        assert joint == pytest.approx(logsumexp(logs), abs=1e-9)


@pytest.mark.parametrize("by_products", [True, False])
def test_a_scale_counts_by_what_all_models_have_there_together(by_products, monkeypatch):
    X, y, sd = _problem()
    f, by_size = Summary.from_arrays(X, y, NAMES[:4]).factor, np.log(_weights("beta-binomial", 4))
    if not by_products:
        monkeypatch.setattr(lanes, "storable", lambda *_: False)
    c = candidates(f, NAMES[:4], (), sd)
    found = Sums(c, by_size, (), np.zeros(16)).add(math.ldexp(0.8, -c.response_unit))
    each = [by_size[m.bit_count()] + _dense(X, y, sd, _columns(m, 4), 0.8) for m in range(16)]
    assert found == pytest.approx(logsumexp(each), abs=1e-9)


@pytest.mark.parametrize("scale", [0.02, 1e6])
def test_a_scale_that_is_nothing_beside_others_is_bounded_and_left_out(scale):
    X, y, sd = _problem()
    c = candidates(Summary.from_arrays(X, y, NAMES[:4]).factor, NAMES[:4], (), sd)
    by_size = np.log(_weights("beta-binomial", 4))
    sums = Sums(c, by_size, (), np.zeros(16))
    high = sums.add(math.ldexp(0.8, -c.response_unit))
    before = sums.weight.copy()
    bound = sums.add(math.ldexp(scale, -c.response_unit))
    true = logsumexp([by_size[m.bit_count()] + _dense(X, y, sd, _columns(m, 4), scale) for m in range(16)])
    assert true <= bound < high - NOTHING
    assert np.array_equal(sums.weight, before)


def test_forced_columns_are_projected_out():
    """Evidence under a flat prior: that of the rows' part beside the forced columns, over sqrt(det X0'X0)."""
    X, y, sd = _problem()
    beside = null_space(X[:, [0]].T)
    found = enumerate_models(Summary.from_arrays(X, y, NAMES[:4]), ScalePrior(sd[1:]), forced=["a"])
    log_evidence, inclusion, mean, spread = _by_quadrature(
        beside.T @ X[:, 1:], beside.T @ y, sd[1:], _weights("beta-binomial", 3)
    )
    own = 0.5 * math.log(X[:, 0] @ X[:, 0])
    assert found.log_evidence == pytest.approx(log_evidence - own, abs=1e-7)
    np.testing.assert_allclose(found.inclusion, [1.0, *inclusion], rtol=1e-7)
    np.testing.assert_allclose(found.mean[1:], mean, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(found.sd[1:], spread, rtol=1e-7)


@pytest.mark.parametrize("name", ["attitude", "hald"])
@pytest.mark.parametrize("prior", ["UIP", "BRIC", "hyper3"])
@pytest.mark.parametrize("model", ["uniform", "random"])
def test_inclusion_and_moments_are_those_of_bms_and_bas(references, name, prior, model):
    """R 4.2.2: BMS 0.3.5, and BAS 1.7.5 for hyper-g; all models, g- and model prior as published there."""
    published = records(references / f"bms/coef_{name}_{prior}_{model}.csv")
    header, X, y = table(references / f"bms/{name}.csv")
    n, p = X.shape
    g = {"UIP": GPrior(n), "BRIC": GPrior(max(n, p**2)), "hyper3": HyperG(3.0)}[prior]
    s = Summary.from_arrays(np.column_stack((np.ones(n), X)), y, ["1", *header])
    found = enumerate_models(s, g, {"uniform": "uniform", "random": "beta-binomial"}[model], forced=["1"])
    assert len(published) == p
    for row in published:
        at = s.names.index(row["variable"])
        assert found.inclusion[at] == pytest.approx(float(row["PIP"]), abs=1e-9)
        assert found.mean[at] == pytest.approx(float(row["PostMean"]), abs=1e-9)
        if prior != "hyper3":
            assert found.sd[at] == pytest.approx(float(row["PostSD"]), rel=1e-9)


PRIORS = [ScalePrior(0.7), GPrior(12.0), HyperG(3.0), ZellnerSiow(1.0)]
PRIOR_NAMES = [type(prior).__name__ for prior in PRIORS]


@pytest.mark.parametrize("p", [4, 14])
@pytest.mark.parametrize("prior", [ScalePrior(1.0), HyperG()], ids=["scale", "hyper-g"])
def test_inclusion_is_the_same_without_coefficients(prior, p):
    X, y, _ = _problem(n=40, p=p)
    names = tuple(f"x{j}" for j in range(p))
    always = () if isinstance(prior, HyperG) else names[:1]
    summary = Summary.from_arrays(X, y, names)
    whole = enumerate_models(summary, prior, always=always)
    some = enumerate_models(summary, prior, always=always, coefficients=False)
    np.testing.assert_array_equal(some.inclusion, whole.inclusion)
    assert some.log_evidence == whole.log_evidence
    if isinstance(prior, ScalePrior) or p > CURVES:
        assert np.isnan(some.mean).all()
        assert np.isnan(some.sd).all()


def test_a_column_that_was_never_excited_keeps_its_prior():
    X, y, sd = _problem()
    X[:, 2] = 0.0
    found = enumerate_models(Summary.from_arrays(X, y, NAMES[:4]), ScalePrior(sd), 0.2)
    assert found.inclusion[2] == pytest.approx(0.2, rel=1e-10)
    assert found.mean[2] == pytest.approx(0.0, abs=1e-12)
    assert found.sd[2] == pytest.approx(math.sqrt(0.2) * sd[2], rel=1e-10)
    without = enumerate_models(
        Summary.from_arrays(X[:, [0, 1, 3]], y, ("a", "b", "d")), ScalePrior(sd[[0, 1, 3]]), 0.2
    )
    assert found.log_evidence == pytest.approx(without.log_evidence, abs=1e-7)


@pytest.mark.parametrize("prior", PRIORS, ids=PRIOR_NAMES)
def test_an_exact_fit_includes_what_is_in_it_and_nothing_else(prior):
    """Rounding is no signal. A fixed g shrinks by g/(1 + g), and leaves a term that says nothing open."""
    X, _, _ = _problem(n=20)
    found = enumerate_models(Summary.from_arrays(X, X[:, :2] @ [0.5, -0.25], NAMES[:4]), prior)
    shrunk, most = (prior.g / (1.0 + prior.g), 0.5) if isinstance(prior, GPrior) else (1.0, 1e-3)
    np.testing.assert_allclose(found.inclusion[:2], 1.0, atol=1e-3)
    assert found.inclusion[2:].max() < most
    np.testing.assert_allclose(found.mean, shrunk * np.array([0.5, -0.25, 0.0, 0.0]), atol=1e-4 * most)


@pytest.mark.parametrize("prior", PRIORS[1:], ids=PRIOR_NAMES[1:])
@pytest.mark.parametrize("rows", [1, 2])
def test_of_one_or_two_rows_a_g_prior_knows_no_finite_sd(prior, rows):
    X, y, _ = _problem()
    found = enumerate_models(Summary.from_arrays(X[:rows, :1], y[:rows], NAMES[:1]), prior)
    assert math.isinf(found.sd[0]) and math.isfinite(found.mean[0])
    assert 0.0 < found.inclusion[0] < 1.0


def test_models_of_one_size_sum_to_its_share_and_the_best_are_in_order():
    X, y, sd = _problem(n=30, p=6)
    found = enumerate_models(Summary.from_arrays(X, y, NAMES), ScalePrior(sd))
    probability, joint = found.weight, np.log(found.weight) + found.log_evidence
    for k, log_share in enumerate(found.by_size):
        masks = [mask for mask in range(64) if mask.bit_count() == k]
        assert log_share == pytest.approx(logsumexp(joint[masks]), abs=1e-10)
    top = np.argsort(-probability)[:10]
    expected = [tuple(NAMES[j] for j in _columns(int(mask), 6)) for mask in top]
    assert [names for names, _ in found.best] == expected
    np.testing.assert_allclose([share for _, share in found.best], probability[top], rtol=1e-10)


@pytest.mark.parametrize("required", [(), ("b",), ("c", "d")])
def test_inclusion_given_terms_is_that_of_the_models_with_them(required):
    X, y, sd = _problem()
    found = enumerate_models(Summary.from_arrays(X, y, NAMES[:4]), ScalePrior(sd))
    probability = found.weight
    inside = np.array([[mask >> j & 1 for j in range(4)] for mask in range(16)], dtype=bool)
    allowed = inside[:, [NAMES.index(name) for name in required]].all(axis=1)
    expected = probability[allowed] @ inside[allowed] / probability[allowed].sum()
    np.testing.assert_allclose(inclusion_given(found, required), expected, rtol=1e-10)
    parts = components_given(found, required)
    assert np.all(parts.inside[:, [NAMES.index(name) for name in required]])
    np.testing.assert_allclose(parts.weight @ (parts.sd > 0.0), expected, atol=1e-9)


def test_with_everything_forced_one_model_is_left_with_its_least_squares():
    X, y, _ = _problem(p=2)
    s = Summary.from_arrays(X, y, NAMES[:2])
    found, fit = enumerate_models(s, ScalePrior(1.0), forced=NAMES[:2]), s.least_squares()
    assert (found.n_models, found.inclusion.tolist()) == (1, [1.0, 1.0])
    np.testing.assert_allclose(found.mean, fit.mean, rtol=1e-9)
    # the marginal posterior is Student's t with n - 2 degrees of freedom
    np.testing.assert_allclose(found.sd, fit.sd * math.sqrt(fit.dof / (fit.dof - 2)), rtol=1e-7)


REFUSED = {
    "'x0' is there twice, expected each term once": (TermError, [
        {"always": ["x0", "x0"]}, {"forced": ["x0", "x0"]}, {"forced": ["x0"], "always": ["x0"]}
    ]),
    "expected the sd of the noise, positive and finite": (
        InputError, [{"scale": scale} for scale in (0.0, -1.0, math.nan, math.inf)]
    ),
    "in the units of the response, whose norm": (InputError, [{"scale": scale} for scale in (1e-320, 1e200)]),
    "scale_limit = .*: expected more than 1": (
        InputError, [{"scale_limit": limit} for limit in (-1.0, 0.0, 0.5, 1.0, math.nan)]
    ),
    "x0 needs x1 needs x0: expected an end": (TermError, [{"needs": [("x0", "x1"), ("x1", "x0")]}]),
    "x0 needs x0: expected an end": (TermError, [{"needs": [("x0", "x0")]}]),
    "'x0' has two parents, expected one": (TermError, [{"needs": [("x0", "x1"), ("x0", "x2")]}]),
    "term 'x' is not in the summary": (TermError, [{"forced": ["x"]}]),
    "2 sds for 27 terms": (TermError, [{"sd": [1.0, 2.0]}]),
    "or a probability between": (TermError, [{"model_prior": 0.0}, {"model_prior": 1.5}]),
}  # fmt: skip
"""What is said, and the options of which it is said."""


@pytest.mark.parametrize("message", REFUSED)
def test_what_cannot_be_enumerated_is_refused_before_any_work(message):
    X = np.random.default_rng(0).normal(size=(60, 27))
    s = Summary.from_arrays(X, X[:, 0], [f"x{j}" for j in range(27)])
    error, every = REFUSED[message]
    for options in every:
        with pytest.raises(error, match=message):
            enumerate_models(s, ScalePrior(options.pop("sd", 1.0)), **options)


def test_a_need_that_is_told_twice_counts_once():
    s = Summary.from_arrays(*_problem()[:2], NAMES[:4])
    once, twice = (enumerate_models(s, ScalePrior(1.0), needs=[("b", "a")] * times) for times in (1, 2))
    assert once.log_evidence == twice.log_evidence


@pytest.mark.parametrize("prior", PRIORS, ids=PRIOR_NAMES)
@pytest.mark.parametrize("copy", [0.0, 1.0])
def test_forced_columns_that_depend_on_each_other_are_refused(prior, copy):
    X, y, _ = _problem()
    X[:, 1] = copy * X[:, 0]
    with pytest.raises(UnobservableError, match="expected independent columns, but b is zero or") as caught:
        enumerate_models(Summary.from_arrays(X, y, NAMES[:4]), prior, forced=["a", "b"])
    assert caught.value.terms == ("b",)


def test_forced_columns_that_explain_every_row_are_refused():
    X, y, _ = _problem()
    with pytest.raises(UnobservableError, match="2 rows for 2 forced columns leave nothing"):
        enumerate_models(Summary.from_arrays(X[:2], y[:2], NAMES[:4]), ScalePrior(1.0), forced=["a", "b"])
    for explained in (0.0, 0.3):  # of which rounding leaves something
        whole = Summary.from_arrays(X, explained * X[:, 0], NAMES[:4])
        with pytest.raises(UnobservableError, match="fit the response exactly"):
            enumerate_models(whole, HyperG(3.0), forced=["a"], scale=1.0)


@pytest.mark.parametrize("prior", PRIORS[1:], ids=PRIOR_NAMES[1:])
def test_the_g_family_names_a_column_that_depends_on_others(prior):
    X, y, _ = _problem()
    X[:, 3] = X[:, 0] + X[:, 1]
    with pytest.raises(UnobservableError, match="d depends on others") as caught:
        enumerate_models(Summary.from_arrays(X, y, NAMES[:4]), prior)
    assert caught.value.terms == ("d",)
