"""Numbers of a report on sensors that are part of its words, or that its result does not have."""

from __future__ import annotations

from report_reading import fixed

NUM = r"[-−]?(?:\d{1,3}(?:,\d{3})+|\d+)(?:\.\d+)?(?:e[-+]?\d+)?"
TERM = r"[A-Za-z]\w*(?:\*\w+)*(?:/\w+)*"
SHARE = rf"{NUM} ?%"
P = rf"(<? ?{NUM})"

SAID = (
    fixed(r"chance alone makes (1) % of studies"),
    fixed(r"stays below with (95) %"),
    fixed(r"would find with (95) %"),
    fixed(r"holding (90) %"),
    fixed(r"[Rr]anges hold (90) %"),
    fixed(r"holds half of the draws, grey (90) %"),
    fixed(r"deviation, (0\.664) B"),
    fixed(r"In the symbols of .*?(\d+)"),
    fixed(r"all parameters with K1 > (0)"),
    fixed(r"their rms over blocks of samples is (1)"),
    fixed(r"± (2) sd"),
    fixed(r"within (2) sd"),
    fixed(r"below (2) it says little"),
    fixed(r"(95) % of white noise"),
    fixed(r"short of (90) deg"),
    fixed(r"inclusion \((0\.05), (0\.5) or (0\.95)\)"),
    fixed(r"crosses (0\.05), (0\.5) or (0\.95)"),
    fixed(r"“best (3)”"),
    fixed(r"is √(2) N"),
    fixed(r"^(1)/(\d)$"),
    fixed(r"K1/K1nom [-−] (1)"),
    fixed(r"^(1) strength$"),
    fixed(r"^best (\d+)$"),
    fixed(r"^(1e[-−]\d+)$"),
    fixed(r"by more than (5) %"),
    fixed(r"says something below (0\.01)"),
    fixed(r"more than (1) g"),
    fixed(r"parameters with eps_K > (-1)"),
    fixed(r"right to about (0\.02) sd"),
    fixed(rf"below a tenth of the class's size with ({NUM}) %"),
    fixed(r"(?:section|mount|plane|fixture) (\d+)"),
)
"""Numbers that are part of how a report is to be read."""

UNHELD = (
    fixed(rf"computed for the ({NUM}) subsets that AIC likes best; .*? right to ({NUM}) there"),
    fixed(rf"noise floor of ({NUM}) "),
    fixed(rf"within ±({NUM})$"),
    fixed(rf"Allan deviation within a factor ({NUM}) of"),
    fixed(rf"correlation ({NUM})"),
    fixed(r"^Strongest posterior correlations: (.+)$"),
    fixed(rf"^prior sd ({NUM})× wider"),
    fixed(rf"({NUM}) times narrower than its prior"),
    fixed(rf"do in this test, ({NUM}) \S+ rms"),
    fixed(
        rf"least squares over the ({NUM}) samples of [^:]*?(?:from ({NUM}) to ({NUM}) \S+)?:"
        rf" ({NUM})(?: ×(10)\S+)? \S+ rms are left"
    ),
    fixed(rf"Lowest ({NUM}) \S+ at ({NUM}) s; ({SHARE}) of the fitted curve within the (90) %"),
    fixed(rf"lowest ({NUM}) \S+ at ({NUM}) s"),
    fixed(rf"means (?:of the ensembles|are) within ({NUM}) sd"),
    fixed(rf"misalignments against the case to ({NUM}) "),
    fixed(rf"averages within the dwells: ({NUM}) \(by importance sampling"),
    fixed(r"k is above (0\.7) at (\d+) of (\d+) dwells"),
    fixed(r"^Posterior under the full library, each against each: (.+)$"),
    fixed(r"they differ on (\d+) others"),
    fixed(r"hyper-g prior differs on (\d+) terms"),
)
"""Sizes read off the runs, the draws or the fit for a figure or a note: the result does not have them."""
