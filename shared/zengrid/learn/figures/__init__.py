"""Figures: how they look, and those of a sweep. Matplotlib is loaded here and where these are drawn, nowhere else."""
