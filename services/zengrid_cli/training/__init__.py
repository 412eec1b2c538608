"""Training from the command line: its live view, and the jobs of sweeps and reproductions."""
