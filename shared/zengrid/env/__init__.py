"""The vectorised environment and its PettingZoo and Gymnasium adapters."""
