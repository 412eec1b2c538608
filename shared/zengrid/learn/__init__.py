"""Learning: independent deep Q-learners in the vectorised market. Only here is torch imported."""
