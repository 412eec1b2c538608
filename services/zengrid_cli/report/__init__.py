"""Results of a run, of policies and of trainings as tables for a terminal."""
