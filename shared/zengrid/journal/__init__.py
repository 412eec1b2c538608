"""What is settled, and the state to resume from."""
