"""The spawner: supervises prosumer processes on its machine."""
