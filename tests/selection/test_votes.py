"""Methods beside the decision, and why they differ: cases that were made to have one cause."""

import math

import numpy as np
import pytest

import imubayes as ib
from imubayes.selection.causes import line_of
from imubayes.selection.criteria import Criterion
from imubayes.selection.decision import select
from imubayes.selection.panel import votes
from imubayes.selection.sensitivity import sensitivity
from imubayes.selection.sindy import Sparse
from imubayes.selection.verdicts import Costs

LIB = ib.library("accelerometer", powers=3, asymmetry=0)
N = 2000


def orthogonal(pulls, *, seed=1, extra=0.0):
    """Columns (N, p) at right angles of norm sqrt(N), and a response that puts each term at `pulls` sd.

    With `extra`, the second column leans towards the first by that cosine.
    """
    rng, p = np.random.default_rng(seed), len(pulls)
    Q = np.linalg.qr(rng.normal(size=(N, p + 1)))[0]
    noise = math.sqrt(N - p) * Q[:, p]
    y = Q[:, :p] @ np.asarray(pulls, dtype=float) + noise
    X = math.sqrt(N) * Q[:, :p]
    if extra:
        X[:, 1] = extra * X[:, 0] + math.sqrt(1.0 - extra**2) * X[:, 1]
    return X, y


def decided(X, y, widths, costs=None):
    """Selection and sensitivity of a few columns, with priors `widths` times as wide as 1/sqrt(N)."""
    whole = np.zeros((len(y), len(LIB.names)))
    whole[:, : X.shape[1]] = X
    sd = np.full(len(LIB.names), 1.0)
    sd[: X.shape[1]] = np.broadcast_to(widths, X.shape[1]) / math.sqrt(N)
    summary = ib.Summary.from_arrays(whole, y, LIB.names)
    selection = select(summary, ib.ScalePrior(sd), LIB, costs=costs or Costs())
    names = selection.models.candidates.names
    factor = ib.Summary.from_arrays(X, y, names).factor
    return selection, sensitivity(factor, sd[: X.shape[1]], names, costs=selection.costs)


def criterion(name, keeps, selection, samples=N):
    told = {column: float(column in keeps) for column in selection.models.candidates.names}
    return Criterion(name, tuple(keeps), 0.0, 1.0, told, 2, True, samples, math.nan)


def sparse(name, keeps, selection):
    names = selection.models.candidates.names
    told = {column: 0.8 if column in keeps else 0.1 for column in names}
    nothing = np.zeros((1, len(names)))
    return Sparse(name, names, tuple(keeps), told, np.ones(1), nothing, np.zeros(1), 0, (), 0.75, 0.0)


def reasons(told):
    """Cause and text by term and method."""
    return {(d.term, method): (d.cause, d.text) for d in told.disagreements for method in d.methods}


def told_of(case, keeps, *, samples=N, regression=None, coloured=()):
    """Why criteria that keep some terms, and a regression that does, differ from a case's decision."""
    selection, widths = case
    criteria = [criterion(name, kept, selection, samples) for name, kept in keeps.items()]
    sparsely = [] if regression is None else [sparse("stlsq", regression, selection)]
    return reasons(votes(selection, criteria, sparsely, widths, coloured=coloured))


def test_every_method_has_its_row_and_every_tested_term_its_column():
    X, y = orthogonal([20.0, 0.0, 10.0])
    selection, widths = decided(X, y, 100.0)
    names = selection.models.candidates.names
    told = votes(
        selection,
        [criterion("aic", names, selection), criterion("bic", names[:1], selection)],
        [sparse("stlsq", names[2:], selection)],
        widths,
    )
    assert told.methods == ("evidence", "g-prior", "aic", "bic", "stlsq")
    assert told.terms == names == tuple(t.name for t in selection.terms if t.verdict != "untested")
    inclusion = [t.inclusion for t in selection.terms if t.verdict != "untested"]
    expected = [inclusion, widths.g_prior, [1, 1, 1], [1, 0, 0], [0.1, 0.1, 0.8]]
    np.testing.assert_allclose(told.strength, expected)
    np.testing.assert_array_equal(told.keeps, [[1, 0, 1], [1, 0, 1], [1, 1, 1], [1, 0, 0], [0, 0, 1]])
    assert set(reasons(told)) == {(names[1], "aic"), (names[2], "bic"), (names[0], "stlsq")}


def test_of_terms_that_only_appear_together_methods_take_one_by_collinearity():
    X, y = orthogonal([20.0, 0.0])
    case = selection, widths = decided(np.column_stack((X, X[:, 0])), y, 100.0)
    first, _, last = selection.models.candidates.names
    assert selection.terms[0].verdict == selection.terms[2].verdict == "inseparable"
    cause, text = told_of(case, {"bic": (last,)})[last, "bic"]
    assert cause == "collinearity"
    assert f"together with {first}" in text
    # the g-prior cannot have the second of them: it has no vote on it
    told = votes(selection, [], [], widths)
    assert math.isnan(told.strength[1, 2]) and math.isnan(told.keeps[1, 2])
    assert not any(d.methods == ("g-prior",) and d.term == last for d in told.disagreements)


