"""The market as an environment: many days side by side, and as PettingZoo and Gymnasium know environments."""
