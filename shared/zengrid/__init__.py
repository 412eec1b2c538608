"""zengrid: a live market for a microgrid of prosumers, as a co-simulation over Zenoh."""

__version__ = "0.1.0"
