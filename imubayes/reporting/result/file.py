"""``result.json``: every result is written and read here, by one adapter."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args

from pydantic import Discriminator, Tag, TypeAdapter, ValidationError

from imubayes import __version__
from imubayes.errors import DataError, Place, said
from imubayes.reporting.result import plain
from imubayes.reporting.result.entries import SensorsResult
from imubayes.reporting.result.many import FleetResult, LotsResult
from imubayes.reporting.result.plans import HoursResult, PlanResult, TradeResult

RESULT = "result.json"
"""Name of the file in a folder of results."""

Result = Annotated[
    Annotated[SensorsResult, Tag("sensors")]
    | Annotated[LotsResult, Tag("lots")]
    | Annotated[FleetResult, Tag("fleet")]
    | Annotated[PlanResult, Tag("plan")]
    | Annotated[HoursResult, Tag("hours")]
    | Annotated[TradeResult, Tag("rungs")],
    Discriminator(lambda value: next((tag for tag in TAGS.values() if tag in value), None)),
]
"""Result of a study."""

TAGS = {kind: tag.tag for kind, tag in map(get_args, get_args(get_args(Result)[0]))}
"""Key that only the results of a kind have."""


@cache
def adapter(kind: Any = Result) -> TypeAdapter[Any]:
    """Reader and writer of results, or of those of a kind, which is made in half of the time."""
    return TypeAdapter(kind)


def result_schema() -> dict[str, Any]:
    """JSON Schema of ``result.json``."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **adapter().json_schema()}


def result_text(result: Result) -> str:
    """Text of ``result.json``: the same bytes for the same result; what is not finite is null."""
    own = adapter(next(kind for kind, tag in TAGS.items() if tag in result))
    return json_text(own.dump_python(own.validate_python(result), by_alias=True))


def json_text(values: Mapping[str, Any]) -> str:
    """Text of values of any form; what is not finite is null."""
    return json.dumps(plain(values), indent=1, allow_nan=False, ensure_ascii=False) + "\n"


@dataclass(frozen=True, slots=True)
class Written:
    """A ``result.json`` as it is: its bytes' hash, the study's title, imubayes' version, and its values."""

    path: Path
    sha256: str
    study: str
    version: str
    raw: Mapping[str, Any]


def written(path: Path) -> Written:
    """Read a ``result.json`` that ``imubayes run`` wrote, itself or from its folder; else a `DataError`."""
    file = path / RESULT if path.is_dir() else path
    try:
        content = file.read_bytes()
        raw = json.loads(content.decode("utf-8"))
    except FileNotFoundError:
        raise DataError(f"{file}: there is no such file: expected a {RESULT} or its folder") from None
    except OSError as error:
        raise DataError(f"{file}: cannot be read ({error.strerror}): check its permissions") from None
    except (UnicodeDecodeError, json.JSONDecodeError, RecursionError):
        raise no_result(file, "it is not JSON") from None
    if not isinstance(raw, dict) or "imubayes" not in raw:
        raise no_result(file, "it lacks the key 'imubayes'")
    digest = hashlib.sha256(content).hexdigest()
    return Written(file, digest, str(raw.get("study", "")), str(raw["imubayes"]), raw)


def no_result(file: Path, why: str, remedy: str = "expected one") -> DataError:
    """Error of a file that is no result."""
    return DataError(f"{file}: is no result of 'imubayes run' ({why}): {remedy}")


_Kind = TypeVar("_Kind", SensorsResult, LotsResult, FleetResult)


def read(file: Written, kind: type[_Kind], what: str) -> _Kind:
    """Check a result of one kind of study, that holds `what`; a `DataError` names the key and what came."""
    if not file.raw.get(TAGS[kind]):
        raise no_result(file.path, f"it holds no {what}, as of another kind of study")
    try:
        return adapter(kind).validate_python(file.raw)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = Place("").at(*first["loc"]).key
        again = f"imubayes {file.version} wrote it, and this is {__version__}: run the study again"
        remedy = "expected one" if file.version == __version__ else again
        raise no_result(file.path, f"{key}: {said(first)}", remedy) from None
