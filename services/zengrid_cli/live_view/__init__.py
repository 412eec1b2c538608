"""The live view of a running market in a terminal."""
