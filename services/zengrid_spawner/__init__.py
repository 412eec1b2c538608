"""The spawner: starts and supervises prosumer processes on its machine, for whoever asks over Zenoh."""