def test_a_term_taken_for_one_that_looks_like_it_is_collinearity_with_the_numbers():
    case = selection, _ = decided(*orthogonal([40.0, 0.0, 15.0], extra=0.95), 300.0)
    first, second, third = selection.models.candidates.names
    assert selection.terms[0].verdict == "needed"
    assert selection.terms[1].inclusion < 0.5
    told = told_of(case, {"bic": (second, third)})
    assert told[first, "bic"][0] == told[second, "bic"][0] == "collinearity"
    assert f"{second} is taken in its place" in told[first, "bic"][1]
    assert f"{first} is left out in its place" in told[second, "bic"][1]
    # the estimates of two columns at cosine c are correlated at -c, and inflated by 1/(1 - c^2)
    assert "correlated at 0.95 (variance inflation 10)" in told[first, "bic"][1]


def test_where_the_prior_width_decides_it_is_the_cause():
    """At odds of 2, t^2/2 = ln(prior sd over posterior sd) - ln 2: t = 2.3 for a width of 30, 1.8 for 10."""
    case = selection, widths = decided(*orthogonal([20.0, 2.4]), 30.0)
    name = selection.models.candidates.names[1]
    assert name in widths.swing
    other = () if selection.terms[1].inclusion >= 0.5 else (name,)
    cause, text = told_of(case, {"bic": other})[name, "bic"]
    assert cause == "prior width"
    usual = widths.inclusion[2:-2, 1]
    assert f"from {usual.min():.2f} to {usual.max():.2f}" in text


def test_a_penalty_that_draws_another_line_is_sample_size_with_both_lines():
    """BIC's line is sqrt(ln 2000) = 2.8, AIC's 1.4; that of the evidence is 4 for a width of 3000."""
    case = selection, widths = decided(*orthogonal([20.0, 3.1, 1.7]), 3000.0)
    _, near, far = selection.models.candidates.names
    assert np.all(widths.inclusion[2:-2, 1:] < 0.5)
    found = told_of(case, {"aic": (near, far), "bic": (near,)}, regression=(far,))
    assert found[near, "aic"][0] == found[near, "bic"][0] == found[far, "aic"][0] == "sample size"
    text = found[near, "bic"][1]
    assert "it is 3.1 sd from zero" in text
    assert "aic 1.4 and bic 2.8 (2,000 effective samples)" in text
    assert "3e+03 times as wide" in text
    assert found[far, "stlsq"][0] == "weak effect"
    assert "it is 1.7 sd from zero" in found[far, "stlsq"][1]


def test_a_term_that_is_only_expected_from_the_others_is_kept_by_the_model_prior():
    case = selection, widths = decided(*orthogonal([20.0, 30.0, 15.0, 25.0, 0.5]), [100.0] * 4 + [0.8])
    names = selection.models.candidates.names
    assert selection.terms[4].verdict == "undecided"
    assert np.all(widths.inclusion[2:-2, 4] > 0.5)
    cause, text = told_of(case, {"waic": names[:4]})[names[4], "waic"]
    assert cause == "model prior"
    assert "4 of 4 other terms" in text


def test_dwells_that_do_not_bear_out_a_strong_effect_show_coloured_noise_taken_for_white():
    case = selection, _ = decided(*orthogonal([20.0, 8.0]), 100.0)
    kept, dropped = selection.models.candidates.names
    keeps = {"loo": (kept,), "bic": (kept,)}
    found = told_of(case, keeps, samples=math.nan, coloured=("tumble",))
    assert found[dropped, "loo"][0] == "coloured noise"
    assert "the noise of tumble was taken as white and is not" in found[dropped, "loo"][1]
    # a criterion takes the noise for what the evidence takes it for
    assert found[dropped, "bic"][0] == "method"
    assert told_of(case, keeps, samples=math.nan)[dropped, "loo"][0] == "method"


def test_an_unresolved_term_that_a_method_keeps_is_told_with_what_the_data_leave_of_the_prior():
    case = selection, _ = decided(*orthogonal([20.0, 1.5]), [100.0, 0.3])
    name = selection.models.candidates.names[1]
    assert selection.terms[1].verdict == "unresolved"
    cause, text = told_of(case, {"aic": (name,)})[name, "aic"]
    assert cause == "weak effect"
    # posterior sd over prior sd is 1/sqrt(1 + 0.3^2) = 0.958
    assert "the data leave 96 % of the prior's sd" in text and "1.5 sd from zero" in text


@pytest.mark.parametrize(
    ("name", "deviance"),
    [
        ("aic", lambda n, k: 2.0 * k),
        ("aicc", lambda n, k: 2.0 * k * n / (n - k - 1.0)),
        ("bic", lambda n, k: k * math.log(n)),
        ("hqc", lambda n, k: 2.0 * k * math.log(math.log(n))),
        ("ebic", lambda n, k: k * math.log(n) + 2.0 * math.log(math.comb(12, k - 1))),
    ],
)
def test_the_line_of_a_criterion_is_the_root_of_what_one_more_term_costs(name, deviance):
    """Parameters are the terms and the noise scale."""
    n, kept, p = 150.0, 5, 12
    c = Criterion(name, (), 0.0, 0.0, {}, 1, True, n, math.nan)
    assert line_of(c, kept, p) ** 2 == pytest.approx(deviance(n, kept + 2) - deviance(n, kept + 1), rel=1e-9)
