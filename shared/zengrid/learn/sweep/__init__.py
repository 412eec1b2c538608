"""Many trainings: cells of a sweep over values and seeds, done by processes or a cluster, never twice."""
