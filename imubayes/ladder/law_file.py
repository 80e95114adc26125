"""The speeds of this machine in the user's cache folder."""

from __future__ import annotations

import json
import math
import os
import platform
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

FILE = "speeds.json"


def cache_folder() -> Path:
    """Where this platform keeps what a program can do without."""
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local") / "imubayes"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "imubayes"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "imubayes"


def read(kinds: Sequence[str]) -> dict[str, float] | None:
    """Seconds of each kind of work on this machine; None where they are not known."""
    try:
        kept = json.loads((cache_folder() / FILE).read_text(encoding="utf-8"))
        speeds = {kind: float(kept["speeds"][kind]) for kind in kinds}
        sound = all(math.isfinite(s) and s > 0.0 for s in speeds.values())
        return speeds if sound and kept["machine"] == _machine() else None
    except (OSError, RuntimeError, ValueError, LookupError, TypeError):
        return None


def write(speeds: Mapping[str, float]) -> None:
    """Keep the seconds of each kind of work, if the folder lets us."""
    text = json.dumps({"machine": _machine(), "speeds": dict(speeds)}, indent=1)
    try:
        folder = cache_folder()
        folder.mkdir(parents=True, exist_ok=True)
        part = folder / f"{FILE}.{os.getpid()}.part"
        part.write_text(text + "\n", encoding="utf-8")
        part.replace(folder / FILE)
    except (OSError, RuntimeError):
        return


def _machine() -> list[str]:
    """What the speeds hold for."""
    return [
        platform.node(),
        platform.machine(),
        str(os.cpu_count()),
        platform.python_version(),
        np.__version__,
    ]
