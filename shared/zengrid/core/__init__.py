"""The market's physics and money as pure functions on numpy arrays, without I/O or global state."""
