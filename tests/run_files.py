"""What tests share: files of numbers, and inputs that are the same to the last bit."""

import numpy as np


def csv_of(folder, header, rows, name="run.csv"):
    """Write rows under a header with units, every number to its last bit."""
    path = folder / name
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.17g")
    return path


def same(found, expected):
    """Check that inputs have the channels and mounts of others, to the last bit."""
    assert found.channels.keys() == expected.channels.keys()
    for name, values in expected.channels.items():
        np.testing.assert_array_equal(found.channels[name], values)
    np.testing.assert_array_equal(found.mount, expected.mount)
