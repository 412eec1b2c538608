"""Parts of soak.py: the market under observation, the faults, and the audit afterwards."""
