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

`Place` names a key of a file, `said` what pydantic found there, and `hint` what was meant.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any


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


@dataclass(frozen=True, slots=True)
class Place:
    """A key of a file, by its dotted path (``sensor[0].run[1].file``).

    `called` are paths that the file has under another name, where one table is read as another; `base` is the
    folder that paths are relative to, where that is not the file's own.
    """

    file: str
    key: str = ""
    called: Mapping[str, str] = field(default_factory=dict, repr=False)
    base: Path | None = None

    @property
    def folder(self) -> Path:
        """Folder that paths which stand here are relative to."""
        return self.base or Path(self.file).parent

    def at(self, *keys: str | int) -> Place:
        """Go to a key of the table here, or to an entry of the list here, and so on."""
        path = self.key
        for key in keys:
            path += f"[{key}]" if isinstance(key, int) else f".{key}" if path else key
            path = self.called.get(path, path)
        return replace(self, key=path)

    def error(self, text: str) -> StudyError:
        """Give the error that says `text` of this place."""
        return StudyError(f"{self.file}: {self.key}: {text}" if self.key else f"{self.file}: {text}")

    @contextmanager
    def blamed(self) -> Iterator[None]:
        """Name this place in whatever input error the block raises."""
        try:
            yield
        except InputError as error:
            raise self.error(str(error)) from None


MISSING = ("missing", "missing_argument")
"""Errors of pydantic for a key that is not there."""


def shown(value: object) -> str:
    """Show a value of the file, shortened.

    Examples
    --------
    >>> shown("x" * 100)
    "'xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx..."
    """
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."


def said(error: Mapping[str, Any]) -> str:
    """Say in the house's words what pydantic found."""
    if error["type"] in MISSING:
        return "the key is missing"
    message = error["msg"].removeprefix("Value error, ").replace("Input should be", "expected")
    message = message.replace("a valid integer", "an integer").replace("a valid ", "a ")
    return f"{message[:1].lower()}{message[1:]}, came {shown(error['input'])}"


def hint(name: str, known: Iterable[str]) -> str:
    """Suggest what was meant.

    Examples
    --------
    >>> hint("powrs", ["powers", "asymmetry"]), hint("x", ["powers", "asymmetry"])
    ("did you mean 'powers'?", 'expected one of powers, asymmetry')
    """
    near = get_close_matches(name, known, n=1)
    return f"did you mean '{near[0]}'?" if near else f"expected one of {', '.join(known)}"
