"""Learning agents: the only place that knows torch."""
