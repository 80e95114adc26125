"""Which method is right for a component, and why."""

from __future__ import annotations

from typing import Literal

from imubayes.inference.summary import Summary
from imubayes.units import counted

Method = Literal["exact", "collapsed", "full"]

LARGE = 2_000_000
"""Rows beyond which the noise is sampled only if asked: every draw that is averaged over whitens them all."""

WIDE = 30_000
"""Matrix entries that a draw of the noise adds up, runs times squared columns: more take minutes."""


def chosen_method(wanted: str, summary: Summary) -> tuple[Method, str]:
    """Method (``exact``, ``collapsed``, ``full``) and the reason in words.

    Parameters
    ----------
    wanted : one of these, or ``auto``.
    summary : of the runs.
    """
    if wanted == "exact" or wanted == "collapsed" or wanted == "full":
        return wanted, f"the method {wanted} was asked for"
    estimated = [run.name for run in summary.runs if run.steering]
    if not estimated:
        return "exact", "the noise of every run is given, so that the exact posterior is the whole answer"
    if summary.factor.n > LARGE:
        return "exact", (
            f"{summary.factor.n:,} samples fix the noise, and sampling it would whiten them all again and"
            " again; ask for the method collapsed to average over it all the same"
        )
    columns = len(summary.names)
    if len(estimated) * columns**2 > WIDE:
        return "exact", (
            f"to sample the noise of {counted(len(estimated), 'run')} beside {columns} columns takes minutes;"
            " ask for the method collapsed to average over it all the same"
        )
    several = "s" if len(estimated) > 1 else ""
    return "collapsed", (
        f"the noise of run{several} {', '.join(estimated)} is estimated from the same data: its uncertainty"
        " is sampled, and the coefficients are exact at each draw"
    )
