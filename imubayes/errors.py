"""What can go wrong, as a tree.

::

    ImubayesError
    ├── InputError             the caller's input is wrong: exit code 2
    │   ├── StudyError         a study file (TOML): names the file and the key
    │   ├── DataError          a run's file: names the file and the line or column
    │   ├── UnitError          a unit or quantity that cannot be read
    │   ├── TermError          a term, library, class or scene that is not known
    │   └── UnobservableError  too few rows or no information; carries the terms
    └── ConvergenceError       an iteration that did not settle; carries the estimate so far
"""

from __future__ import annotations


class ImubayesError(Exception):
    """Base of every error that imubayes raises on purpose."""


class InputError(ImubayesError):
    """The input is wrong; the message says where, what was expected and what to do."""


class StudyError(InputError):
    """A study file that does not say what a study must say."""


class DataError(InputError):
    """A run's file that cannot be used as it is."""


class UnitError(InputError):
    """A unit or a quantity that cannot be read, or that measures something else."""


class TermError(InputError):
    """A term, a library, a sensor class or a scene that does not exist."""


class UnobservableError(InputError):
    """The data carry no information on what was asked.

    Attributes
    ----------
    terms : names of the terms that cannot be told.
    """

    def __init__(self, message: str, terms: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.terms = terms


class ConvergenceError(ImubayesError):
    """An iteration that did not settle in its limit.

    Attributes
    ----------
    estimate : the last estimate, in whatever form the stage returns it.
    """

    def __init__(self, message: str, estimate: object = None) -> None:
        super().__init__(message)
        self.estimate = estimate
