"""Binary files that hold named arrays: HDF5, MATLAB, NumPy archives."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imubayes.errors import DataError
from imubayes.rig.texts import Text, read_spaced, said

Array = NDArray[np.generic]

_MATLAB_BINARY = b"MATLAB"
_HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_MATLAB_73_OFFSET = 512
"""A version 7.3 file is HDF5 behind a block of 512 bytes."""


def read_hdf5(path: Path, shown: str) -> Mapping[str, Array]:
    """Datasets of an HDF5 file: at the root, in one group (by their own names), or by path.

    A unit comes from brackets in the name, or from the attribute ``unit`` or ``units``.

    Raises
    ------
    DataError : if the file is not HDF5.
    """
    return named(_hdf5(path, shown, transpose=False))


def read_matlab(path: Path, shown: str) -> Mapping[str, Array] | Text:
    """Variables of a MATLAB file; fields of structures as ``log.t``. Text is read as columns.

    Raises
    ------
    DataError : if the file is neither a MATLAB file nor text.
    """
    with path.open("rb") as stream:
        head = stream.read(_MATLAB_73_OFFSET + len(_HDF5_SIGNATURE))
    if head[_MATLAB_73_OFFSET:] == _HDF5_SIGNATURE:
        return named(_hdf5(path, shown, transpose=True))
    if head.startswith(_MATLAB_BINARY):
        return _matlab5(path, shown)
    return read_spaced(path, shown)


def read_numpy(path: Path, shown: str) -> Mapping[str, Array]:
    """Arrays of a NumPy archive. Pickled objects are never loaded.

    Raises
    ------
    DataError : if it is not an archive, or a member is a pickle.
    """
    import zipfile

    if not zipfile.is_zipfile(path):
        raise DataError(
            f"{shown}: is not a NumPy archive: expected a file written by numpy.savez with plain arrays"
        )
    with (
        _reading(shown, "a NumPy archive"),
        path.open("rb") as stream,
        np.load(stream, allow_pickle=False) as archive,
    ):
        return dict(_flat("", {name: _plain(archive, name, shown) for name in archive.files}))


def _plain(archive: Any, name: str, shown: str) -> Array:
    try:
        return archive[name]
    except ValueError as error:
        if "pickle" not in str(error):
            raise
    raise DataError(
        f"{shown}: '{name}' holds a pickle, which could run code: expected plain arrays of numbers, "
        "save it without objects"
    )


def _matlab5(path: Path, shown: str) -> Mapping[str, Array]:
    import scipy.io

    with _reading(shown, "a MATLAB file"):
        content = scipy.io.loadmat(path, simplify_cells=True)
    return dict(_flat("", {name: value for name, value in content.items() if not name.startswith("__")}))


@contextmanager
def _reading(shown: str, wanted: str) -> Iterator[None]:
    """Call the file damaged whatever its parser raises: on a damaged file they raise almost anything."""
    try:
        yield
    except DataError:
        raise
    except Exception as error:  # noqa: BLE001
        raise DataError(f"{shown}: is not {wanted} that can be read: {said(error)}") from None


def _flat(prefix: str, content: Mapping[str, Any]) -> Iterator[tuple[str, Array]]:
    """Arrays of numbers with at least two entries, by dotted name."""
    for name, value in content.items():
        if isinstance(value, Mapping):
            yield from _flat(f"{prefix}{name}.", value)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "iuf" and value.size > 1:
            yield f"{prefix}{name}", _columnar(value)


def _columnar(values: Array) -> Array:
    """MATLAB's and HDF5's single rows and columns as plain vectors."""
    return values.reshape(-1) if values.ndim == 2 and 1 in values.shape else values


def _hdf5(path: Path, shown: str, *, transpose: bool) -> dict[str, Array]:
    import h5py

    with _reading(shown, "an HDF5 file"), h5py.File(path, "r") as file:
        found = {name: node[...] for name, node in datasets_of(file).items()}
    return {name: _columnar(values.T if transpose else values) for name, values in found.items()}


def datasets_of(file: Any) -> dict[str, Any]:
    """Datasets of numbers, of two entries at least, by their paths in an open HDF5 file, with their units."""
    import h5py

    found: dict[str, Any] = {}

    def visit(name: str, node: Any) -> None:
        if not isinstance(node, h5py.Dataset) or name.startswith("#") or node.dtype.kind not in "iuf":
            return
        if node.size is not None and node.size > 1:
            unit = node.attrs.get("unit", node.attrs.get("units"))
            found[name if unit is None or "[" in name else f"{name} [{_decoded(unit)}]"] = node

    file.visititems(visit)
    return found


def _decoded(unit: object) -> str:
    return unit.decode() if isinstance(unit, bytes) else str(unit)


def named(found: dict[str, Any]) -> dict[str, Any]:
    """Call datasets by their own names if all of them are in one group, else by path (``imu.f_i``)."""
    groups = {name.partition(" [")[0].rpartition("/")[0] for name in found}
    if len(groups) == 1:
        cut = len(groups.pop())
        return {name[cut:].lstrip("/"): values for name, values in found.items()}
    return {
        name.partition(" [")[0].replace("/", ".") + _unit_of(name): values for name, values in found.items()
    }


def _unit_of(name: str) -> str:
    _, bracket, unit = name.partition(" [")
    return bracket + unit
