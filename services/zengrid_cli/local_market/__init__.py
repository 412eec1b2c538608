"""A whole market on this machine: which processes it consists of, and how they are started and ended."""
