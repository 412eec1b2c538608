"""Zenoh: the keys, the sessions and their settings. The only place that imports zenoh."""
