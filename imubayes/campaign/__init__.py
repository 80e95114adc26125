"""A study as its file says, what comes of it, and the linear problem of each of its sensors."""
