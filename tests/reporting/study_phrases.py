"""Numbers of a report on sensors that are part of its words, or that its result does not have."""

from __future__ import annotations

from report_reading import fixed

NUM = r"[-−]?(?:\d{1,3}(?:,\d{3})+|\d+)(?:\.\d+)?(?:e[-+]?\d+)?"
TERM = r"[A-Za-z]\w*(?:\*\w+)*(?:/\w+)*"
SHARE = rf"{NUM} ?%"
P = rf"(<? ?{NUM})"

SAID = fixed(
    r"chance alone makes (1) % of studies",
    r"(?:stays below|would find) with (95) %",
    r"holding (90) %|[Rr]anges hold (90) %|holds half of the draws, grey (90) %",
    r"deviation, (0\.664) B",
    r"In the symbols of .*?(\d+)",
    r"their rms over blocks of samples is (1)",
    r"(?:±|within) (2) sd",
    r"below (2) it says little",
    r"(95) % of white noise",
    r"short of (90) deg",
    r"(?:inclusion \(|crosses )(0\.05), (0\.5) or (0\.95)",
    r"“best (3)”",
    r"is √(2) N",
    r"^(1)/(\d)$",
    r"^(1) strength$",
    r"^best (\d+)$",
    r"^(1e[-−]\d+)$",
    r"by more than (5) %",
    r"says something below (0\.01)",
    r"more than (1) g",
    r"right to about (0\.02) sd",
    rf"below a tenth of the class's size with ({NUM}) %",
    r"(?:section|mount|plane|fixture) (\d+)",
)
"""Numbers that are part of how a report is to be read."""

UNHELD = fixed(
    rf"computed for the ({NUM}) subsets that AIC likes best; .*? right to ({NUM}) there",
    rf"noise floor of ({NUM}) ",
    rf"within ±({NUM})$",
    rf"Allan deviation within a factor ({NUM}) of",
    rf"correlation ({NUM})",
    r"^Strongest posterior correlations: (.+)$",
    rf"^prior sd ({NUM})× wider",
    rf"({NUM}) times narrower than its prior",
    rf"do in this test, ({NUM}) \S+ rms",
    rf"least squares over the ({NUM}) samples of [^:]*?(?:from ({NUM}) to ({NUM}) \S+)?:"
    rf" ({NUM})(?: ×(10)\S+)? \S+ rms are left",
    rf"Lowest ({NUM}) \S+ at ({NUM}) s; ({SHARE}) of the fitted curve within the (90) %",
    rf"lowest ({NUM}) \S+ at ({NUM}) s",
    rf"means (?:of the ensembles|are) within ({NUM}) sd",
    rf"misalignments against the case to ({NUM}) ",
    rf"averages within the dwells: ({NUM}) \(by importance sampling",
    r"k is above (0\.7) at (\d+) of (\d+) dwells",
    r"^Posterior under the full library, each against each: (.+)$",
    r"they differ on (\d+) others",
    r"hyper-g prior differs on (\d+) terms",
)
"""Sizes read off the runs, the draws or the fit for a figure or a note: the result does not have them."""
